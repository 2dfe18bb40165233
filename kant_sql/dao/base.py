"""Shared code of the DAOs of the SQL families: reads, results, and all that every kind has."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from decimal import Decimal
from functools import lru_cache
from itertools import islice
from typing import Any, ClassVar, Generic, TypeVar

from sqlalchemy import ColumnElement, Select, select, union_all
from typing_extensions import override

from ..arguments import expect, flag, is_many, iterate, refuse_many, shown
from ..dto import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from ..dto.actions import CLASSES, DEFAULT_DURATION
from ..dto.elements import NamedDto, trusted, trusted_object, trusted_proposition
from ..dto.formulas import Atom, Comparison, Constant, Fluent, Node, Not, Number, Timed, Variable
from ..dto.lexical import check_name, decimal_text, fold, number_text, variable_name
from ..errors import (
    ConflictError,
    InvalidArgumentError,
    InvalidKnowledgeError,
    ReadOnlyError,
    reading_rows,
    unreadable,
)
from ..html import Listing
from ..knowledge.canonical import with_text
from ..knowledge.definitions import (
    ActionDefinition,
    ActionTemplate,
    Definition,
    Definitions,
    LiteralTemplate,
)
from ..knowledge.formulas import action_of
from ..knowledge.trees import Mentioned, ParameterDefinition
from ..pddl.cursor import hint
from ..pddl.document import ACTION, EVENT, PROCESS
from ..sql.dialects.base import Row
from ..sql.intervals import then
from ..sql.query import Query, constant
from ..sql.rows import KB
from ..sql.tables import HeadRow
from ..store.snapshot import DefinitionsMovedError, View, refuse_archived
from ..store.store import Store
from ..store.transaction import Transaction
from .dependants import clear_for_redefinition, delete_mentioned
from .interfaces import AnyDao, Dao, FactLike, NamedDao, ValueLike
from .text import read_text, refuse_unknown

T = TypeVar("T")

BATCH = 5_000


class SqlDao:
    """A DAO on the present of a store, or on one past revision."""

    def __init__(self, store: Store, at: int | None = None) -> None:
        """Make a DAO."""
        self._store = store
        self._at = at

    def _check_writable(self) -> None:
        store = self._store
        if store.is_closed:
            store.refuse_closed()
        if self._at is not None:
            refuse_past(store, self._at)


def refuse_past(store: Store, at: int | None) -> None:
    """Refuse a write to a past state."""
    if at is not None:
        raise past_error(store.name, store.described(at))


def past_error(name: str, state: str) -> ReadOnlyError:
    """Make the error for a write to a past state."""
    return ReadOnlyError(
        f"this is knowledge base {name!r} as it was at {state}: "
        "the past cannot be changed; write to the knowledge base itself"
    )


def batches(items: Iterable[T], size: int = BATCH) -> Iterable[list[T]]:
    """Split an iterable into lists of a bounded length."""
    iterator = iterate(items, "what save_all takes", "an iterable of DTOs")
    while batch := list(islice(iterator, size)):
        yield batch


@contextmanager
def saving(transaction: Transaction, dtos: Iterable[Any]) -> Iterator[None]:
    """Save a batch of facts or values; look their names up at once."""
    names = (object_.name for dto in dtos for object_ in dto.objects)
    # An element without a name is refused in its turn.
    transaction.look_up("object", {name for name in names if isinstance(name, str)})
    with transaction.batch():
        yield
    transaction.spill()


Given = TypeVar("Given")


class SqlSavingDao(SqlDao, AnyDao[Any, Given]):
    """Saves and deletes elements without names (facts, values and formulas), many at a time."""

    # The name of a list of them, for messages.
    _items: ClassVar[str] = "an iterable of DTOs"

    @override
    def save(self, dto: Given | Sequence[Given]) -> bool:
        if is_many(dto):
            self.save_all(dto)
            return True
        self._check(dto)
        one: Any = dto
        self._store.write(lambda transaction: self._save_batch(transaction, [one]))
        return True

    @override
    def save_all(self, dtos: Iterable[Given]) -> int:
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(dtos):
                for dto in batch:
                    self._check(dto)
                with self._saving(transaction, batch):
                    changed += self._save_batch(transaction, batch)
        return changed

    @override
    def delete(self, dto: Given) -> bool:
        self._check_writable()
        self._check(dto)
        return self._store.write(lambda transaction: self._remove(transaction, dto))

    @override
    def delete_all(self, dtos: Iterable[Given] | None = None) -> int:
        self._check_writable()
        if dtos is None:
            return self._store.write(self._remove_all)
        removed = 0
        with self._store.transaction() as transaction:
            for dto in iterate(dtos, "what delete_all takes", self._items):
                self._check(dto)
                removed += self._remove(transaction, dto)
        return removed

    def _saving(
        self, transaction: Transaction, batch: Sequence[Given]
    ) -> AbstractContextManager[None]:
        """Open the context in which a batch is saved."""
        return nullcontext()

    @abstractmethod
    def _check(self, dto: object) -> None:
        """Refuse an argument of another class."""

    @abstractmethod
    def _save_batch(self, transaction: Transaction, dtos: Iterable[Given]) -> int:
        """Save checked DTOs, texts and nodes; return the number of changes."""

    @abstractmethod
    def _remove(self, transaction: Transaction, dto: Given) -> bool:
        """Delete the element that a DTO, a text or a node means; return whether it was stored."""

    @abstractmethod
    def _remove_all(self, transaction: Transaction) -> int:
        """Delete all; return their number."""


Ground = TypeVar("Ground", FactLike, ValueLike)


class SqlGroundDao(SqlSavingDao[Ground], Dao[Any, Ground]):
    """Writes propositions and values of functions, which apply to objects."""

    @override
    def insert(self, dto: Ground) -> bool:
        return self._save_where(dto, False)

    @override
    def update(self, dto: Ground) -> bool:
        return self._save_where(dto, True)

    def _save_where(self, dto: Ground, is_stored: bool) -> bool:
        """Save what is stored already, or what is not; return whether it was so."""
        self._check(dto)

        def save(transaction: Transaction) -> bool:
            transaction.refuse_period("insert or update", "they ask what holds now; save it")
            if self._holds(transaction, dto) != is_stored:
                return False
            self._save_batch(transaction, [dto])
            return True

        return self._store.write(save)

    def _of_named(
        self, kind: str, name: str, noun: str, answer: Callable[[View, int], list[T]]
    ) -> list[T]:
        """List the facts or values of a named element; refuse a name that never existed."""

        def read(view: View) -> list[T]:
            element = view.definitions.elements(kind).named(name)
            # Query even without one: the head may show that there is one now.
            found = answer(view, NO_ID if element is None else element.id)
            if element is None:
                refuse_unknown(self._store, name, kind)
            return found

        return Listing(self._store.read(read, self._at), noun)

    def _saving(
        self, transaction: Transaction, batch: Sequence[Ground]
    ) -> AbstractContextManager[None]:
        return saving(transaction, [dto for dto in batch if not isinstance(dto, str | Node)])

    @staticmethod
    def _refuse_all_of_past(transaction: Transaction) -> None:
        """Refuse to delete everything in a past period."""
        remedy = "name what did not hold then, as in kb.propositions.delete_all([...])"
        transaction.refuse_period("delete_all()", remedy, unless_open=True)

    @abstractmethod
    def _holds(self, transaction: Transaction, dto: Ground) -> bool:
        """Return whether it is stored."""


_Rows = Select[*tuple[Any, ...]]
# The head, read in the same statement, names the definitions that belong to the rows, and the
# archived revision. Ids begin at 1.
_HEAD_ID, NO_ID, _ARCHIVE_ID = 0, -1, -2


class Reading:
    """A query of a state, with a statement for the present and one for the past."""

    def __init__(
        self, now: _Rows, then: _Rows, *blank: ColumnElement[Any], is_of_any_state: bool = False
    ) -> None:
        """Build the statements; `blank` fills the columns of the head's rows."""
        # The state at a valid time is one state, of open versions. With `is_of_any_state`, the
        # statement of the present reads it: that of the past sorts, for which SQLite reads all
        # versions.
        head, archive = (
            select(constant(id_), column, *blank).where(HeadRow.kb_id == KB)
            for id_, column in (
                (_HEAD_ID, HeadRow.definition_revision),
                (_ARCHIVE_ID, HeadRow.archived_revision),
            )
        )
        self._now = Query(union_all(now, head))
        self._then = Query(union_all(then, head, archive))
        self._is_of_any_state = is_of_any_state

    def rows(self, view: View, **parameters: Any) -> list[Row]:
        """Run it on a state; return the rows by id."""
        if view.kb_id is None:
            return []
        query, past = self._now, {}
        if view.at is not None and not (self._is_of_any_state and view.session.overlay):
            query, past = self._then, then(view.session, view.at)
        rows = view.session.rows(query, kb=view.kb_id, **past, **parameters)
        rows.sort()
        if view.at is not None and rows and rows[0][0] == _ARCHIVE_ID:
            refuse_archived(view.session, view.kb_id, view.at, rows.pop(0)[1])
        head = rows.pop(0) if rows and rows[0][0] == _HEAD_ID else None
        if view.definition_revision not in (None, head and head[1]):
            raise DefinitionsMovedError
        return rows


