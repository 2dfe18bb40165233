"""The services of the paper's node: get, update and delete all, for five kinds of elements.

The messages of `kant_msgs` and what a service answers are those of the original's node (KANT,
2022); what is stored, and what is refused, is that of `kant_sql.compat`.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from decimal import Decimal
from functools import partial
from math import ceil
from typing import Any

from ..compat import DaoFactory
from ..dto import (
    Dto,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from .service import Service

logger = logging.getLogger(__name__)

# kant_msgs/msg/UpdateKnowledge and kant_msgs/srv/GetPddlProposition.
SAVE, DELETE = 0, 1
ALL, GOALS, NO_GOALS, BY_PREDICATE = 1, 2, 3, 4

# The fields that a message and its DTO have, and the DTOs of those that hold messages.
_FIELDS: dict[type[Dto], tuple[str, ...]] = {
    PddlTypeDto: ("name",),
    PddlObjectDto: ("type", "name"),
    PddlPredicateDto: ("name", "types"),
    PddlPropositionDto: ("predicate", "objects", "is_goal"),
    PddlConditionEffectDto: ("predicate", "objects", "time", "is_negative"),
    PddlActionDto: ("name", "parameters", "conditions", "effects", "durative", "duration"),
}
_PARTS: dict[str, type[Dto]] = {
    "predicate": PddlPredicateDto,
    **dict.fromkeys(("type", "types"), PddlTypeDto),
    **dict.fromkeys(("objects", "parameters"), PddlObjectDto),
    **dict.fromkeys(("conditions", "effects"), PddlConditionEffectDto),
}
# A field that is misspelt in kant_msgs.
_SPELT = {"conditions": "coditions"}


def _read(kind: type[Dto] | None, given: Any) -> Any:
    """Read the value of a field, and a message as a DTO of a class."""
    if kind is None or isinstance(given, list):
        return [_read(kind, each) for each in given] if kind else given
    if kind is PddlTypeDto and given.name.startswith("(either "):
        return PddlEitherTypeDto(map(PddlTypeDto, given.name.strip("()").split()[1:]))
    fields = {name: getattr(given, _SPELT.get(name, name)) for name in _FIELDS[kind]}
    if "time" in fields:
        # A text cannot be None, so that an empty time says it.
        fields["time"] = given.time or None
    return kind(**{name: _read(_PARTS.get(name), value) for name, value in fields.items()})


def _write(messages: Any, dto: Any, kind: type[Dto] | None) -> Any:
    """Write the value of a field, and a DTO of a class as a message of `messages`."""
    if kind is None:
        return "" if dto is None else dto
    if isinstance(dto, list):
        return [_write(messages, each, kind) for each in dto]
    if not isinstance(dto, kind):
        raise InvalidKnowledgeError(f"it has {dto}, where its message can hold literals only")
    made = {name: _write(messages, getattr(dto, name), _PARTS.get(name)) for name in _FIELDS[kind]}
    if isinstance(dto, PddlActionDto):
        made |= {"coditions": made.pop("conditions"), "duration": _whole(dto)}
    return getattr(messages, kind.__name__.removesuffix("Dto"))(**made)


def _whole(action: PddlActionDto) -> int:
    """Return the duration of an action, rounded up so that a plan leaves enough time."""
    given = action.duration if action.durative else 0
    whole = ceil(given) if isinstance(given, int | float | Decimal) else None
    if whole is None or abs(whole) >= 2**31:
        raise InvalidKnowledgeError("its duration is no number that its message can hold")
    if whole != given:
        logger.warning("the duration of action %s, %s, is sent as %d", action.name, given, whole)
    return whole


def services(factory: DaoFactory, messages: Any, kinds: Any, empty: type) -> Iterable[Service]:
    """Yield the fifteen services.

    Args:
        factory: the DAOs that answer.
        messages: the module `kant_msgs.msg`.
        kinds: the module `kant_msgs.srv`.
        empty: `std_srvs.srv.Empty`.
    """
    for kind in (PddlTypeDto, PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlActionDto):
        title = kind.__name__.removesuffix("Dto")
        name = title.removeprefix("Pddl").lower()
        dao = getattr(factory, f"create_pddl_{name}_dao")()
        get, update = (getattr(kinds, f"{verb}{title}") for verb in ("Get", "Update"))
        yield Service(f"get_{name}s", get, partial(_get, messages, kind, name, dao))
        yield Service(f"update_{name}", update, partial(_update, kind, name, dao))
        yield Service(f"delete_all_{name}s", empty, partial(_delete_all, dao))


def _get(messages: Any, kind: type[Dto], name: str, dao: Any, request: Any, response: Any) -> None:
    found = []
    for dto in _asked(name, dao, request):
        try:
            found.append(_write(messages, dto, kind))
        except InvalidKnowledgeError as error:
            logger.warning("%s %s is left out of an answer: %s", name, dto.name, error)
    setattr(response, f"pddl_{name}s", found)


def _asked(name: str, dao: Any, request: Any) -> Any:
    if name != "proposition":
        asked = getattr(request, f"{name}_name")
        return filter(None, [dao.get(asked)]) if asked else dao.get_all()
    if request.get_type == BY_PREDICATE:
        return dao.get_by_predicate(request.predicate_name)
    reads = {ALL: dao.get_all, GOALS: dao.get_goals, NO_GOALS: dao.get_no_goals}
    if request.get_type not in reads:
        raise InvalidArgumentError(f"get_type is {request.get_type}, and none of 1 to 4")
    return reads[request.get_type]()


def _update(kind: type[Dto], name: str, dao: Any, request: Any, response: Any) -> None:
    # The field's name is misspelt in kant_msgs.
    number = request.update_konwledge.update_type
    if number not in (SAVE, DELETE):
        raise InvalidArgumentError(f"update_type is {number}, neither 0 to save nor 1 to delete")
    dto = _read(kind, getattr(request, f"pddl_{name}"))
    stored = dao.get(dto.name) if kind is PddlActionDto else None
    exact = getattr(stored, "duration", None)
    if isinstance(exact, float | Decimal) and ceil(exact) == dto.duration:
        # What a client has read rounded, and writes back, stays as it is.
        dto.duration = exact
    response.success = dao.save(dto) if number == SAVE else dao.delete(dto)


def _delete_all(dao: Any, _request: Any, _response: Any) -> None:
    dao.delete_all()
