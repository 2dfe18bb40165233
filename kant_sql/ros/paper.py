"""The services of the paper's node: get, update and delete all, for five kinds of elements.

The messages of `kant_msgs` and what a service answers are those of the original's node (KANT,
2022); what is stored, and what is refused, is that of `kant_sql.compat`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from ..compat import DaoFactory
from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..errors import InvalidKnowledgeError
from .service import Service

logger = logging.getLogger(__name__)

# kant_msgs/msg/UpdateKnowledge and kant_msgs/srv/GetPddlProposition.
SAVE, DELETE = 0, 1
ALL, GOALS, NO_GOALS, BY_PREDICATE = 1, 2, 3, 4


def read_type(message: Any) -> PddlTypeDto:
    """Read a `PddlType`."""
    return PddlTypeDto(message.name)


def read_object(message: Any) -> PddlObjectDto:
    """Read a `PddlObject`."""
    return PddlObjectDto(read_type(message.type), message.name)


def read_predicate(message: Any) -> PddlPredicateDto:
    """Read a `PddlPredicate`."""
    return PddlPredicateDto(message.name, [read_type(each) for each in message.types])


def read_proposition(message: Any) -> PddlPropositionDto:
    """Read a `PddlProposition`."""
    objects = [read_object(each) for each in message.objects]
    return PddlPropositionDto(read_predicate(message.predicate), objects, message.is_goal)


def read_literal(message: Any) -> PddlConditionEffectDto:
    """Read a `PddlConditionEffect`; a text cannot be None, so that an empty time says it."""
    return PddlConditionEffectDto(
        read_predicate(message.predicate),
        [read_object(each) for each in message.objects],
        message.time or None,
        message.is_negative,
    )


def read_action(message: Any) -> PddlActionDto:
    """Read a `PddlAction`."""
    return PddlActionDto(
        message.name,
        [read_object(each) for each in message.parameters],
        [read_literal(each) for each in message.coditions],
        [read_literal(each) for each in message.effects],
        message.durative,
        duration=message.duration,
    )


@dataclass(frozen=True)
class Writer:
    """Writes elements as messages of `kant_msgs`; `made` is the module of its messages."""

    made: Any

    def type(self, dto: PddlTypeDto) -> Any:
        """Write a type."""
        return self.made.PddlType(name=dto.name)

    def object(self, dto: PddlObjectDto) -> Any:
        """Write an object."""
        return self.made.PddlObject(type=self.type(dto.type), name=dto.name)

    def predicate(self, dto: PddlPredicateDto) -> Any:
        """Write a predicate."""
        return self.made.PddlPredicate(name=dto.name, types=[self.type(one) for one in dto.types])

    def proposition(self, dto: PddlPropositionDto) -> Any:
        """Write a proposition."""
        return self.made.PddlProposition(is_goal=dto.is_goal, **self._atom(dto))

    def literal(self, dto: PddlConditionEffectDto) -> Any:
        """Write a literal of an action."""
        said = {"time": dto.time or "", "is_negative": dto.is_negative}
        return self.made.PddlConditionEffect(**said, **self._atom(dto))

    def _atom(self, dto: PddlPropositionDto | PddlConditionEffectDto) -> dict[str, Any]:
        objects = [self.object(each) for each in dto.objects]
        return {"predicate": self.predicate(dto.predicate), "objects": objects}

    def action(self, dto: PddlActionDto) -> Any:
        """Write an action.

        Raises:
            InvalidKnowledgeError: it says more than literals, or has no whole number as duration.
        """
        parts: list[list[Any]] = []
        for given in (dto.conditions, dto.effects):
            literals = [one for one in given if isinstance(one, PddlConditionEffectDto)]
            if len(literals) < len(given):
                raise InvalidKnowledgeError(
                    f"action {dto.name} has more than literals, which a PddlAction cannot hold; "
                    "ask the domain expert's services for it, or for the domain as PDDL text"
                )
            parts.append([self.literal(one) for one in literals])
        return self.made.PddlAction(
            name=dto.name,
            durative=dto.durative,
            duration=_duration(dto) if dto.durative else 0,
            parameters=[self.object(one) for one in dto.parameters],
            coditions=parts[0],
            effects=parts[1],
        )


def _duration(dto: PddlActionDto) -> int:
    given = dto.duration
    number = Decimal(given) if isinstance(given, int | float | Decimal) else Decimal("0.5")
    if number % 1 or abs(number) >= 2**31:
        raise InvalidKnowledgeError(
            f"the duration of action {dto.name} is no whole number, which a PddlAction needs"
        )
    return int(number)


@dataclass(frozen=True)
class _Kind:
    """How one kind of element is called in services and messages."""

    name: str
    title: str
    read: Callable[[Any], Any]

    @property
    def plural(self) -> str:
        return f"{self.name}s"


_KINDS = (
    _Kind("type", "Type", read_type),
    _Kind("object", "Object", read_object),
    _Kind("predicate", "Predicate", read_predicate),
    _Kind("proposition", "Proposition", read_proposition),
    _Kind("action", "Action", read_action),
)


def services(factory: DaoFactory, messages: Any, kinds: Any, empty: type) -> Iterable[Service]:
    """Yield the fifteen services.

    Args:
        factory: the DAOs that answer.
        messages: the module `kant_msgs.msg`.
        kinds: the module `kant_msgs.srv`.
        empty: `std_srvs.srv.Empty`.
    """
    writer = Writer(messages)
    for kind in _KINDS:
        dao = getattr(factory, f"create_pddl_{kind.name}_dao")()
        get, update = (getattr(kinds, f"{verb}Pddl{kind.title}") for verb in ("Get", "Update"))
        yield Service(f"get_{kind.plural}", get, _getter(kind, dao, writer))
        yield Service(f"update_{kind.name}", update, _updater(kind, dao))
        yield Service(f"delete_all_{kind.plural}", empty, _deleter(dao))


def _getter(kind: _Kind, dao: Any, writer: Writer) -> Callable[[Any, Any], None]:
    write = getattr(writer, kind.name)

    def get(request: Any, response: Any) -> None:
        found = []
        for dto in _asked(kind, dao, request):
            try:
                found.append(write(dto))
            except InvalidKnowledgeError as error:
                logger.warning("left out of the answer: %s", error)
        setattr(response, f"pddl_{kind.plural}", found)

    return get


def _asked(kind: _Kind, dao: Any, request: Any) -> Iterable[Any]:
    if kind.name != "proposition":
        name = getattr(request, f"{kind.name}_name")
        return dao.get_all() if not name else filter(None, [dao.get(name)])
    reads: dict[int, Callable[[], Iterable[Any]]] = {
        ALL: dao.get_all,
        GOALS: dao.get_goals,
        NO_GOALS: dao.get_no_goals,
        BY_PREDICATE: lambda: dao.get_by_predicate(request.predicate_name),
    }
    return reads.get(request.get_type, list)()


def _updater(kind: _Kind, dao: Any) -> Callable[[Any, Any], None]:
    def update(request: Any, response: Any) -> None:
        # The field's name is misspelt in kant_msgs.
        calls = {SAVE: dao.save, DELETE: dao.delete}
        call = calls.get(request.update_konwledge.update_type)
        dto = kind.read(getattr(request, f"pddl_{kind.name}"))
        response.success = call is not None and call(dto)

    return update


def _deleter(dao: Any) -> Callable[[Any, Any], None]:
    return lambda _request, _response: dao.delete_all()
