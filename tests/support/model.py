"""A plain Python model of a knowledge base: the answers of every store, without their means.

It follows `kant_sql/dao/interfaces.py` as simply as possible: a state is a few dictionaries, a
transaction copies them, and each revision is stored whole. `Model` has the interface of a
`KnowledgeBase`, so one program runs on both.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from kant_sql import (
    ConflictError,
    DependantsError,
    InvalidKnowledgeError,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    ReadOnlyError,
    StaleRevisionError,
    UnknownNameError,
    UnknownRevisionError,
)
from kant_sql.errors import ArityError, InvalidNameError, TypeCycleError, TypeMismatchError
from tests.support.worlds.robots import literals

ROOT = "object"
TIMES: set[str | None] = {"at start", "over all", "at end"}
RESERVED = {
    "type": {"either"},
    "predicate": {
        *("and", "or", "not", "imply", "forall", "exists", "when"),
        *("=", "<", "<=", ">=", ">"),
    },
}


def fold(name: str) -> str:
    """Return the key of a name: names that PDDL treats as equal have the same one."""
    return unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


UNSEEN = frozenset(
    chr(code)
    for first, last in (
        *((0x34F, 0x34F), (0x115F, 0x1160), (0x17B4, 0x17B5), (0x180B, 0x180D), (0x180F, 0x180F)),
        *((0x2800, 0x2800), (0x3164, 0x3164), (0xFE00, 0xFE0F), (0xFFA0, 0xFFA0)),
        *((0x16FE4, 0x16FE4), (0x1D159, 0x1D159), (0xE0100, 0xE01EF)),
    )
    for code in range(first, last + 1)
)


def reads_as_number(name: str) -> bool:
    """`#t` is the passing time; other words are numbers if Python reads them as such, in ASCII."""
    if name in ("#t", "#T"):
        return True
    try:
        float(name)
    except ValueError:
        return False
    return set(name) <= set("0123456789+-.eE")


def check_name(kind: str, name: str) -> None:
    """Refuse a name that PDDL text cannot contain."""
    if (
        not 1 <= len(name) <= 255
        or name == "-"
        or name.startswith(":")
        or fold(name) in RESERVED.get(kind, ())
        or (kind in ("type", "object") and (name[0] == "-" or reads_as_number(name)))
        or unicodedata.category(name[0]).startswith("M")
        or not UNSEEN.isdisjoint(name)
        or any(sign.isspace() or sign in "();?\"'`" for sign in name)
        or any(unicodedata.category(sign) in ("Cc", "Cf", "Cs", "Co", "Cn") for sign in name)
    ):
        raise InvalidNameError(repr(name))


class Atom(NamedTuple):
    is_goal: bool
    predicate: str
    arguments: tuple[str, ...]


class Literal(NamedTuple):
    """A term is the position of a parameter, or the key of a constant."""

    predicate: str
    terms: tuple[int | str, ...]
    time: str | None
    is_negative: bool


class Action(NamedTuple):
    """A parameter is its name, as spelt, and the key of its type; a duration is its text."""

    parameters: tuple[tuple[str, str], ...]
    conditions: tuple[Literal, ...]
    effects: tuple[Literal, ...]
    duration: str | None


class Scope(NamedTuple):
    """The elements that a redefinition or a deletion affects, by keys."""

    type: Collection[str] = ()
    object: Collection[str] = ()
    predicate: Collection[str] = ()


class ModelState:
    """The state: type -> parent, object -> type, predicate -> types, action -> `Action`, atoms.

    `known` has every name that was ever known, in its first spelling, oldest first.
    """

    def __init__(self, origin: ModelState | None = None) -> None:
        kinds = ("type", "object", "predicate", "action", "atom")
        self.held: dict[str, dict[Any, Any]] = {kind: {} for kind in kinds}
        self.known: dict[str, dict[Any, str]] = {kind: {} for kind in kinds}
        if origin is not None:
            self.held = {kind: dict(part) for kind, part in origin.held.items()}
            self.known = {kind: dict(part) for kind, part in origin.known.items()}

    # Saving: `define` defines the element of a DTO, `refer` finds the element that one refers to.

    def define(self, kind: str, dto: Any, cascade: bool = False) -> bool:
        """Define an element; return whether that is a change."""
        if kind == "atom":
            value, name = None, ""
            key: Any = self._atom(dto)
        else:
            check_name(kind, dto.name)
            value, name = getattr(self, f"_{kind}")(dto), dto.name
            key = fold(name)
            if kind != "action" and self.held[kind].get(key, value) != value:
                self._check_cycle(kind, key, value)
                scope = self.below({key}) if kind == "type" else Scope(**{kind: {key}})
                self._clear(scope, cascade)
        changes = key not in self.held[kind] or self.held[kind][key] != value
        self.known[kind].setdefault(key, name)
        self.held[kind][key] = value
        return changes

    def refer(self, kind: str, dto: Any) -> str:
        """Find an element, or save a missing one; an existing one must agree."""
        key = fold(dto.name)
        if kind == "type":
            self._refer_from_the_top(dto)
        elif key not in self.held[kind]:
            self.define(kind, dto)
        elif kind == "object":
            if self.held["object"][key] != fold(dto.type.name):
                raise ConflictError
            self.refer("type", dto.type)
        else:
            if self.held["predicate"][key] != tuple(fold(type_.name) for type_ in dto.types):
                raise ConflictError
            for type_ in dto.types:
                self.refer("type", type_)
        return key

    def _refer_from_the_top(self, dto: PddlTypeDto) -> None:
        """Check a parent only if it is given; types without a parent are under the root."""
        self._check_chain(dto)
        chain, above = [dto], dto.parent
        while above is not None and (above.parent is not None or chain[-1] not in self):
            chain.append(above)
            above = above.parent
        for type_ in reversed(chain):
            key = fold(type_.name)
            if type_ not in self:
                self.define("type", type_)
            elif type_.parent is not None and (self.held["type"][key] or ROOT) != fold(
                type_.parent.name
            ):
                raise ConflictError

    def __contains__(self, dto: PddlTypeDto) -> bool:
        return fold(dto.name) in self.held["type"]

    @staticmethod
    def _check_chain(dto: PddlTypeDto) -> None:
        above: PddlTypeDto | None = dto
        seen: list[str] = []
        while above is not None:
            if fold(above.name) in seen:
                raise TypeCycleError
            if fold(above.name) == ROOT and above.parent is not None:
                raise InvalidKnowledgeError
            seen.append(fold(above.name))
            above = above.parent

    def _type(self, dto: PddlTypeDto) -> str | None:
        self._check_chain(dto)
        return None if dto.parent is None else self.refer("type", dto.parent)

    def _object(self, dto: PddlObjectDto) -> str:
        return self.refer("type", dto.type)

    def _predicate(self, dto: PddlPredicateDto) -> tuple[str, ...]:
        if len(dto.types) > 100:
            raise ArityError
        return tuple([self.refer("type", type_) for type_ in dto.types])

    def _atom(self, dto: PddlPropositionDto) -> Atom:
        predicate = self.refer("predicate", dto.predicate)
        wanted = self.held["predicate"][predicate]
        if len(dto.objects) != len(wanted):
            raise ArityError
        for object_, type_ in zip(dto.objects, wanted, strict=True):
            if not self._fits(self.held["object"][self.refer("object", object_)], type_):
                raise TypeMismatchError
        return atom_of(dto)

    def _action(self, dto: PddlActionDto) -> Action:
        duration = dto.duration if dto.durative else 0
        assert isinstance(duration, int | float), "the programs give numbers only"
        if isinstance(duration, bool) or not 0 <= duration < float("inf"):
            raise InvalidKnowledgeError
        parameters: dict[str, tuple[str, str]] = {}
        for parameter in dto.parameters:
            check_name("parameter", parameter.name)
            if fold(parameter.name) in parameters:
                raise InvalidKnowledgeError
            type_ = self.refer("type", parameter.type)
            parameters[fold(parameter.name)] = (parameter.name, type_)
        conditions, effects = (
            tuple([self._literal(each, times, parameters) for each in literals(part)])
            for part, times in (
                (dto.conditions, TIMES if dto.durative else {None}),
                (dto.effects, TIMES - {"over all"} if dto.durative else {None}),
            )
        )
        text = str(duration) if dto.durative else None
        return Action(tuple(parameters.values()), conditions, effects, text)

    def _literal(
        self,
        dto: PddlConditionEffectDto,
        times: Collection[str | None],
        parameters: dict[str, tuple[str, str]],
    ) -> Literal:
        if dto.time not in times:
            raise InvalidKnowledgeError
        predicate = self.refer("predicate", dto.predicate)
        wanted = self.held["predicate"][predicate]
        if len(dto.objects) != len(wanted):
            raise ArityError
        terms = []
        for object_, type_ in zip(dto.objects, wanted, strict=True):
            term, own = self._term(object_, parameters)
            if not self._fits(own, type_):
                raise TypeMismatchError
            terms.append(term)
        return Literal(predicate, tuple(terms), dto.time, dto.is_negative)

    def _term(
        self, dto: PddlObjectDto, parameters: dict[str, tuple[str, str]]
    ) -> tuple[int | str, str]:
        key = fold(dto.name)
        if key in parameters:
            if fold(dto.type.name) != parameters[key][1]:
                raise TypeMismatchError
            return [*parameters].index(key), self.refer("type", dto.type)
        if key not in self.held["object"]:
            raise InvalidKnowledgeError
        return key, self.held["object"][self.refer("object", dto)]

    def _fits(self, type_: str, wanted: str) -> bool:
        return wanted == ROOT or wanted in self._ancestry(type_)

    def _ancestry(self, type_: str | None) -> Iterator[str]:
        while type_ is not None:
            yield type_
            type_ = self.held["type"][type_]

    def _check_cycle(self, kind: str, key: str, value: Any) -> None:
        if kind == "type" and key in self._ancestry(value):
            raise TypeCycleError

    # Dependencies.

    def below(self, types: Collection[str]) -> Scope:
        """Return the types with their subtypes, and the definitions that mention them."""
        found = {each for each in self.held["type"] if {*types} & {*self._ancestry(each)}}
        return Scope(
            found,
            {key for key, type_ in self.held["object"].items() if type_ in found},
            {key for key, listed in self.held["predicate"].items() if {*listed} & found},
        )

    def _clear(self, scope: Scope, cascade: bool) -> None:
        """Make way for a redefinition: facts, goals and actions depend on what they mention."""
        atoms = [
            atom
            for atom in self.held["atom"]
            if atom.predicate in scope.predicate or {*atom.arguments} & {*scope.object}
        ]
        actions = [
            key
            for key, action in self.held["action"].items()
            if any(type_ in scope.type for _, type_ in action.parameters)
            or any(
                literal.predicate in scope.predicate or {*literal.terms} & {*scope.object}
                for literal in (*action.conditions, *action.effects)
            )
        ]
        if (atoms or actions) and not cascade:
            raise DependantsError("", [])
        self._forget("atom", atoms)
        self._forget("action", actions)

    def remove(self, kind: str, keys: Collection[Any]) -> None:
        """Delete elements, and all elements that depend on them."""
        if kind in ("atom", "action"):
            self._forget(kind, keys)
        else:
            scope = self.below(keys) if kind == "type" else Scope(**{kind: keys})
            self._clear(scope, cascade=True)
            for each, gone in scope._asdict().items():
                self._forget(each, gone)

    def _forget(self, kind: str, keys: Iterable[Any]) -> None:
        for key in list(keys):
            del self.held[kind][key]


def atom_of(dto: PddlPropositionDto) -> Atom:
    arguments = tuple(fold(object_.name) for object_ in dto.objects)
    return Atom(dto.is_goal, fold(dto.predicate.name), arguments)


def key_of(kind: str, dto: Any) -> Any:
    """Return the identity of an element."""
    return atom_of(dto) if kind == "atom" else fold(dto.name)


def dto_of(state: ModelState, kind: str, key: Any) -> Any:
    name, value = state.known[kind][key], state.held[kind][key]
    if kind == "type":
        return PddlTypeDto(name, parent=None if value is None else dto_of(state, "type", value))
    if kind == "object":
        return PddlObjectDto(dto_of(state, "type", value), name)
    if kind == "predicate":
        return PddlPredicateDto(name, [dto_of(state, "type", type_) for type_ in value])
    if kind == "atom":
        predicate = dto_of(state, "predicate", key.predicate)
        objects = [dto_of(state, "object", object_) for object_ in key.arguments]
        return PddlPropositionDto(predicate, objects, key.is_goal)
    return _action_dto(state, name, value)


def _action_dto(state: ModelState, name: str, action: Action) -> PddlActionDto:
    parameters = [
        PddlObjectDto(dto_of(state, "type", type_), own) for own, type_ in action.parameters
    ]
    conditions, effects = (
        [
            PddlConditionEffectDto(
                dto_of(state, "predicate", literal.predicate),
                [
                    parameters[term] if isinstance(term, int) else dto_of(state, "object", term)
                    for term in literal.terms
                ],
                literal.time,
                literal.is_negative,
            )
            for literal in part
        ]
        for part in (action.conditions, action.effects)
    )
    text = action.duration
    if text is None:
        return PddlActionDto(name, parameters, conditions, effects, durative=False)
    duration = float(text) if "." in text else int(text)
    return PddlActionDto(name, parameters, conditions, effects, duration=duration)


def lines_of(state: ModelState) -> dict[tuple[str, Any], tuple[str, str]]:
    """Return the kind and the PDDL text of each element that holds."""
    return {
        (kind, key): (
            kind if kind != "atom" else "goal" if key.is_goal else "fact",
            str(dto_of(state, kind, key)),
        )
        for kind, part in state.held.items()
        for key in part
    }


class ModelDao:
    def __init__(self, model: Model, kind: str) -> None:
        self._model = model
        self._kind = kind

    def get(self, name: str) -> Any:
        state = self._model.state
        key = fold(name)
        return dto_of(state, self._kind, key) if key in state.held[self._kind] else None

    def get_all(self) -> list[Any]:
        state, kind = self._model.state, self._kind
        keys = [key for key in state.known[kind] if key in state.held[kind]]
        if kind == "atom":
            keys.sort(key=lambda key: key.is_goal)
        return [dto_of(state, kind, key) for key in keys]

    def get_by_predicate(self, name: str) -> list[Any]:
        if fold(name) not in self._model.state.known["predicate"]:
            raise UnknownNameError(name)
        return [dto for dto in self.get_all() if fold(dto.predicate.name) == fold(name)]

    def get_goals(self) -> list[Any]:
        return [dto for dto in self.get_all() if dto.is_goal]

    def get_no_goals(self) -> list[Any]:
        return [dto for dto in self.get_all() if not dto.is_goal]

    def save(self, dto: Any, **options: Any) -> bool:
        with self._model.transaction() as state:
            state.define(self._kind, dto, **options)
        return True

    def insert(self, dto: Any) -> bool:
        return not self._is_there(dto) and self.save(dto)

    def update(self, dto: Any, **options: Any) -> bool:
        return self._is_there(dto) and self.save(dto, **options)

    def save_all(self, dtos: Iterable[Any]) -> int:
        with self._model.transaction() as state:
            return sum(state.define(self._kind, dto) for dto in dtos)

    def delete(self, dto: Any) -> bool:
        if not self._is_there(dto):
            return False
        with self._model.transaction() as state:
            state.remove(self._kind, {key_of(self._kind, dto)})
        return True

    def delete_all(self) -> int:
        with self._model.transaction() as state:
            count = len(state.held[self._kind])
            state.remove(self._kind, set(state.held[self._kind]))
        return count

    def _is_there(self, dto: Any) -> bool:
        self._model.check_writable()
        return key_of(self._kind, dto) in self._model.state.held[self._kind]


class Model:
    """A knowledge base, at its head or at an earlier revision."""

    def __init__(self, states: list[ModelState] | None = None) -> None:
        self._is_past = states is not None
        self._states = states or [ModelState()]
        self._log: list[list[tuple[str, str, str]]] = []
        self._depth = 0
        self.state = ModelState(self._states[-1])
        self.types, self.objects, self.predicates, self.actions, self.propositions = (
            ModelDao(self, kind) for kind in ("type", "object", "predicate", "action", "atom")
        )

    @property
    def revision(self) -> int:
        return len(self._states) - 1

    def changes(self) -> list[list[tuple[str, str, str]]]:
        """Return the changes of each revision, oldest first."""
        return self._log

    def at(self, revision: int) -> Model:
        if not 0 <= revision <= self.revision:
            raise UnknownRevisionError
        return Model(self._states[: revision + 1])

    def check_writable(self) -> None:
        if self._is_past:
            raise ReadOnlyError

    @contextmanager
    def transaction(self, expected_revision: int | None = None) -> Iterator[ModelState]:
        self.check_writable()
        if expected_revision not in (None, self.revision):
            raise StaleRevisionError("", expected_revision or 0, self.revision)
        before, self.state = self.state, ModelState(self.state)
        self._depth += 1
        try:
            yield self.state
        except BaseException:
            self.state = before
            raise
        finally:
            self._depth -= 1
        if self._depth == 0:
            self._commit()

    def _commit(self) -> None:
        before, now = lines_of(self._states[-1]), lines_of(self.state)
        changes = [("-", *line) for key, line in before.items() if now.get(key) != line]
        changes += [("+", *line) for key, line in now.items() if before.get(key) != line]
        if changes:
            self._states.append(ModelState(self.state))
            self._log.append(sorted(changes))
        else:
            # A transaction that changed nothing leaves no trace.
            self.state = ModelState(self._states[-1])
