"""The services of KANT's node: get, update and delete all, for five kinds of elements.

The messages of `kant_msgs` and the answers are those of the original node (KANT, 2022);
`kant_sql.compat` decides what is stored and what is refused.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from decimal import Decimal
from functools import partial
from math import ceil
from typing import Any

from .. import dto
from ..compat import DaoFactory
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from .service import Service

logger = logging.getLogger("kant_sql.ros")

# kant_msgs/msg/UpdateKnowledge and kant_msgs/srv/GetPddlProposition.
SAVE, DELETE = 0, 1
ALL, GOALS, NO_GOALS, BY_PREDICATE = 1, 2, 3, 4

# The kinds with services, and literals: a message PddlX has the fields of a PddlXDto.
_FIELDS: dict[str, tuple[str, ...]] = {
    "Type": ("name",),
    "Object": ("type", "name"),
    "Predicate": ("name", "types"),
    "Proposition": ("predicate", "objects", "is_goal"),
    "Action": ("name", "parameters", "conditions", "effects", "durative", "duration"),
    "ConditionEffect": ("predicate", "objects", "time", "is_negative"),
}
# The fields that hold messages.
_PARTS = {
    "predicate": "Predicate",
    **dict.fromkeys(("type", "types"), "Type"),
    **dict.fromkeys(("objects", "parameters"), "Object"),
    **dict.fromkeys(("conditions", "effects"), "ConditionEffect"),
}
# A field that is misspelt in kant_msgs.
_SPELT = {"conditions": "coditions"}


def _read(kind: str | None, given: Any) -> Any:
    """Read the value of a field, and a message of a kind as its DTO."""
    if kind is None or isinstance(given, list):
        return [_read(kind, each) for each in given] if kind else given
    if kind == "Type" and given.name.startswith("(either "):
        return dto.PddlEitherTypeDto(map(dto.PddlTypeDto, given.name.strip("()").split()[1:]))
    fields = {name: getattr(given, _SPELT.get(name, name)) for name in _FIELDS[kind]}
    if "time" in fields:
        # A text cannot be None, so an empty time means None.
        fields["time"] = given.time or None
    made = {name: _read(_PARTS.get(name), value) for name, value in fields.items()}
    return getattr(dto, f"Pddl{kind}Dto")(**made)


def _write(messages: Any, kind: str | None, given: Any) -> Any:
    """Write the value of a field, and a DTO as a message of a kind."""
    if kind is None:
        return "" if given is None else given
    if isinstance(given, list):
        return [_write(messages, kind, each) for each in given]
    if not isinstance(given, getattr(dto, f"Pddl{kind}Dto")):
        raise InvalidKnowledgeError(f"it has {given}, where its message can hold literals only")
    made = {one: _write(messages, _PARTS.get(one), getattr(given, one)) for one in _FIELDS[kind]}
    if kind == "Action":
        made |= {"coditions": made.pop("conditions"), "duration": _whole(given)}
    return getattr(messages, f"Pddl{kind}")(**made)


def _whole(action: dto.PddlActionDto) -> int:
    """Return the duration of an action, rounded up so that a plan leaves enough time."""
    given = action.duration if action.durative else 0
    whole = ceil(given) if isinstance(given, int | float | Decimal) else None
    if whole is None or abs(whole) >= 2**31:
        raise InvalidKnowledgeError("its duration does not fit into its message")
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
    for kind in [*_FIELDS][:-1]:
        name = kind.lower()
        dao = getattr(factory, f"create_pddl_{name}_dao")()
        get, update = (getattr(kinds, f"{verb}Pddl{kind}") for verb in ("Get", "Update"))
        yield Service(f"get_{name}s", get, partial(_get, messages, kind, dao))
        yield Service(f"update_{name}", update, partial(_update, kind, dao))
        yield Service(f"delete_all_{name}s", empty, partial(_delete_all, dao))


def _get(messages: Any, kind: str, dao: Any, request: Any, response: Any) -> None:
    found = []
    for given in _asked(kind, dao, request):
        try:
            found.append(_write(messages, kind, given))
        except InvalidKnowledgeError as error:
            logger.warning("action %s is left out of an answer: %s", given.name, error)
    setattr(response, f"pddl_{kind.lower()}s", found)


def _asked(kind: str, dao: Any, request: Any) -> Any:
    if kind != "Proposition":
        name = getattr(request, f"{kind.lower()}_name")
        return filter(None, [dao.get(name)]) if name else dao.get_all()
    if request.get_type == BY_PREDICATE:
        return dao.get_by_predicate(request.predicate_name)
    reads = {ALL: dao.get_all, GOALS: dao.get_goals, NO_GOALS: dao.get_no_goals}
    if request.get_type not in reads:
        raise InvalidArgumentError(f"get_type is {request.get_type}, expected 1 to 4")
    return reads[request.get_type]()


def _update(kind: str, dao: Any, request: Any, response: Any) -> None:
    # The field's name is misspelt in kant_msgs.
    number = request.update_konwledge.update_type
    if number not in (SAVE, DELETE):
        raise InvalidArgumentError(f"update_type is {number}, neither 0 to save nor 1 to delete")
    given = _read(kind, getattr(request, f"pddl_{kind.lower()}"))
    stored = dao.get(given.name) if kind == "Action" else None
    exact = getattr(stored, "duration", None)
    if isinstance(exact, float | Decimal) and ceil(exact) == given.duration:
        # A value that a client read rounded, and writes back, stays unchanged.
        given.duration = exact
    response.success = dao.save(given) if number == SAVE else dao.delete(given)


def _delete_all(dao: Any, _request: Any, _response: Any) -> None:
    dao.delete_all()
