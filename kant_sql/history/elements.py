"""Elements as callers give them (DTO, formula or PDDL text), and the identities they name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from sqlalchemy import ColumnElement, Select, Text, bindparam, cast, select

from ..arguments import expect, expect_list, flag, shown
from ..dao.signatures import MAX_ARITY
from ..dao.text import refuse_unknown
from ..dto import (
    PddlActionDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.elements import Dto, NamedDto
from ..dto.formulas import Node
from ..dto.lexical import RESERVED, fold, is_word
from ..errors import InvalidKnowledgeError
from ..pddl.lexer import tokenize
from ..sql.dialects.base import Session
from ..sql.query import Query, constant, integer
from ..sql.rows import FACT, GOAL, KB, KIND_TABLES, PROPOSITION, VALUE, VERSION_COLUMNS
from ..store.store import Store

NAMED_KINDS = ("type", "object", "predicate", "function", "action", "rule", "document")
_CLASSES: dict[type[Dto], str] = {
    PddlTypeDto: "type",
    PddlObjectDto: "object",
    PddlPredicateDto: "predicate",
    PddlFunctionDto: "function",
    PddlActionDto: "action",
}
_DECIMAL = re.compile(r"-?\d+\.\d+")
# Kinds of definitions with a word before their name.
_DEFINITIONS = {
    ":constants": "object",
    ":action": "action",
    ":durative-action": "action",
    ":process": "action",
    ":event": "action",
    ":rule": "rule",
}
ACCEPTED = (
    "give a DTO of a type, object, predicate, function, action, proposition or function value, a "
    "formula, PDDL text such as (robot_at rb1 wp1), or a name"
)


# A DTO, a formula, PDDL text such as `(robot_at rb1 wp1)`, or a name.
Element = Dto | Node | str


class Named(NamedTuple):
    """The definitions of a folded name."""

    kinds: tuple[str, ...]
    name: str
    is_involved: bool = False  # whether to include all that involves an object of the name


class Applied(NamedTuple):
    """A predicate or a function applied to objects, with folded names."""

    kinds: frozenset[str]  # of `fact`, `goal` and `value`
    name: str
    arguments: tuple[str, ...]


class Written(NamedTuple):
    """A standalone formula of any section."""

    words: str  # its text, as `comparable` returns it


Sought = Named | Applied | Written


def comparable(text: str) -> str:
    """Normalize the text of a formula for comparison: 7.50 is 7.5."""
    words = tokenize(fold(text))
    plain = (w.rstrip("0").rstrip(".") if _DECIMAL.fullmatch(w) else w for w in words)
    return " ".join(plain)


def sought(element: object) -> list[Sought]:
    """Read which elements a caller wants."""
    if isinstance(element, Dto):
        return [_of_dto(element)]
    if isinstance(element, Node):
        return list(_of_text(str(element)))
    if isinstance(element, str):
        return list(_of_text(element))
    raise _refusal(element)


def refuse_unknown_element(store: Store, element: object) -> None:
    """Refuse a text with a name that never existed; the element of a DTO may be saved later."""
    if not isinstance(element, str):
        return
    for each in sought(element):
        if isinstance(each, Named):
            refuse_unknown(store, each.name, *each.kinds)
        elif isinstance(each, Applied):
            heads = {VALUE: "function"}
            kinds = dict.fromkeys(heads.get(kind, "predicate") for kind in sorted(each.kinds))
            refuse_unknown(store, each.name, *kinds)
            for name in each.arguments:
                refuse_unknown(store, name, "object")


def _refusal(element: object) -> InvalidKnowledgeError:
    return InvalidKnowledgeError(
        f"{shown(element)} is not an element of a knowledge base; {ACCEPTED}"
    )


def _of_dto(dto: Dto) -> Sought:
    if isinstance(dto, PddlPropositionDto):
        expect(dto.predicate, PddlPredicateDto, "the predicate of a proposition")
        kind = GOAL if flag(dto.is_goal, "is_goal of a proposition") else FACT
        return _applied((kind,), dto.predicate.name, _names(dto.objects, "a proposition"))
    if isinstance(dto, PddlFunctionValueDto):
        expect(dto.function, PddlFunctionDto, "the function of a function value")
        return _applied((VALUE,), dto.function.name, _names(dto.objects, "a function value"))
    kinds = [kind for class_, kind in _CLASSES.items() if isinstance(dto, class_)]
    if kinds and isinstance(dto, NamedDto):
        return Named((kinds[0],), fold(dto.name), is_involved=True)
    raise _refusal(dto)


def _names(objects: Any, of: str) -> list[str]:
    role = f"the list of objects of {of}"
    return [object_.name for object_ in expect_list(objects, PddlObjectDto, role)]


def _applied(kinds: Iterable[str], name: str, arguments: Iterable[str]) -> Applied:
    return Applied(frozenset(kinds), fold(name), tuple(map(fold, arguments)))


def _of_text(text: str) -> Iterator[Sought]:
    pending = [text]
    while pending:
        part = pending.pop()
        words = tokenize(fold(part))
        if words[:1] != ["("]:
            yield _of_declaration(words, part)
            continue
        end = _end(words)
        head, tail = words[1:2], words[end:]
        if head in ([], ["("], [")"]) or tail[:1] not in ([], ["-"]):
            raise _refusal(part)
        if tail:
            # A function's text may end with the type of its values.
            yield Named(("function",), head[0])
        elif head == ["and"]:
            pending += reversed([*_parts(words[2:-1])])
        else:
            yield from _of_list(head[0], words)


def _of_list(head: str, words: list[str]) -> Iterator[Sought]:
    if head in _DEFINITIONS or head == "define":
        kind = _DEFINITIONS.get(head, "document")
        yield Named((kind,), next((word for word in words[2:] if word not in "()"), ""))
    elif len(words) > 3 and words[2][0] == "?" and is_word(head):
        yield Named(("predicate", "function"), head)
    else:
        yield from _of_formula(words)


def _of_declaration(words: list[str], text: str) -> Named:
    """Read a name, or the text of a type or an object: `wp1 - wp`."""
    if len(words) > 2 and words[1] == "-":
        return Named(("type", "object"), words[0])
    if len(words) != 1 or not is_word(words[0]):
        raise _refusal(text)
    return Named(NAMED_KINDS, words[0], is_involved=True)


def _of_formula(words: list[str]) -> Iterator[Sought]:
    inner = words[1:-1]
    is_flat = "(" not in inner and all(map(is_word, inner))
    if is_flat and inner[0] not in RESERVED["predicate"]:
        yield _applied((FACT, GOAL, VALUE), inner[0], inner[1:])
    if not is_flat or inner[0] in RESERVED["predicate"]:
        yield Written(comparable(" ".join(words)))
    # `(= (fuel t1) 7)`: the fluent, and perhaps a goal.
    if inner[:2] == ["=", "("] and inner.index(")") == len(inner) - 2:
        fluent = inner[2:-2]
        if fluent and "(" not in fluent and all(map(is_word, fluent)):
            yield _applied((VALUE,), fluent[0], fluent[1:])


def _end(words: list[str]) -> int:
    """Return the position after the list that words begin with; 0 if it is not closed."""
    depth = 0
    for position, word in enumerate(words, start=1):
        depth += (word == "(") - (word == ")")
        if depth == 0:
            return position
    return 0


def _parts(words: list[str]) -> Iterator[str]:
    """Split words into lists."""
    while words:
        end = _end(words) or len(words)
        yield " ".join(words[:end])
        words = words[end:]


class Lookup(NamedTuple):
    """How one part of a question finds an identity, if any."""

    source: str  # a key of `VERSION_COLUMNS`
    part: int  # the position of the part in the question, which its parameters have
    arguments: int | None = None  # the number of objects; None for a name
    is_goal: bool = False  # of a proposition
    is_involved: bool = False  # an object, perhaps with all that involves it


def look_up(
    session: Session, kb_id: int, wanted: Sequence[Sought]
) -> tuple[tuple[Lookup, ...], dict[str, Any]]:
    """Make the lookups of elements and their parameters; formulas take one statement."""
    found: list[Lookup] = []
    parameters: dict[str, Any] = {}
    for part, each in enumerate(wanted):
        if isinstance(each, Written):
            continue
        # Its own name and those of its objects.
        names = each.name, *(each.arguments if isinstance(each, Applied) else ())
        if len(names) <= MAX_ARITY + 1 and all(map(is_word, names)):
            found += _lookups(part, each)
            parameters |= {_parameter(part, number): name for number, name in enumerate(names)}
    texts = {each.words for each in wanted if isinstance(each, Written)}
    if texts:
        formulas = session.stream(_FORMULAS, kb=kb_id)
        ids = dict.fromkeys(id_ for id_, text in formulas if comparable(text) in texts)
        for part, id_ in enumerate(ids, start=len(wanted)):
            found.append(Lookup("formula", part))
            parameters[_parameter(part, 0)] = id_
    return tuple(found), parameters


_VERSION = VERSION_COLUMNS["formula"].version
_FORMULAS = Query(select(_VERSION.formula_id, _VERSION.text).where(_VERSION.kb_id == KB).distinct())


def take_objects(wanted: Sequence[Sought]) -> tuple[set[str], list[Sought]]:
    """Split off the names of objects whose involvement is wanted."""
    names, rest = set[str](), list[Sought]()
    for each in wanted:
        if not (isinstance(each, Named) and each.is_involved and "object" in each.kinds):
            rest.append(each)
            continue
        kinds = tuple(kind for kind in each.kinds if kind != "object")
        rest.append(each._replace(kinds=kinds))
        if is_word(each.name):
            names.add(each.name)
    return names, rest


def _lookups(part: int, wanted: Named | Applied) -> Iterator[Lookup]:
    if isinstance(wanted, Named):
        for kind in wanted.kinds:
            yield Lookup(kind, part, is_involved=wanted.is_involved and kind == "object")
        return
    for kind, source in ((FACT, PROPOSITION), (GOAL, PROPOSITION), (VALUE, VALUE)):
        if kind in wanted.kinds:
            yield Lookup(source, part, len(wanted.arguments), kind == GOAL)


def _parameter(part: int, number: int) -> str:
    return f"name{part}_{number}"


def identity_of(lookup: Lookup) -> ColumnElement[int]:
    """Select the id of the identity that a lookup finds."""
    identity = VERSION_COLUMNS[lookup.source].identity
    name = _parameter(lookup.part, 0)
    if lookup.source == "formula":
        return integer(name)
    if lookup.arguments is None:
        return _id_of(lookup.source, name)
    ids: Select[Any] = select(identity.id).where(identity.kb_id == KB)
    objects = range(1, lookup.arguments + 1)
    interned = identity.arguments == _interned(
        [cast(_id_of("object", _parameter(lookup.part, number)), Text) for number in objects]
    )
    if lookup.source == VALUE:
        ids = ids.where(identity.function_id == _id_of("function", name), interned)
    else:
        is_goal = identity.is_goal == constant(lookup.is_goal)
        ids = ids.where(is_goal, identity.predicate_id == _id_of("predicate", name), interned)
    return ids.scalar_subquery()


def _id_of(kind: str, parameter: str) -> ColumnElement[int]:
    identity = KIND_TABLES[kind].identity.c
    return (
        select(identity.id)
        .where(identity.kb_id == KB, identity.key == bindparam(parameter))
        .correlate(None)
        .scalar_subquery()
    )


def _interned(ids: Sequence[ColumnElement[str]]) -> ColumnElement[str]:
    """Write the key of interned arguments; NULL if an object is unknown."""
    if len(ids) < 2:
        return ids[0] if ids else constant("")
    # By halves: databases limit the depth of an expression.
    left, right = _interned(ids[: len(ids) // 2]), _interned(ids[len(ids) // 2 :])
    return left.concat(constant(" ")).concat(right)
