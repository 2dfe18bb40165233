"""Explanations: the parts of a condition that do not hold, with values and retractions."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from itertools import count
from typing import Any, NamedTuple

from typing_extensions import override

from ..dao.formula import read_formula, read_formulas, read_goals
from ..dto import formulas as f
from ..dto.formulas import Node
from ..dto.lexical import fold
from ..errors import InvalidKnowledgeError, UnsupportedConstructError
from ..history.revisions import read_numbered
from ..html import Listing
from ..knowledge import resolved as r
from ..knowledge.definitions import METRIC, Definitions
from ..knowledge.reads import Head
from ..knowledge.rules import rules_of
from ..knowledge.symbols import symbols_of
from ..pddl.given import read_condition, text_of
from ..pddl.requirements import is_function
from ..sql.answers import GUARDS
from ..store.snapshot import View
from ..store.state import State
from .after import After, weakened
from .arithmetic import EXACT, Exact, decimal_of
from .ask import OF_ANSWERS, OF_TRUTHS, Binding, asked, given_numbers, given_variable, question
from .failures import FAILED, MAX_INSTANCES, Explaining, FailedCondition, conjuncts
from .steps import EffectItem, of_time, preferred
from .sweep import names_of, with_objects

# The numbers of new variables begin here: no condition has such a number.
_FAR = 2_000_000
_NOTHING = r.Needed([], [])


class Changed:
    """Ground effects on a state, to judge conditions after them."""

    def __init__(
        self,
        definitions: Definitions,
        items: Sequence[EffectItem],
        said: str,
        loosened: set[Head] | None = None,
    ) -> None:
        self.said = said  # when conditions are judged, such as `right after the start`
        self._after = After(definitions, items, count(_FAR), is_whole=True)
        self.rules = self._after.rules()
        self._loosened = loosened  # the functions whose strict comparisons count as non-strict
        self.values = {
            r.NumberOf(item.head, item.terms): item.value
            for item in items
            if isinstance(item.value, Decimal)
        }

    def part(self, part: r.Part) -> r.Part:
        """Return the condition before iff a part holds after."""
        if self._loosened is not None:
            part = weakened(part, self._loosened)
        return self._after.part(part)


class Explainer(Explaining):
    """Finds the parts of closed formulas that do not hold in a state, or after some changes."""

    def __init__(
        self,
        view: View,
        numbers: Mapping[str, Decimal] | None = None,
        changed: Changed | None = None,
    ) -> None:
        self._view = view
        self._changed = changed
        self.said = "" if changed is None else f" {changed.said}"
        self._exact = {} if numbers is None else dict(numbers)
        self._numbers = given_numbers(self._exact)

    def failed(self, formulas: Iterable[f.Formula]) -> list[FailedCondition]:
        """Return the parts that do not hold, in order."""
        false = self.failed_nodes(formulas)
        return self._with_history(false, [self.failure(node) for node in false])

    def _resolve(self, node: f.Formula) -> r.Part:
        return self._checked(r.Resolver(self._view.definitions).part(node))

    def _checked(self, part: r.Part) -> r.Part:
        if self._changed is not None:
            part = self._changed.part(part)
        r.check_levels(part)
        return part

    @override
    def false(self, nodes: Sequence[f.Formula]) -> list[f.Formula]:
        parts = [self._resolve(node) for node in nodes]
        facts, others = self._grouped(parts)
        false: set[int] = set()
        for predicate, keys in facts.items():
            statement = self._question().held_facts(predicate, keys)
            held = {row[0] for row in self._view.reader.run(statement, self._numbers)}
            false.update(at for key, places in keys.items() if key not in held for at in places)
        if others:
            statement = self._question().truths([parts[position] for position in others], {})
            [row] = asked(self._view, statement, self._numbers, OF_TRUTHS)
            truths = zip(others, row[GUARDS:], strict=True)
            false.update(position for position, holds in truths if not holds)
        return [nodes[position] for position in sorted(false)]

    def _question(self) -> Any:
        rules = None if self._changed is None else self._changed.rules
        return question(self._view, self._numbers, rules)

    def _grouped(
        self, parts: Iterable[r.Part]
    ) -> tuple[dict[int, dict[str, list[int]]], list[int]]:
        """Return the places of ground facts, which are looked up together, and of other parts."""
        facts: dict[int, dict[str, list[int]]] = {}
        others = []
        for place, part in enumerate(parts):
            key = self._key(part)
            if key is None:
                others.append(place)
            else:
                facts.setdefault(key[0], {}).setdefault(key[1], []).append(place)
        return facts, others

    def _key(self, part: r.Part) -> tuple[int, str] | None:
        """Return the predicate and the arguments of a ground fact that no rule derives."""
        if not isinstance(part, r.HoldsFact) or rules_of(self._view.definitions).of(part.predicate):
            return None
        ids = [str(term.id) for term in part.terms if isinstance(term, r.Known)]
        return (part.predicate, " ".join(ids)) if len(ids) == len(part.terms) else None

    @override
    def counterexamples(self, node: f.Forall) -> Sequence[Sequence[str]]:
        resolver = r.Resolver(self._view.definitions)
        with resolver.within(node.variables) as bound:
            part = self._checked(r.negate(resolver.part(node.formula)))
        columns = [
            r.Column(variable.name, each)
            for variable, each in zip(node.variables, bound, strict=True)
        ]
        statement = self._question().answers(part, columns, {}, True)
        given = {**self._numbers, "most": MAX_INSTANCES}
        rows = asked(self._view, statement, given, OF_ANSWERS)[1:]
        live = self._view.definitions.objects.live
        return [[live(id_).name for id_ in row[1 : len(columns) + 1]] for row in rows]

    @override
    def exact(self, expression: f.Expression) -> Exact | None:
        values = {} if self._changed is None else self._changed.values
        return exact_number(self._view, expression, self._exact, values)

    def _with_history(
        self, nodes: Sequence[f.Formula], found: list[FailedCondition]
    ) -> list[FailedCondition]:
        """Add the revision that retracted each fact that held before."""
        atoms = (self._resolve(one) if isinstance(one, f.Atom) else r.FALSE for one in nodes)
        ends: dict[int, int] = {}
        for predicate, keys in self._grouped(atoms)[0].items():
            statement = self._question().ended_facts(predicate, keys)
            for arguments, until in self._view.reader.run(statement, self._numbers):
                if until is not None:
                    ends.update((place, until) for place in keys[arguments])
        session, kb_id, numbers = self._view.session, self._view.kb_id, {*ends.values()}
        known = {} if kb_id is None else read_numbered(session, kb_id, numbers)
        for position, until in ends.items():
            found[position] = replace(found[position], retracted=known.get(until))
        return found


def number_of(view: View, node: f.Expression, numbers: Mapping[str, Decimal]) -> Decimal | None:
    """Evaluate a closed expression with its own arithmetic; None if a fluent has no value."""
    found = exact_number(view, node, numbers)
    return None if found is None else decimal_of(found)


def exact_number(
    view: View,
    node: f.Expression,
    numbers: Mapping[str, Decimal],
    changed: Mapping[r.NumberOf, Decimal] | None = None,
) -> Exact | None:
    """Evaluate a closed expression exactly, with changed fluents; None if one has no value."""
    resolver = r.Resolver(view.definitions)
    quantity, needed = resolver.number(node)
    leaves = [each for each in r.parts_of(quantity) if isinstance(each, r.NumberOf)]
    values = read_numbers(view, list(dict.fromkeys(leaves)), needed)
    return None if values is None else exact(quantity, {**values, **(changed or {})}, numbers)


def read_numbers(
    view: View, leaves: Sequence[r.NumberOf], needed: r.Needed = _NOTHING
) -> Mapping[r.NumberOf, Decimal] | None:
    """Read the numbers of fluents that have a value; None if an object in them has none."""
    if not leaves and not needed.bound:
        return {}
    statement = question(view).effects(r.all_of(needed.needed), needed.bound, leaves, {})
    rows = view.reader.run(statement, {})
    if len(rows) != 1:
        return None
    return decimals(leaves, rows[0][len(needed.bound) :] if leaves else ())


def decimals(
    numbers: Sequence[r.NumberOf], texts: Sequence[str | None]
) -> dict[r.NumberOf, Decimal]:
    """Return the numbers of fluents that have a value."""
    return {
        number: Decimal(text)
        for number, text in zip(numbers, texts, strict=True)
        if text is not None
    }


def exact(
    quantity: r.Quantity, values: Mapping[r.NumberOf, Decimal], numbers: Mapping[str, Decimal]
) -> Exact | None:
    """Calculate a number exactly; None without a value, or for a division by zero."""
    if isinstance(quantity, Decimal):
        return quantity
    if isinstance(quantity, r.NumberOf):
        return values.get(quantity)
    if isinstance(quantity, r.Parameter):
        return numbers.get(quantity.name)
    operands = [exact(each, values, numbers) for each in quantity.operands]
    return EXACT.calculate(quantity.operator, operands)


def unsatisfied(
    state: State, condition: str | Node | None = None, /, **bindings: Binding
) -> list[FailedCondition]:
    """Return the parts of a condition, or of the goals, that do not hold.

    It splits conjunctions into their parts, and universal quantifiers into their first 20
    counterexamples; other formulas are parts themselves.

    Args:
        condition: as for `holds`; None for the goals, without preferences.
        **bindings: as for `holds`.

    Returns:
        The parts, in order, each with the values of both sides of a comparison, or the revision
        that retracted a fact that held before. Empty if the condition holds, or all goals are
        reached.

    Raises:
        PddlError, TypeMismatchError, UnsupportedConstructError, ArchivedError: as `holds`.

    Examples:
        >>> for part in kb.unsatisfied("(and (robot_at rb1 wp1) (not (robot_at rb1 wp1)))"):
        ...     print(part)
        (not (robot_at rb1 wp1)): does not hold
        >>> kb.unsatisfied()
        []
        >>> _ = kb.goals.save("(not (robot_at rb1 wp1))")
        >>> print(*kb.unsatisfied())
        (not (robot_at rb1 wp1)): does not hold
    """

    def work(view: View) -> list[FailedCondition]:
        asked_for = hard_goals(view) if condition is None else [_closed(view, condition, bindings)]
        return Explainer(view).failed(asked_for)

    if condition is None:
        for name in bindings:
            given_variable(name, ())
    return Listing(state.store.read_in_snapshot(work, state.at), FAILED)


def is_goal_reached(state: State) -> bool:
    """Return whether all goals hold; preferences do not count. True without goals.

    It takes one statement for all of them; `unsatisfied` returns those that do not hold.

    Raises:
        ArchivedError: a part of the state was moved to an archive.
        UnsupportedConstructError: the goals are nested too deeply for a database.
    """

    def work(view: View) -> bool:
        resolver = r.Resolver(view.definitions)
        [holds] = _truths(view, [r.all_of(resolver.part(goal) for goal in hard_goals(view))])
        return holds

    return state.store.read_in_snapshot(work, state.at)


def _truths(view: View, parts: list[r.Part]) -> list[bool]:
    """Ask in one statement which parts hold."""
    for part in parts:
        r.check_levels(part)
    [row] = asked(view, question(view).truths(parts, {}), {}, OF_TRUTHS)
    return [bool(holds) for holds in row[GUARDS:]]


class GoalStanding(NamedTuple):
    """A goal, as PDDL, and whether it holds."""

    text: str
    is_reached: bool


def read_goal_standings(state: State, most: int) -> list[GoalStanding]:
    """Read the first goals, as conjuncts, and whether each holds, in two statements."""

    def work(view: View) -> list[GoalStanding]:
        resolver = r.Resolver(view.definitions)
        goals = [part for goal in hard_goals(view) for part in conjuncts(goal)][:most]
        truths = _truths(view, [resolver.part(goal) for goal in goals]) if goals else []
        return [GoalStanding(str(goal), holds) for goal, holds in zip(goals, truths, strict=True)]

    return state.store.read_in_snapshot(work, state.at)


def _closed(view: View, condition: str | Node, bindings: Mapping[str, Binding]) -> f.Formula:
    """Read a condition, with objects for its variables; quantify the others existentially."""
    symbols = symbols_of(view.definitions)
    read = read_condition(text_of(condition), symbols=symbols)
    if bindings:
        read = with_objects(read, names_of(bindings), symbols)
    return f.Exists(read.free, read.formula) if read.free else read.formula


def hard_goals(view: View) -> list[f.Formula]:
    """Read the goals without preferences."""
    found = (of_time(goal, None) for goal in read_goals(view))
    return [goal for goal in found if goal is not None]


def metric_value(state: State) -> Decimal | None:
    """Evaluate the metric in this state, exactly.

    `is-violated` counts the violated instances of a preference among the goals (PDDL 3.0). A
    `total-cost` without a value is 0.

    Returns:
        Its value; None without a metric.

    Raises:
        InvalidKnowledgeError: a fluent in it has no value, or it divides by 0.
        UnsupportedConstructError: it is about `total-time`, or a preference that is not a goal: a
            plan has these, but not a state.

    Examples:
        >>> kb.pddl.metric_value() is None
        True
    """

    def work(view: View) -> Decimal | None:
        stored = read_formulas(view.definitions, METRIC)
        if not stored:
            return None
        metric: Any = read_formula(view.definitions, stored[0])
        numbers, functions = {}, view.definitions.functions
        for node in f.walk(metric.expression):
            if isinstance(node, f.IsViolated):
                name = f"is-violated {fold(node.preference)}"
                numbers[name] = Decimal(_violations(view, node.preference))
            elif node == f.Fluent(f.TOTAL_TIME) and functions.named(f.TOTAL_TIME) is None:
                raise UnsupportedConstructError(
                    "the metric is about total-time, which belongs to a plan and not to a state; "
                    "kb.validate(plan) returns its value"
                )
        value = _with_costs(view, metric.expression, numbers)
        if value is None:
            raise InvalidKnowledgeError(
                f"the metric {metric.expression} has no value: one of its fluents has none, or it "
                "divides by 0; set the fluent first"
            )
        return value

    return state.store.read_in_snapshot(work, state.at)


def _with_costs(view: View, node: f.Expression, numbers: Mapping[str, Decimal]) -> Decimal | None:
    """Evaluate a metric; without a value, `total-cost` is 0, as at the end of a plan."""
    found = exact_number(view, node, numbers)
    cost = next((one for one in f.walk(node) if is_function(one, f.TOTAL_COST)), None)
    if found is None and isinstance(cost, f.Fluent) and exact_number(view, cost, {}) is None:
        leaf, _ = r.Resolver(view.definitions).number(cost)
        assert isinstance(leaf, r.NumberOf)
        found = exact_number(view, node, numbers, {leaf: Decimal(0)})
    return None if found is None else decimal_of(found)


def _violations(view: View, name: str) -> int:
    """Count the instances of a preference among the goals that do not hold."""
    found = [
        one
        for goal in read_goals(view)
        for one in preferred(goal)
        if one.name is not None and fold(one.name) == fold(name)
    ]
    if not found:
        raise UnsupportedConstructError(
            f"the metric counts violations of the preference {name!r}, which is not one of the "
            "goals; kb.validate(plan) counts it"
        )
    count = 0
    for _, variables, formula in found:
        resolver = r.Resolver(view.definitions)
        with resolver.within(variables) as bound:
            part = resolver.part(formula)
        r.check_levels(part)
        columns = [r.Column(str(number), each) for number, each in enumerate(bound)]
        statement = question(view).answers(r.Lacks(part), columns, {}, False)
        count += len(asked(view, statement, {}, OF_ANSWERS)) - 1
    return count