class DtoBuilder:
    """Builds the DTOs of one result from the definitions read with it."""

    def __init__(self, definitions: Definitions) -> None:
        self._definitions = definitions
        self._types: dict[int, PddlTypeDto] = {}
        self._objects: dict[int, PddlObjectDto] = {}
        self._predicates: dict[int, PddlPredicateDto] = {}
        self._functions: dict[int, PddlFunctionDto] = {}

    def type(self, id_: int) -> PddlTypeDto:
        """Build a type with its supertypes."""
        types = self._types
        definition = self._definitions.types.live(id_)
        if definition.parent_id is None:
            return types.setdefault(id_, trusted(PddlTypeDto, name=definition.name, parent=None))
        pending = [] if id_ in types else [id_]
        opened: set[int] = set()
        # Supertypes first, on an explicit stack.
        while pending:
            definition = self._definitions.types.live(pending[-1])
            above = definition.parent_ids
            missing = [each for each in above if each not in types]
            if not missing:
                parent = self.types(above) if above else None
                dto = trusted(PddlTypeDto, name=definition.name, parent=parent)
                types.setdefault(pending.pop(), dto)
            elif definition.id in opened:
                error = ValueError("the type is above itself")
                raise unreadable("type_version", f"type {definition.id!r}", error) from error
            else:
                opened.add(definition.id)
                pending += missing
        return types[id_]

    def types(self, ids: Sequence[int]) -> PddlTypeDto:
        """Build one type, or an `either` of several."""
        if len(ids) == 1:
            return self._types.get(ids[0]) or self.type(ids[0])
        return PddlEitherTypeDto([self.type(id_) for id_ in ids])

    def object(self, id_: int) -> PddlObjectDto:
        """Build an object."""
        dto = self._objects.get(id_)
        if dto is None:
            definition = self._definitions.objects.live(id_)
            of = None if definition.other_type_ids else self._types.get(definition.type_id)
            dto = trusted_object(
                of or self.types(definition.type_ids), definition.name, definition.is_constant
            )
            self._objects[id_] = dto
        return dto

    def predicate(self, id_: int) -> PddlPredicateDto:
        """Build a predicate."""
        dto = self._predicates.get(id_)
        if dto is None:
            definition = self._definitions.predicates.live(id_)
            types = [self.types(parameter.type_ids) for parameter in definition.parameters]
            names = _given_names(types, definition.parameters)
            if names is None:
                own = {"name": definition.name, "types": types, "parameter_names": None}
                dto = trusted(PddlPredicateDto, **own)
            else:
                with reading_rows("predicate_version", f"predicate {id_!r}"):
                    dto = PddlPredicateDto(definition.name, types, parameter_names=names)
            self._predicates[id_] = dto
        return dto

    def function(self, id_: int) -> PddlFunctionDto:
        """Build a function."""
        dto = self._functions.get(id_)
        if dto is None:
            definition = self._definitions.functions.live(id_)
            types = [self.types(parameter.type_ids) for parameter in definition.parameters]
            dto = PddlFunctionDto(
                definition.name,
                types,
                value_types=[self.type(type_id) for type_id in definition.type_ids],
                parameter_names=_given_names(types, definition.parameters),
            )
            self._functions[id_] = dto
        return dto

    def propositions(self, rows: Iterable[Row]) -> list[PddlPropositionDto]:
        """Build propositions of rows: id, predicate, ids of the objects, whether it is a goal."""
        objects, predicates = self._objects, self._predicates
        made = []
        for _, predicate_id, arguments, is_goal in rows:
            terms = [objects.get(id_) or self.object(id_) for id_ in map(int, arguments.split())]
            predicate = predicates.get(predicate_id) or self.predicate(predicate_id)
            made.append(trusted_proposition(predicate, terms, bool(is_goal)))
        return made

    def action(self, id_: int) -> PddlActionDto:
        """Build an action."""
        definition = self._definitions.actions.live(id_)
        templates = self._definitions.templates
        template = templates.get(id_)
        if template is None or template.definition is not definition:
            with reading_rows("action_version", f"action {id_!r}"):
                template = self._template(definition)
                _check_action(self._of_template(template))
            templates[id_] = template
        return self._of_template(template)

    def _of_template(self, template: ActionTemplate) -> PddlActionDto:
        name, kind = template.definition.name, template.definition.kind
        parameters = [
            trusted_object(self.types(parameter.type_ids), parameter.name, False)
            for parameter in template.definition.parameters
        ]
        conditions, effects = (
            [
                self._literal(part, parameters) if isinstance(part, LiteralTemplate) else part
                for part in parts
            ]
            for parts in (template.conditions, template.effects)
        )
        duration = template.duration
        return trusted(
            CLASSES.get(kind, PddlActionDto),
            name=name,
            parameters=parameters,
            conditions=conditions,
            effects=effects,
            durative=_is_durative(kind),
            duration=list(duration) if isinstance(duration, tuple) else duration,
        )

    def _literal(
        self, template: LiteralTemplate, parameters: Sequence[PddlObjectDto]
    ) -> PddlConditionEffectDto:
        terms = [parameters[~one] if one < 0 else self.object(one) for one in template.terms]
        return trusted(
            PddlConditionEffectDto,
            predicate=self.predicate(template.predicate_id),
            objects=terms,
            time=template.time,
            is_negative=template.is_negative,
        )

    def _template(self, definition: ActionDefinition) -> ActionTemplate:
        read = action_of(self._definitions, definition)
        # If parameters share a name, it means the last one.
        places = {
            fold(parameter.name): ~place for place, parameter in enumerate(definition.parameters)
        }
        return ActionTemplate(
            definition,
            _duration(read.duration) if _is_durative(definition.kind) else DEFAULT_DURATION,
            tuple(self._literal_template(formula, places) or formula for formula in read.condition),
            tuple(self._literal_template(formula, places) or formula for formula in read.effect),
        )

    def _literal_template(self, formula: Node, places: dict[str, int]) -> LiteralTemplate | None:
        """Return the literal that a formula is, if a DTO of the paper can express it."""
        time = formula.time if isinstance(formula, Timed) else None
        inner = formula.formula if isinstance(formula, Timed) else formula
        atom = inner.formula if isinstance(inner, Not) else inner
        if not isinstance(atom, Atom) or any(isinstance(term, Fluent) for term in atom.terms):
            return None
        objects = self._definitions.objects
        terms = []
        for term in atom.terms:
            if isinstance(term, Variable):
                terms.append(places[fold(term.name)])
            elif isinstance(term, Constant) and (found := objects.named(term.name)):
                if fold(term.name) in places:
                    return None
                terms.append(found.id)
        predicate = self._definitions.predicates.named(atom.predicate)
        assert predicate is not None
        return LiteralTemplate(predicate.id, tuple(terms), time, isinstance(inner, Not))


