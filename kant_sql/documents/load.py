"""Loads documents into a store."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Sequence
from operator import attrgetter
from typing import Any, NamedTuple, TypeVar

from ..arguments import Progress
from ..dao.action import action_trees, put_action
from ..dao.base import batches, identify
from ..dao.dependants import delete_mentioned, function_values_on, propositions_on, retract
from ..dao.formula import is_ground, make_formula, read_formula, read_formulas, read_given
from ..dao.signatures import same_types
from ..dto.formulas import Atom, Constant, Node, Not, Number, TypedName
from ..dto.lexical import ROOT_TYPE, decimal_text, fold
from ..errors import ConflictError, InvalidKnowledgeError
from ..knowledge import definitions as d
from ..knowledge.atoms import AtomKey, FluentKey, FluentValue, GroundAtom, HeldValue
from ..knowledge.canonical import with_text
from ..knowledge.rules import check_stratified
from ..knowledge.trees import Mentioned, ParameterDefinition
from ..pddl.document import Action, Domain, Function, FunctionValue, Predicate, Problem
from ..store.transaction import Transaction
from .build import REQUIREMENT, check_title, constant_ids, put_document

N = TypeVar("N", TypedName, Predicate, Function)
_NAME = attrgetter("name")
# A fluent, its text, and its value.
_Entry = tuple[FluentKey, str, FluentValue]


def _conflict(stored: str, declared: str) -> ConflictError:
    return ConflictError(
        f"{stored} is stored, but the document has {declared}; load it with mode='replace', or "
        "make the two agree"
    )


class NamedAtoms(NamedTuple):
    """Ground atoms with their keys."""

    texts: dict[AtomKey, str]  # canonical PDDL texts
    old: list[AtomKey]  # those that may already be stored; the others mention new objects


class NameResolver:
    """Maps names in a consistent document to ids; a document has each name in one spelling."""

    def __init__(self, transaction: Transaction) -> None:
        definitions, next_id = transaction.definitions, transaction.head.next_id
        self._definitions: d.Definitions = definitions
        # The ids and stored names of predicates and functions, by kind.
        self._heads: dict[str, dict[str, tuple[int, str]]] = {"predicate": {}, "function": {}}
        # Keyed by the address of a number, which the document keeps: equal numbers may differ in
        # spelling.
        self._numbers: dict[int, FluentValue] = {}
        self._ids = {object_.name: str(object_.id) for object_ in definitions.objects}
        # New objects: no stored atom mentions them.
        self._new: frozenset[str] = frozenset()
        if transaction.is_stateless:
            self._new = frozenset(id_ for id_ in self._ids.values() if int(id_) >= next_id)

    def atoms(self, atoms: Iterable[Atom], is_goal: bool) -> NamedAtoms:
        """Find the keys of ground atoms."""
        texts: dict[AtomKey, str] = {}
        old: list[AtomKey] = []
        is_old, find, known = self._new.isdisjoint, self._arguments, self._heads["predicate"]
        for atom in atoms:
            id_, name = known.get(atom.predicate) or self._head("predicate", atom.predicate)
            ids, names = find(atom.terms)
            key = AtomKey(is_goal, id_, " ".join(ids))
            texts[key] = f"({name} {' '.join(names)})" if names else f"({name})"
            # A document has each fact once, but may repeat a goal.
            if is_goal or is_old(ids):
                old.append(key)
        return NamedAtoms(texts, old)

    def values(self, values: Iterable[FunctionValue]) -> tuple[list[_Entry], list[FluentKey]]:
        """Find the keys of fluents with texts and values, and those that may already be stored."""
        entries, old, known = list[_Entry](), list[FluentKey](), self._heads["function"]
        for fluent, value in values:
            id_, name = known.get(fluent.function) or self._head("function", fluent.function)
            ids, names = self._arguments(fluent.terms)
            text = f"({name} {' '.join(names)})" if names else f"({name})"
            held = self._numbers.get(id(value)) or self._value(value)
            key = FluentKey(id_, " ".join(ids))
            entries.append((key, text, held))
            if self._new.isdisjoint(ids):
                old.append(key)
        return entries, old

    def _arguments(self, terms: Sequence[object]) -> tuple[list[str], list[str]]:
        names: list[str] = [*map(_NAME, terms)]
        try:
            return [*map(self._ids.__getitem__, names)], names
        except KeyError:
            # The store had the object before, in another spelling.
            found = [self._find("object", name) for name in names]
            return [str(id_) for id_, _ in found], [name for _, name in found]

    def _find(self, kind: str, name: str) -> tuple[int, str]:
        definition = self._definitions.elements(kind).named(name)
        assert definition is not None
        return definition.id, definition.name

    def _head(self, kind: str, name: str) -> tuple[int, str]:
        head = self._heads[kind][name] = self._find(kind, name)
        return head

    def _value(self, value: Number | Constant) -> FluentValue:
        if isinstance(value, Constant):
            id_, name = self._find("object", value.name)
            return FluentValue(name, id_)
        held = self._numbers[id(value)] = FluentValue(decimal_text(value.value))
        return held


def refuse_contradictions(
    transaction: Transaction,
    names: NameResolver,
    problem: Problem,
    values: Collection[_Entry],
) -> None:
    """Refuse a problem whose initial state contradicts the stored one."""
    if not transaction.says:
        # A later saying about a time overrides an earlier one.
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
            raise _conflict(atom.text, f"(not {atom.text})")
    formulas = transaction.definitions.formulas
    if any(formula.section == d.INITIAL for formula in formulas):
        for text in names.atoms(problem.facts, False).texts.values():
            if formulas.named(d.formula_name(d.INITIAL, f"(not {text})")) is not None:
                raise _conflict(f"(not {text})", text)


def _refuse_values(transaction: Transaction, values: Collection[_Entry]) -> None:
    found = transaction.values.find({key for key, _, _ in values})
    transaction.values.load(found.values())
    for key, text, value in values:
        fluent = found.get(key)
        now = None if fluent is None else transaction.values.value(fluent)
        if now is not None and not value.is_same(now):
            raise _conflict(f"(= {text} {now.text})", f"(= {text} {value.text})")


def retract_misfits(transaction: Transaction) -> None:
    """Retract facts and values that do not fit the definitions that a transaction has changed."""
    definitions = transaction.definitions
    if not any(_is_redefined(transaction, kind) for kind in d.DECLARED):
        return
    # Definitions have only known time, and so has everything retracted with them.
    with transaction.of_now():
        atoms, values = misfits(transaction)
        retract(transaction, atoms)
        transaction.values.unset(values)
        for formula in list(definitions.formulas):
            if formula.section in d.PROBLEM_SECTIONS:
                try:
                    node = read_formula(definitions, formula)
                    node = read_given(transaction, formula.section, node)
                    made = make_formula(transaction, formula.section, node)
                    transaction.define("formula", made)
                except InvalidKnowledgeError:
                    transaction.undefine("formula", formula.id)


def misfits(transaction: Transaction) -> tuple[list[GroundAtom], list[HeldValue]]:
    """Find the propositions and values that do not fit the definitions."""
    definitions = transaction.definitions
    predicates = definitions.predicates
    atoms = [
        atom
        for atom in propositions_on(transaction, None)
        if not definitions.admits(predicates.live(atom.key.predicate_id), _ids(atom.key.arguments))
    ]
    values = function_values_on(transaction, None)
    return atoms, [held for held in values if not _value_fits(definitions, held)]


def _is_redefined(transaction: Transaction, kind: str) -> bool:
    """Return whether the transaction has redefined an element of a kind."""
    elements = transaction.definitions.elements(kind)
    return any(
        (before := elements.origin.get(id_)) is not None and before != now
        for id_, now in elements.changes.items()
    )


def _value_fits(definitions: d.Definitions, held: HeldValue) -> bool:
    ids, value = _ids(held.fluent.key.arguments), held.value.object_id
    function = definitions.functions.live(held.fluent.key.function_id)
    return definitions.admits(function, ids if value is None else [*ids, value])


def _ids(arguments: str) -> list[int]:
    return [int(id_) for id_ in arguments.split()]


# Progress reports per load.
_REPORTS = 200


class Steps:
    """Counts stored elements, and reports progress."""

    def __init__(self, progress: Progress | None = None, whole: int = 0) -> None:
        self._progress, self._whole = progress, whole
        self._done = self._next = 0

    def add(self, count: int) -> None:
        """Count stored elements."""
        self._done += count
        if self._progress is not None and (self._done >= min(self._next, self._whole)):
            self._next = self._done + max(1, self._whole // _REPORTS)
            self._progress(self._done, self._whole)


class Declaring:
    """Defines the declarations of a consistent document."""

    def __init__(self, transaction: Transaction, replace: bool) -> None:
        self._transaction = transaction
        self._definitions = transaction.definitions
        self._replace = replace
        # The ids of the declared elements, by kind.
        self._declared: defaultdict[str, set[int]] = defaultdict(set)

    def types(self, types: Sequence[TypedName]) -> None:
        """Declare types."""
        found = [*self._identified("type", types)]
        for _, (id_, name) in found:
            # First without parents, which may come later in the list.
            if self._definitions.types.get(id_) is None:
                self._transaction.define("type", d.TypeDefinition(id_, name, None, (), name))
        for type_, identity in found:
            above = () if type_.types == (ROOT_TYPE,) else self.type_ids(type_.types)
            first = above[0] if above else None
            self._define("type", d.TypeDefinition(*identity, first, above[1:]))

    def type_ids(self, names: Iterable[str]) -> tuple[int, ...]:
        """Find the types of a name; `object` is created on first use."""
        ids = []
        for name in names:
            if self._definitions.types.named(name) is None:
                self.types([TypedName(name)])
            type_ = self._definitions.types.named(name)
            assert type_ is not None
            ids.append(type_.id)
        return tuple(dict.fromkeys(ids))

    def objects(self, objects: Sequence[TypedName], is_constant: bool) -> None:
        """Declare objects, or constants."""
        known: dict[tuple[str, ...], tuple[int, ...]] = {}
        for object_, identity in self._identified("object", objects):
            ids = known.get(object_.types)
            if ids is None:
                ids = known[object_.types] = self.type_ids(object_.types)
            self._define("object", d.ObjectDefinition(*identity, ids[0], ids[1:], is_constant))

    def parameters(self, parameters: Iterable[TypedName]) -> tuple[ParameterDefinition, ...]:
        """Find the types of parameters."""
        return tuple(
            ParameterDefinition(part.name, self.type_ids(part.types)) for part in parameters
        )

    def predicates(self, predicates: Sequence[Predicate]) -> None:
        """Declare predicates."""
        for predicate, identity in self._identified("predicate", predicates):
            own = self.parameters(predicate.parameters)
            self._define("predicate", d.PredicateDefinition(*identity, own))

    def functions(self, functions: Sequence[Function]) -> None:
        """Declare functions."""
        for function, identity in self._identified("function", functions):
            own, type_ids = self.parameters(function.parameters), self.type_ids(function.types)
            self._define("function", d.FunctionDefinition(*identity, own, type_ids))

    def undeclared(self, kind: str) -> set[int]:
        """Return the stored elements of a kind that the document does not declare."""
        return {each.id for each in self._definitions.elements(kind)} - self._declared[kind]

    def _identified(self, kind: str, declared: Sequence[N]) -> Iterator[tuple[N, tuple[int, str]]]:
        """Yield declarations with the id and the stored spelling of their names."""
        self._transaction.look_up(kind, [each.name for each in declared])
        for each in declared:
            identity = identify(self._transaction, kind, each.name)
            self._declared[kind].add(identity[0])
            yield each, identity

    def _define(self, kind: str, made: d.Definition) -> None:
        definition: Any = with_text(self._definitions, made)
        elements = self._definitions.elements(kind)
        stored, before = elements.get(definition.id), elements.origin.get(definition.id)
        if (
            isinstance(stored, d.ObjectDefinition)
            and stored.type_ids == definition.type_ids
            and definition.is_constant
        ):
            # The domain declares objects that an action mentions.
            before = None
        if stored is None or self._replace or before is None:
            self._transaction.define(kind, definition)
        elif stored != definition and not _says_the_same(stored, definition):
            raise _conflict(f"{kind} {stored.text}", definition.text)


def _says_the_same(stored: Any, definition: Any) -> bool:
    """Return whether two definitions differ only in the names of parameters."""
    if isinstance(stored, d.PredicateDefinition | d.FunctionDefinition):
        values = getattr(stored, "type_ids", ()) == getattr(definition, "type_ids", ())
        return values and same_types(stored.parameters, definition.parameters)
    return False


class Formulas:
    """Stores the formulas of a document, and collects their ids and items."""

    def __init__(self, transaction: Transaction) -> None:
        self._transaction = transaction
        self.ids: set[int] = set()
        self.items: list[d.Item] = []

    def put(self, section: str, nodes: Iterable[Node]) -> None:
        """Store formulas of a section."""
        for node in nodes:
            formula = make_formula(self._transaction, section, node)
            self._transaction.define("formula", formula)
            self.ids.add(formula.id)
            self.items.append(d.Item(section, formula.name))

    def retract_others(self, sections: Collection[str]) -> None:
        """Retract the other formulas of some sections."""
        for formula in list(self._transaction.definitions.formulas):
            if formula.section in sections and formula.id not in self.ids:
                self._transaction.undefine("formula", formula.id)


def store_domain(
    transaction: Transaction, domain: Domain, replace: bool, progress: Progress | None = None
) -> None:
    """Store a domain."""
    if not replace:
        check_title(transaction.definitions, d.DOMAIN, domain.name)
    declaring = Declaring(transaction, replace)
    declared = domain.types, domain.constants, domain.predicates, domain.functions
    steps = Steps(progress, sum(map(len, (*declared, domain.actions))))
    declaring.types(domain.types)
    declaring.objects(domain.constants, is_constant=True)
    declaring.predicates(domain.predicates)
    declaring.functions(domain.functions)
    steps.add(sum(map(len, declared)))
    formulas = Formulas(transaction)
    formulas.put(d.DERIVED_PREDICATE, domain.derived)
    formulas.put(d.DOMAIN_CONSTRAINT, domain.constraints)
    actions = _put_actions(transaction, domain.actions, declaring, replace, steps)
    if replace:
        formulas.retract_others(d.DOMAIN_SECTIONS)
        _retract_undeclared(transaction, declaring, actions)
        retract_misfits(transaction)
    if domain.derived:
        check_stratified(transaction.definitions)
    put_document(transaction, d.DOMAIN, domain.name, None, _items(domain, formulas), replace)


def _items(domain: Domain, formulas: Formulas) -> Iterator[d.Item]:
    yield from (d.Item(REQUIREMENT, name) for name in domain.requirements)
    for section, named in (
        ("type", domain.types),
        ("constant", domain.constants),
        ("predicate", domain.predicates),
        ("function", domain.functions),
        ("action", domain.actions),
    ):
        yield from (d.Item(section, fold(each.name)) for each in named)
    yield from formulas.items


def _put_actions(
    transaction: Transaction,
    actions: Sequence[Action],
    declaring: Declaring,
    replace: bool,
    steps: Steps,
) -> set[int]:
    """Store actions; return their ids."""
    stored_actions, ids = transaction.definitions.actions, set()
    transaction.look_up("action", [action.name for action in actions])
    for action in actions:
        stored = stored_actions.named(action.name)
        parameters = declaring.parameters(action.parameters)
        if replace and stored is not None and stored.kind != action.kind:
            transaction.undefine("action", stored.id)
        said = (action.duration, action.condition, action.effect)
        trees = action_trees(transaction, parameters, said)
        put_action(transaction, action.kind, action.name, parameters, trees)
        now = stored_actions.named(action.name)
        assert now is not None
        if stored is not None and not replace and now != stored:
            raise _conflict(f"action {stored.name!r}", "another definition of it")
        ids.add(now.id)
        steps.add(1)
    return ids


def _retract_undeclared(transaction: Transaction, declaring: Declaring, actions: set[int]) -> None:
    definitions = transaction.definitions
    for action in list(definitions.actions):
        if action.id not in actions:
            transaction.undefine("action", action.id)
    types = {
        id_
        for id_ in declaring.undeclared("type")
        if fold(definitions.types.live(id_).name) != ROOT_TYPE
    }
    undeclared = declaring.undeclared("object")
    constants = {id_ for id_ in undeclared if definitions.objects.live(id_).is_constant}
    objects = {each.id for each in definitions.objects if not types.isdisjoint(each.type_ids)}
    others = declaring.undeclared("predicate"), declaring.undeclared("function")
    delete_mentioned(transaction, Mentioned(types, constants | objects, *others))


def store_problem(
    transaction: Transaction, problem: Problem, replace: bool, progress: Progress | None = None
) -> None:
    """Store a problem of the stored domain."""
    if replace:
        remedy = "load it with mode='merge', and delete the facts and values that it lacks"
        transaction.refuse_period("mode='replace'", remedy, unless_open=True)
    else:
        check_title(transaction.definitions, d.PROBLEM, problem.name)
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
        own = Steps() if is_goal else steps
        _hold(transaction, names, atoms, is_goal, {} if before is None else before.atoms, own)
    transaction.values.set_many(values, old)
    steps.add(len(problem.values))
    formulas = _put_problem_formulas(transaction, names, problem)
    if before is not None:
        before.retract(transaction, {key for key, _, _ in values})
    if replace:
        formulas.retract_others(d.PROBLEM_SECTIONS)
        objects = declaring.undeclared("object") - constant_ids(transaction.definitions)
        if objects:
            delete_mentioned(transaction, Mentioned(objects=objects))
    _refuse_second_metric(transaction, formulas.ids)
    items = [
        *(d.Item(REQUIREMENT, name) for name in problem.requirements),
        *(d.Item("object", fold(object_.name)) for object_ in problem.objects),
        *formulas.items,
    ]
    put_document(transaction, d.PROBLEM, problem.name, problem.domain, items, replace)


class _Before:
    """The state before a problem was loaded."""

    def __init__(self, transaction: Transaction) -> None:
        # Read first, so that added elements need not be read back.
        self.atoms = {atom.key: atom for atom in propositions_on(transaction, None)}
        self._values = function_values_on(transaction, None)

    def retract(self, transaction: Transaction, values: set[FluentKey]) -> None:
        """Retract the remaining atoms, and all values except the given."""
        retract(transaction, list(self.atoms.values()))
        undeclared = [value for value in self._values if value.fluent.key not in values]
        transaction.values.unset(undeclared)


def _hold(
    transaction: Transaction,
    names: NameResolver,
    atoms: Sequence[Atom],
    is_goal: bool,
    before: dict[AtomKey, GroundAtom],
    steps: Steps,
) -> None:
    """Assert atoms; remove from `before` those that already hold."""
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


def _put_problem_formulas(
    transaction: Transaction, names: NameResolver, problem: Problem
) -> Formulas:
    formulas = Formulas(transaction)
    for goal in problem.goal:
        if isinstance(goal, Atom) and is_ground(goal):
            (text,) = names.atoms((goal,), True).texts.values()
            formulas.items.append(d.Item(d.GOAL, text))
        else:
            formulas.put(d.GOAL, (goal,))
    formulas.put(d.INITIAL, problem.literals)
    formulas.put(d.TIMED, problem.timed)
    formulas.put(d.CONSTRAINT, problem.constraints)
    if problem.metric is not None:
        formulas.put(d.METRIC, (problem.metric,))
    return formulas


def _refuse_second_metric(transaction: Transaction, ids: set[int]) -> None:
    metrics = read_formulas(transaction.definitions, d.METRIC)
    if len(metrics) > 1:
        before, now = sorted(metrics, key=lambda each: each.id in ids)
        raise _conflict(before.text, now.text)
