"""Loading documents into a store."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

from ..dao.action import action_trees, put_action
from ..dao.base import batches, identify
from ..dao.dependants import (
    Scope,
    delete_scope,
    function_values_on,
    propositions_on,
    retract,
    retract_function_values,
)
from ..dao.formula import is_ground, make_formula, read_formula, read_formulas
from ..dao.interfaces import Progress
from ..dao.predicate import same_types
from ..dto.formulas import Atom, Constant, Node, Not, Number, TypedName
from ..dto.lexical import ROOT_TYPE, decimal_text, fold
from ..errors import ConflictError, InvalidKnowledgeError
from ..knowledge.canonical import with_text
from ..knowledge.definitions import (
    CONSTRAINT,
    DERIVED_PREDICATE,
    DOMAIN,
    DOMAIN_CONSTRAINT,
    DOMAIN_SECTIONS,
    GOAL,
    INITIAL,
    METRIC,
    PROBLEM,
    PROBLEM_SECTIONS,
    TIMED,
    Definition,
    Definitions,
    FormulaDefinition,
    FunctionDefinition,
    Item,
    ObjectDefinition,
    PredicateDefinition,
    TypeDefinition,
    formula_name,
)
from ..knowledge.trees import ParameterDefinition
from ..pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from ..store.caches import AtomKey, FluentKey, FluentValue, GroundAtom, HeldValue
from ..store.transaction import Transaction
from .build import check_title, constant_ids, find_document, put_document

_NAME = attrgetter("name")


class _Head(NamedTuple):
    """A predicate or a function: its id, and the name that its declaration gives it."""

    id: int
    name: str


class Named(NamedTuple):
    """Ground atoms as the store knows them.

    Attributes:
        texts: what makes each the one that it is, with its canonical PDDL text.
        old: those that may have been known before; the others mention what is new.
    """

    texts: dict[AtomKey, str]
    old: list[AtomKey]


class NamedValues(NamedTuple):
    """Fluents and their values as the store knows them.

    Attributes:
        entries: what makes each fluent the one that it is, its canonical PDDL text without the
            value, and the value.
        old: those that may have been known before; the others mention what is new.
    """

    entries: list[tuple[FluentKey, str, FluentValue]]
    old: list[FluentKey]


class NameResolver:
    """From names in a consistent document to ids; a document has each name in one spelling."""

    def __init__(self, transaction: Transaction) -> None:
        """Make it for one problem, whose objects are defined by now."""
        definitions, next_id = transaction.definitions, transaction.head.next_id
        self._definitions: Definitions = definitions
        self._predicates: dict[str, _Head] = {}
        self._functions: dict[str, _Head] = {}
        # By the address of a number, which the document keeps: equal numbers may be spelled apart.
        self._numbers: dict[int, FluentValue] = {}
        self._ids = {object_.name: str(object_.id) for object_ in definitions.objects}
        # The objects of which nothing can be known yet, for they are new themselves.
        self._new: frozenset[str] = frozenset()
        if transaction.is_stateless:
            self._new = frozenset(id_ for id_ in self._ids.values() if int(id_) >= next_id)

    def atoms(self, atoms: Iterable[Atom], is_goal: bool) -> Named:
        """Find what makes ground atoms the ones that they are."""
        texts: dict[AtomKey, str] = {}
        old: list[AtomKey] = []
        is_old, find = self._new.isdisjoint, self._arguments
        for atom in atoms:
            head = self._predicates.get(atom.predicate) or self._predicate(atom.predicate)
            ids, names = find(atom.terms)
            key = AtomKey(is_goal, head.id, " ".join(ids))
            texts[key] = f"({head.name} {' '.join(names)})" if names else f"({head.name})"
            # A document has each fact once, but maybe not each goal.
            if is_goal or is_old(ids):
                old.append(key)
        return Named(texts, old)

    def values(self, values: Iterable[FunctionValue]) -> NamedValues:
        """Find what makes fluents the ones that they are."""
        made = NamedValues([], [])
        for fluent, value in values:
            head = self._functions.get(fluent.function) or self._function(fluent.function)
            ids, names = self._arguments(fluent.terms)
            text = f"({head.name} {' '.join(names)})" if names else f"({head.name})"
            held = self._numbers.get(id(value)) or self._value(value)
            key = FluentKey(head.id, " ".join(ids))
            made.entries.append((key, text, held))
            if self._new.isdisjoint(ids):
                made.old.append(key)
        return made

    def _arguments(self, terms: Sequence[object]) -> tuple[list[str], list[str]]:
        names: list[str] = [*map(_NAME, terms)]
        try:
            return [*map(self._ids.__getitem__, names)], names
        except KeyError:
            # The store had the object before, in another spelling.
            found = [self._object(name) for name in names]
            return [id_ for id_, _ in found], [name for _, name in found]

    def _object(self, name: str) -> tuple[str, str]:
        object_ = self._definitions.objects.named(name)
        assert object_ is not None
        return str(object_.id), object_.name

    def _predicate(self, name: str) -> _Head:
        predicate = self._definitions.predicates.named(name)
        assert predicate is not None
        head = self._predicates[name] = _Head(predicate.id, predicate.name)
        return head

    def _function(self, name: str) -> _Head:
        function = self._definitions.functions.named(name)
        assert function is not None
        head = self._functions[name] = _Head(function.id, function.name)
        return head

    def _value(self, value: Number | Constant) -> FluentValue:
        if isinstance(value, Constant):
            id_, name = self._object(value.name)
            return FluentValue(name, int(id_))
        held = self._numbers[id(value)] = FluentValue(decimal_text(value.value))
        return held


_REMEDY = "load it with mode='replace', or make the two agree"


def refuse_contradictions(
    transaction: Transaction,
    names: NameResolver,
    problem: Problem,
    values: Collection[tuple[FluentKey, str, FluentValue]],
) -> None:
    """Refuse a problem whose initial state contradicts what is stored."""
    _refuse_values(transaction, values)
    denied = [
        literal.formula
        for literal in problem.literals
        if isinstance(literal, Not) and isinstance(literal.formula, Atom)
    ]
    propositions = transaction.propositions
    found = propositions.find(names.atoms(denied, False).texts)
    propositions.load(found.values())
    for atom in found.values():
        if propositions.holds(atom):
            raise ConflictError(
                f"{atom.text} is stored, but the document has (not {atom.text}); {_REMEDY}"
            )
    formulas = transaction.definitions.formulas
    if any(formula.section == INITIAL for formula in formulas):
        for text in names.atoms(problem.facts, False).texts.values():
            if formulas.named(formula_name(INITIAL, f"(not {text})")) is not None:
                raise ConflictError(
                    f"(not {text}) is stored, but the document has {text}; {_REMEDY}"
                )


def _refuse_values(
    transaction: Transaction, values: Collection[tuple[FluentKey, str, FluentValue]]
) -> None:
    found = transaction.values.find({key for key, _, _ in values})
    transaction.values.load(found.values())
    for key, text, value in values:
        fluent = found.get(key)
        now = None if fluent is None else transaction.values.value(fluent)
        if now is not None and not value.is_same(now):
            raise ConflictError(
                f"(= {text} {now.text}) is stored, but the document has (= {text} {value.text}); "
                f"{_REMEDY}"
            )


_KINDS = ("type", "object", "predicate", "function")


def retract_misfits(transaction: Transaction) -> None:
    """Retract what does not fit the definitions as a transaction has changed them."""
    definitions = transaction.definitions
    if not any(_is_redefined(transaction, kind) for kind in _KINDS):
        return
    retract(
        transaction,
        [
            atom
            for atom in propositions_on(transaction, None)
            if not _fits(
                definitions,
                definitions.predicates.live(atom.key.predicate_id).parameters,
                atom.key.arguments,
            )
        ],
    )
    retract_function_values(
        transaction,
        [
            held
            for held in function_values_on(transaction, None)
            if not _value_fits(definitions, held)
        ],
    )
    for formula in list(definitions.formulas):
        if formula.section in PROBLEM_SECTIONS:
            try:
                node = read_formula(definitions, formula)
                transaction.define("formula", make_formula(transaction, formula.section, node))
            except InvalidKnowledgeError:
                transaction.undefine("formula", formula.id)


def _is_redefined(transaction: Transaction, kind: str) -> bool:
    """Return whether anything that was there before is another by now."""
    elements = transaction.definitions.elements(kind)
    return any(
        (before := elements.origin.get(id_)) is not None and before != now
        for id_, now in elements.changes.items()
    )


def _value_fits(definitions: Definitions, held: HeldValue) -> bool:
    function = definitions.functions.live(held.fluent.key.function_id)
    value = held.value.object_id
    if value is None or not function.type_ids:
        same_kind = value is None and not function.type_ids
    else:
        object_ = definitions.objects.live(value)
        same_kind = definitions.any_fits(object_.type_ids, function.type_ids)
    return same_kind and _fits(definitions, function.parameters, held.fluent.key.arguments)


def _fits(
    definitions: Definitions, parameters: tuple[ParameterDefinition, ...], arguments: str
) -> bool:
    ids = arguments.split()
    if len(ids) != len(parameters):
        return False
    objects = [definitions.objects.live(int(id_)) for id_ in ids]
    return all(
        definitions.any_fits(object_.type_ids, parameter.type_ids)
        for object_, parameter in zip(objects, parameters, strict=True)
    )


# A caller is told so often how far a load has come.
_REPORTS = 200


class Steps:
    """Counts the elements that are stored, and reports about each percent of them."""

    def __init__(self, progress: Progress | None = None, whole: int = 0) -> None:
        self._progress, self._whole = progress, whole
        self._done = self._next = 0

    def add(self, count: int) -> None:
        """Count elements that are stored."""
        self._done += count
        if self._progress is not None and (self._done >= min(self._next, self._whole)):
            self._next = self._done + max(1, self._whole // _REPORTS)
            self._progress(self._done, self._whole)


class Declaring:
    """Defines what a document declares; the document is consistent in itself.

    Attributes:
        said: kind -> ids of what was declared.
    """

    def __init__(self, transaction: Transaction, replace: bool) -> None:
        """Make it for one document."""
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._replace = replace
        self.said: dict[str, set[int]] = {}

    def types(self, types: Sequence[TypedName]) -> None:
        """Declare types."""
        ids = self._identities("type", [type_.name for type_ in types])
        for type_ in types:
            # First without parents, which may come later in the list.
            id_, name = ids[fold(type_.name)]
            if self._definitions.types.get(id_) is None:
                self._transaction.define("type", TypeDefinition(id_, name, None, (), name))
        for type_ in types:
            id_, name = ids[fold(type_.name)]
            above = () if type_.types == (ROOT_TYPE,) else self.type_ids(type_.types)
            first = above[0] if above else None
            self._define("type", TypeDefinition(id_, name, first, above[1:]))

    def type_ids(self, names: Iterable[str]) -> tuple[int, ...]:
        """Find the types of a name; `object` is created on first use."""
        ids = []
        for name in names:
            type_ = self._definitions.types.named(name)
            if type_ is None:
                self.types([TypedName(name)])
                type_ = self._definitions.types.named(name)
                assert type_ is not None
            ids.append(type_.id)
        return tuple(dict.fromkeys(ids))

    def objects(self, objects: Sequence[TypedName], is_constant: bool) -> None:
        """Declare objects, or constants."""
        ids = self._identities("object", [object_.name for object_ in objects])
        found: dict[tuple[str, ...], tuple[int, ...]] = {}
        for object_ in objects:
            type_ids = found.get(object_.types)
            if type_ids is None:
                type_ids = found[object_.types] = self.type_ids(object_.types)
            identity = ids[fold(object_.name)]
            self._define(
                "object", ObjectDefinition(*identity, type_ids[0], type_ids[1:], is_constant)
            )

    def parameters(self, parameters: Iterable[TypedName]) -> tuple[ParameterDefinition, ...]:
        """Find the types of parameters."""
        return tuple(
            ParameterDefinition(part.name, self.type_ids(part.types)) for part in parameters
        )

    def predicates(self, predicates: Sequence[Predicate]) -> None:
        """Declare predicates."""
        ids = self._identities("predicate", [predicate.name for predicate in predicates])
        for predicate in predicates:
            own = self.parameters(predicate.parameters)
            self._define("predicate", PredicateDefinition(*ids[fold(predicate.name)], own))

    def functions(self, functions: Sequence[Function]) -> None:
        """Declare functions."""
        ids = self._identities("function", [function.name for function in functions])
        for function in functions:
            own, type_ids = self.parameters(function.parameters), self.type_ids(function.types)
            identity = ids[fold(function.name)]
            self._define("function", FunctionDefinition(*identity, own, type_ids))

    def _identities(self, kind: str, names: Sequence[str]) -> dict[str, tuple[int, str]]:
        self._transaction.look_up(kind, names)
        ids = {fold(name): identify(self._transaction, kind, name) for name in names}
        self.said.setdefault(kind, set()).update(id_ for id_, _ in ids.values())
        return ids

    def _define(self, kind: str, made: Definition) -> None:
        definition: Any = with_text(self._definitions, made)
        elements = self._definitions.elements(kind)
        stored, before = elements.get(definition.id), elements.origin.get(definition.id)
        if stored is not None and _becomes_constant(stored, definition):
            # An action may mention an object, which the domain then declares.
            before = None
        if stored is None or self._replace or before is None:
            self._transaction.define(kind, definition)
        elif stored != definition and not _says_the_same(stored, definition):
            raise ConflictError(
                f"{kind} {stored.text} is stored, but the document declares {definition.text}; "
                "load it with mode='replace', or make the two agree"
            )


def _becomes_constant(stored: Any, definition: Any) -> bool:
    """Return whether an object becomes a constant, and nothing else."""
    return (
        isinstance(stored, ObjectDefinition)
        and stored.type_ids == definition.type_ids
        and definition.is_constant
    )


def _says_the_same(stored: Any, definition: Any) -> bool:
    """Return whether two definitions differ in the names of parameters alone."""
    if isinstance(stored, PredicateDefinition | FunctionDefinition):
        values = getattr(stored, "type_ids", ()) == getattr(definition, "type_ids", ())
        return values and same_types(stored.parameters, definition.parameters)
    return False


def load_domain(
    transaction: Transaction, domain: Domain, replace: bool, progress: Progress | None = None
) -> None:
    """Store a domain."""
    stored = find_document(transaction.definitions, DOMAIN)
    if stored is not None and not replace:
        check_title(stored, domain.name)
    declaring = Declaring(transaction, replace)
    declared = domain.types, domain.constants, domain.predicates, domain.functions
    steps = Steps(progress, sum(map(len, (*declared, domain.actions))))
    declaring.types(domain.types)
    declaring.objects(domain.constants, is_constant=True)
    declaring.predicates(domain.predicates)
    declaring.functions(domain.functions)
    steps.add(sum(map(len, declared)))
    formulas = _put_formulas(transaction, domain)
    actions = _put_actions(transaction, domain.actions, declaring, replace, steps)
    if replace:
        _retract_unsaid(transaction, declaring, {each.id for each in formulas}, actions)
        retract_misfits(transaction)
    put_document(transaction, DOMAIN, domain.name, None, _items(domain, formulas), replace)


def _items(domain: Domain, formulas: Sequence[FormulaDefinition]) -> Iterator[Item]:
    yield from (Item("requirement", name) for name in domain.requirements)
    for section, named in (
        ("type", domain.types),
        ("constant", domain.constants),
        ("predicate", domain.predicates),
        ("function", domain.functions),
        ("action", domain.actions),
    ):
        yield from (Item(section, fold(each.name)) for each in named)
    yield from (Item(each.section, each.name) for each in formulas)


def _put_formulas(transaction: Transaction, domain: Domain) -> list[FormulaDefinition]:
    sections: tuple[tuple[str, Sequence[Node]], ...] = (
        (DERIVED_PREDICATE, domain.derived),
        (DOMAIN_CONSTRAINT, domain.constraints),
    )
    formulas = []
    for section, nodes in sections:
        for node in nodes:
            formula = make_formula(transaction, section, node)
            transaction.define("formula", formula)
            formulas.append(formula)
    return formulas


def _put_actions(
    transaction: Transaction,
    actions: Sequence[Action],
    declaring: Declaring,
    replace: bool,
    steps: Steps,
) -> set[int]:
    definitions = transaction.definitions
    names = [action.name for action in actions]
    transaction.look_up("action", names)
    for action in actions:
        stored = definitions.actions.named(action.name)
        parameters = declaring.parameters(action.parameters)
        if replace and stored is not None and stored.kind != action.kind:
            transaction.undefine("action", stored.id)
        said = (action.duration, action.condition, action.effect)
        trees = action_trees(transaction, action.kind, action.name, parameters, *said)
        put_action(transaction, action.kind, action.name, parameters, trees)
        now = definitions.actions.named(action.name)
        if stored is not None and not replace and now != stored:
            raise ConflictError(
                f"action {stored.name!r} is stored with another definition than the document has; "
                "load it with mode='replace', or make the two agree"
            )
        steps.add(1)
    found = (definitions.actions.named(name) for name in names)
    return {action.id for action in found if action is not None}


def _retract_unsaid(
    transaction: Transaction, declaring: Declaring, formulas: set[int], actions: set[int]
) -> None:
    definitions = transaction.definitions
    for action in list(definitions.actions):
        if action.id not in actions:
            transaction.undefine("action", action.id)
    for formula in list(definitions.formulas):
        if formula.section in DOMAIN_SECTIONS and formula.id not in formulas:
            transaction.undefine("formula", formula.id)
    said = declaring.said

    def unsaid(kind: str) -> set[int]:
        return {each.id for each in definitions.elements(kind)} - said.get(kind, set())

    types = {id_ for id_ in unsaid("type") if fold(definitions.types.live(id_).name) != ROOT_TYPE}
    constants = {id_ for id_ in unsaid("object") if definitions.objects.live(id_).is_constant}
    objects = {each.id for each in definitions.objects if not types.isdisjoint(each.type_ids)}
    delete_scope(
        transaction,
        Scope(types, constants | objects, unsaid("predicate"), unsaid("function")),
    )


def load_problem(
    transaction: Transaction, problem: Problem, replace: bool, progress: Progress | None = None
) -> None:
    """Store a problem, whose domain is stored."""
    stored = find_document(transaction.definitions, PROBLEM)
    if stored is not None and not replace:
        check_title(stored, problem.name)
    is_first = transaction.is_stateless and not transaction.head.revision
    before = _Before(transaction) if replace and not is_first else None
    declaring = Declaring(transaction, replace)
    steps = Steps(progress, len(problem.objects) + len(problem.facts) + len(problem.values))
    declaring.objects(problem.objects, is_constant=False)
    steps.add(len(problem.objects))
    names = NameResolver(transaction)
    values, old = names.values(problem.values)
    if not replace:
        refuse_contradictions(transaction, names, problem, values)
    goals = [goal for goal in problem.goal if isinstance(goal, Atom) and is_ground(goal)]
    for atoms, is_goal in ((problem.facts, False), (goals, True)):
        told = Steps() if is_goal else steps
        _hold(transaction, names, atoms, is_goal, {} if before is None else before.atoms, told)
    transaction.values.set_many(values, old)
    steps.add(len(problem.values))
    formulas = _Formulas(transaction, names, problem)
    if before is not None:
        before.retract(transaction, {key for key, _, _ in values})
    if replace:
        _retract_unsaid_state(transaction, declaring, formulas.ids)
    _refuse_second_metric(transaction, formulas.ids)
    put_document(
        transaction,
        PROBLEM,
        problem.name,
        problem.domain,
        _problem_items(problem, formulas),
        replace,
    )


class _Before:
    """What held before a problem was loaded, as far as the problem has not said it again.

    Attributes:
        atoms: the facts and the goals.
        values: the values of functions.
    """

    def __init__(self, transaction: Transaction) -> None:
        # Read before anything is added, for that need not be read back.
        self.atoms = {atom.key: atom for atom in propositions_on(transaction, None)}
        self.values = function_values_on(transaction, None)

    def retract(self, transaction: Transaction, said: set[FluentKey]) -> None:
        """Retract what was not said again; the atoms that were said are gone from here."""
        retract(transaction, list(self.atoms.values()))
        unsaid = [value for value in self.values if value.fluent.key not in said]
        retract_function_values(transaction, unsaid)


def _hold(
    transaction: Transaction,
    names: NameResolver,
    atoms: Sequence[Atom],
    is_goal: bool,
    before: dict[AtomKey, GroundAtom],
    steps: Steps,
) -> None:
    """Assert atoms; remove from `before` those that held already."""
    propositions = transaction.propositions
    for batch in batches(atoms):
        texts, old = names.atoms(batch, is_goal)
        if before:
            for key in [key for key in old if before.pop(key, None) is not None]:
                del texts[key]
            old = [key for key in old if key in texts]
        propositions.hold_all(texts, old)
        transaction.spill()
        steps.add(len(batch))


class _Formulas:
    """The formulas of a problem, as they are stored.

    Attributes:
        ids: the ids of those that the problem says.
        items: their places in the document.
    """

    def __init__(self, transaction: Transaction, names: NameResolver, problem: Problem) -> None:
        self._transaction = transaction
        self.ids: set[int] = set()
        self.items: list[Item] = []
        for goal in problem.goal:
            if isinstance(goal, Atom) and is_ground(goal):
                (text,) = names.atoms((goal,), True).texts.values()
                self.items.append(Item(GOAL, text))
            else:
                self._put(GOAL, goal)
        sections: tuple[tuple[str, Sequence[Node]], ...] = (
            (INITIAL, problem.literals),
            (TIMED, problem.timed),
            (CONSTRAINT, problem.constraints),
        )
        for section, nodes in sections:
            for node in nodes:
                self._put(section, node)
        if problem.metric is not None:
            self._put(METRIC, problem.metric)

    def _put(self, section: str, node: Node) -> None:
        formula = make_formula(self._transaction, section, node)
        self._transaction.define("formula", formula)
        self.ids.add(formula.id)
        self.items.append(Item(section, formula.name))


def _refuse_second_metric(transaction: Transaction, ids: set[int]) -> None:
    metrics = read_formulas(transaction.definitions, METRIC)
    if len(metrics) > 1:
        before, now = sorted(metrics, key=lambda each: each.id in ids)
        raise ConflictError(
            f"{before.text} is stored, but the document has {now.text}; load it with "
            "mode='replace', or make the two agree"
        )


def _problem_items(problem: Problem, formulas: _Formulas) -> Iterator[Item]:
    yield from (Item("requirement", name) for name in problem.requirements)
    yield from (Item("object", fold(object_.name)) for object_ in problem.objects)
    yield from formulas.items


def _retract_unsaid_state(
    transaction: Transaction, declaring: Declaring, formulas: set[int]
) -> None:
    definitions = transaction.definitions
    for formula in list(definitions.formulas):
        if formula.section in PROBLEM_SECTIONS and formula.id not in formulas:
            transaction.undefine("formula", formula.id)
    kept = declaring.said.get("object", set()) | constant_ids(definitions)
    objects = {object_.id for object_ in definitions.objects} - kept
    if objects:
        delete_scope(transaction, Scope(objects=objects))