def _is_durative(kind: str) -> bool:
    return kind not in (ACTION, PROCESS, EVENT)


def _check_action(dto: PddlActionDto) -> None:
    """Refuse an action that no constructor would accept."""
    for parameter in dto.parameters:
        parameter.set_name(parameter.name)
    dto.set_conditions(dto.conditions)
    dto.set_effects(dto.effects)
    dto.set_duration(dto.duration)


def _given_names(
    types: Iterable[PddlTypeDto], parameters: Iterable[ParameterDefinition]
) -> list[str] | None:
    """Return the names of parameters, unless they are the default names."""
    names = tuple([parameter.name for parameter in parameters])
    is_derived = names == _derived_names(tuple([type_.name for type_ in types]))
    return None if is_derived else list(names)


@lru_cache(maxsize=4096)
def _derived_names(types: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(variable_name(name, position) for position, name in enumerate(types))


def _duration(constraints: Sequence[Node]) -> int | float | Decimal | tuple[Node, ...]:
    """Return a duration fixed by a number as that number, as in the paper's DTO."""
    match constraints:
        case [Comparison("=", Variable("duration"), Number(value))]:
            text = decimal_text(value)
            exact: int | float = float(text) if "." in text else int(text)
            return exact if number_text(exact) == text else value
    return tuple(constraints)


D = TypeVar("D", bound=NamedDto)
F = TypeVar("F", bound=Definition)


def identify(transaction: Transaction, kind: str, name: str) -> tuple[int, str]:
    """Find the id and the first spelling of a name; make a missing identity."""
    live = transaction.definitions.elements(kind).named(name)
    return transaction.intern(kind, name) if live is None else (live.id, live.name)


_REDEFINING: ContextVar[bool] = ContextVar("kant_sql_redefining", default=False)


@contextmanager
def redefining_references() -> Iterator[None]:
    """Let references redefine unused elements, as the original library does."""
    # Two references within one element may contradict each other, so save it again afterwards.
    token = _REDEFINING.set(True)
    try:
        yield
    finally:
        _REDEFINING.reset(token)


class Definer(ABC, Generic[D, F]):
    """Defines the elements of one kind in a transaction from their DTOs."""

    kind: ClassVar[str]
    dto_class: type[D]

    def ensure(self, transaction: Transaction, dto: D | str, role: str) -> F:
        """Find the element that another one refers to; save it from its DTO if it is missing."""
        if isinstance(dto, str):
            return self._known(transaction, dto, role)
        reference, agreements = self._reference(dto), transaction.agreements
        found: Any = agreements.known.get(reference) or agreements.new.get(reference)
        if found is None:
            expect(dto, self.dto_class, f"the {self.kind} of {role}")
            found = self._find(transaction, dto, role)
            if reference is not None:
                agreements.new[reference] = found
        return found  # type: ignore[no-any-return]

    def _known(self, transaction: Transaction, name: str, role: str) -> F:
        """Find the element that another one refers to by name alone."""
        found: F | None = transaction.definitions.elements(self.kind).named(name)
        if found is None:
            names = [each.name for each in transaction.definitions.elements(self.kind)]
            raise InvalidKnowledgeError(
                f"{role} refers to {self.kind} {shown(name)}, which is not known"
                f"{hint(name, names)}; save it first, or give a "
                f"{self.dto_class.__name__}"
            )
        return found

    def _find(self, transaction: Transaction, dto: D, role: str) -> F:
        """Find an element whose reference was not compared yet; save it if it is missing."""
        stored: F | None = transaction.definitions.elements(self.kind).named(dto.name)
        if stored is None:
            return self._define(transaction, dto, False)[0]
        return self.check(transaction, dto, stored, role)

    def check(self, transaction: Transaction, dto: D, stored: F, role: str) -> F:
        """Return the element of a reference; refuse one that differs from the stored definition."""
        if not self._agrees(transaction, dto, stored):
            if _REDEFINING.get():
                return self._define(transaction, dto, False)[0]
            raise ConflictError(
                f"{self.kind} {dto.name!r} is stored as {_quoted(stored.text)}, but {role} refers "
                f"to it as {_quoted(str(dto))}; use the stored definition, or save the {self.kind} "
                "itself to redefine it"
            )
        return stored

    def put(self, transaction: Transaction, dto: D, cascade: bool) -> bool:
        """Insert or redefine an element; return whether it changed."""
        return self._define(transaction, dto, cascade)[1]

    def scope(self, definitions: Definitions, ids: Collection[int]) -> Mentioned:
        """Find the elements that are defined in terms of the given ones, including these."""
        return Mentioned(**{f"{self.kind}s": {*ids}})

    def _define(self, transaction: Transaction, dto: D, cascade: bool) -> tuple[F, bool]:
        """Define an element; the supertypes of a type are known."""
        check_name(self._name_kind(dto), dto.name)
        stored: F | None = transaction.definitions.elements(self.kind).named(dto.name)
        made = with_text(transaction.definitions, self._make(transaction, dto, stored))
        if stored is not None and not self._keeps(stored, made):
            clear_for_redefinition(
                transaction,
                self.scope(transaction.definitions, [made.id]),
                f"{self.kind} {stored.text}",
                _quoted(made.text),
                cascade,
            )
        return made, transaction.define(self.kind, made)

    def _identity(self, transaction: Transaction, dto: D, stored: F | None) -> tuple[int, str]:
        """Find the id and the first spelling of the name."""
        if stored is None:
            return transaction.intern(self.kind, dto.name)
        return stored.id, stored.name

    def _name_kind(self, dto: D) -> str:
        """Return the kind of name that the element has."""
        return self.kind

    def _reference(self, dto: D) -> Hashable:
        """Return all that `_agrees` compares, if the DTO has the plainest form; else None."""
        return None

    @abstractmethod
    def _make(self, transaction: Transaction, dto: D, stored: F | None) -> F:
        """Make the definition, without its text; save missing elements that it refers to."""

    @abstractmethod
    def _keeps(self, stored: F, made: F) -> bool:
        """Return whether all dependants of the stored definition also fit another one."""

    @abstractmethod
    def _agrees(self, transaction: Transaction, dto: D, stored: F) -> bool:
        """Return whether a DTO in a reference agrees with the stored definition."""


def _quoted(text: str) -> str:
    return text if text.startswith("(") else f"'{text}'"


# Characters that no name has, but every text of more than a name.
_TEXT = re.compile(r"[\s();]")


class SqlNamedDao(SqlDao, NamedDao[D]):
    """Reads, saves and deletes one kind of named element."""

    kind: ClassVar[str]
    dto_class: type[D]
    # Reads the text of an element; `_needs_names`: it uses names that must be known.
    _reads: ClassVar[Callable[..., Any]]
    _needs_names: ClassVar[bool] = False
    definer: ClassVar[Definer[Any, Any]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "definer" in vars(cls):
            cls.kind, cls.dto_class = cls.definer.kind, cls.definer.dto_class

    @override
    def get(self, name: str) -> D | None:
        def find(definitions: Definitions) -> D | None:
            definition = self._named(definitions, name)
            return None if definition is None else self._build(DtoBuilder(definitions), definition)

        return self._store.read_definitions(find, self._at)

    @override
    def get_all(self) -> list[D]:
        def build(definitions: Definitions) -> list[D]:
            builder = DtoBuilder(definitions)
            return [self._build(builder, definition) for definition in self._all(definitions)]

        return Listing(self._store.read_definitions(build, self._at), "element")

    @override
    def save(self, dto: D | str | Sequence[D | str], *, cascade: bool = False) -> bool:
        flag(cascade, "cascade", InvalidArgumentError)
        if is_many(dto):
            self._save_many(dto, cascade)
            return True
        one: Any = dto
        self._check(one)

        def save(transaction: Transaction) -> bool:
            return self._put(transaction, self._dto(transaction, one), cascade)

        self._store.write(save)
        return True

    @override
    def insert(self, dto: D | str) -> bool:
        return self._save_where(dto, False, False)

    @override
    def update(self, dto: D | str, *, cascade: bool = False) -> bool:
        return self._save_where(dto, True, cascade)

    def _save_where(self, given: D | str, is_stored: bool, cascade: bool) -> bool:
        """Save what is stored already, or what is not; return whether it was so."""
        self._check(given)
        flag(cascade, "cascade", InvalidArgumentError)

        def save(transaction: Transaction) -> bool:
            dto = self._dto(transaction, given)
            stored = self._named(transaction.definitions, dto.name)
            if (stored is not None) != is_stored:
                return False
            self._put(transaction, dto, cascade)
            return True

        return self._store.write(save)

    @override
    def save_all(self, dtos: Iterable[D | str]) -> int:
        return self._save_many(dtos, False)

    def _save_many(self, given: Iterable[D | str], cascade: bool) -> int:
        self._check_writable()
        changed = 0
        with self._store.transaction() as transaction:
            for batch in batches(given):
                for each in batch:
                    self._check(each)
                dtos = [self._dto(transaction, each) for each in batch]
                transaction.look_up(self.kind, (dto.name for dto in dtos))
                with transaction.batch():
                    changed += sum(self._put(transaction, dto, cascade) for dto in dtos)
        return changed

    @override
    def delete(self, dto: D | str) -> bool:
        if not isinstance(dto, str):
            self._check(dto)
        return self.delete_all([dto]) > 0

    @override
    def delete_all(self, dtos: Iterable[D | str] | None = None) -> int:
        self._check_writable()
        given = None
        if dtos is not None:
            given = [*iterate(dtos, "what delete_all takes", "an iterable of DTOs and names")]
            for each in given:
                self._check(each)
        return self._store.write(lambda transaction: self._delete(transaction, given))

    def _delete(self, transaction: Transaction, given: Iterable[D | str] | None) -> int:
        """Delete some elements, or all; return their number."""
        definitions = transaction.definitions
        if given is None:
            found = self._all(definitions)
        else:
            found = [self._named(definitions, self._name(each)) for each in given]
        ids = {definition.id for definition in found if definition is not None}
        if ids:
            self._remove(transaction, list(ids))
        return len(ids)

    def _name(self, given: D | str) -> str:
        """Return the name of the element to delete."""
        if not isinstance(given, str):
            return given.name
        name = given.strip()
        if _TEXT.search(name) is None:
            return name
        # Only the name counts: other names in it may be gone.
        found = self._reads(name)
        self._check(found)
        return str(found.name)

    def _dto(self, transaction: Transaction, given: D | str) -> D:
        """Return a DTO, which may be given as text."""
        if not isinstance(given, str):
            return given
        dto: D = read_text(transaction, self._reads, given, needs_names=self._needs_names)
        self._check(dto)
        return dto

    def _check(self, dto: object) -> None:
        self._check_writable()
        if not isinstance(dto, str):
            refuse_many(dto)
            expected = f"a {self.dto_class.__name__}, or its text"
            role = f"what the {self.kind} DAO takes"
            expect(dto, self.dto_class, role, expected=expected)

    def _named(self, definitions: Definitions, name: str) -> Any:
        definition = definitions.elements(self.kind).named(name)
        return definition if definition is not None and self._is_mine(definition) else None

    def _all(self, definitions: Definitions) -> list[Any]:
        return [each for each in definitions.elements(self.kind) if self._is_mine(each)]

    def _is_mine(self, definition: Any) -> bool:
        """Return whether a definition belongs to this DAO."""
        return True

    def _build(self, builder: DtoBuilder, definition: Any) -> D:
        dto: D = getattr(builder, self.kind)(definition.id)
        return dto

    def _put(self, transaction: Transaction, dto: D, cascade: bool) -> bool:
        return self.definer.put(transaction, dto, cascade)

    def _remove(self, transaction: Transaction, ids: list[int]) -> None:
        delete_mentioned(transaction, self.definer.scope(transaction.definitions, ids))
