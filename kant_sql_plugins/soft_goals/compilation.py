"""Compiles soft goals away: preferences and a metric become costs of actions.

The compilation is that of Keyder and Geffner (Soft goals can be compiled away, 2009), extended from
goals to the preferences of PDDL 3.0. At the end of the plan, a chain of steps settles each
preference: it is collected if it is satisfied, or forgone at the cost of its weight. An action with
preferences among its conditions has a copy for each set of violated ones. For constraints on the
trajectory, a step observes the state after each action. Fluents of the metric that only increase
are costs of the actions that increase them.

The cost of a plan of the compiled problem is, up to a constant and a factor, at least the metric of
the plan without the added steps, and equal to it if each satisfied preference is collected.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import product
from math import prod

from kant_sql.dto import formulas as f
from kant_sql.dto.lexical import fold
from kant_sql.knowledge.grounding import replaced
from kant_sql.pddl import document as pddl
from kant_sql.pddl.requirements import is_function
from kant_sql.planning.action_costs import CostedAction, Objects, UnusedNames, write_costs
from kant_sql.planning.metrics import ONE, NotLinearError, Variant, hard, linear
from kant_sql.planning.names import SHARED_MODALS, too_deep

from .costs import Costs

# The maximum number of conditional effects to compile away per action: each doubles its copies.
MOST_COMPILED_EFFECTS = 4
# The maximum number of preferences to compile away per action: each doubles its copies.
MOST_CHOICES = 6
# The maximum number of preferences of one quantifier.
MOST_INSTANCES = 5_000


def compile_soft_goals(domain: pddl.Domain, problem: pddl.Problem) -> Iterator[Variant]:
    """Yield replacements for documents: with costs, then without metric and preferences."""
    soft_goals = SoftGoals(domain, problem)
    compiled = soft_goals.compiled()
    yield compiled
    if soft_goals.observes_much:
        yield SoftGoals(domain, problem, chained=True).compiled()
    if compiled.problem.metric is not None:
        yield SoftGoals(domain, problem, measured=False).compiled()


@dataclass(frozen=True)
class _Preference:
    """An instance of a preference.

    Attributes:
        weight: the amount that violating it adds to a metric to minimize.
    """

    name: str
    weight: Fraction
    formula: f.Formula

    @property
    def is_rewarded(self) -> bool:
        """Whether violating it makes a plan better."""
        return self.weight < 0

    def __str__(self) -> str:
        return str(f.Preference(self.name, self.formula))


class _NotGivenError(Exception):
    """A planner cannot get a construct; the argument is the reason."""


class SoftGoals:
    """A compilation of soft goals.

    Args:
        measured: whether to compile the metric; otherwise it and all preferences are left out.
        chained: whether to observe a state in steps with one conditional effect each.
    """

    def __init__(
        self,
        domain: pddl.Domain,
        problem: pddl.Problem,
        *,
        measured: bool = True,
        chained: bool = False,
    ) -> None:
        self._domain, self._problem = domain, problem
        self._measured, self._chained = measured, chained
        self._objects = Objects(domain, problem)
        self._unused = UnusedNames(domain, problem)
        kinds = {action.kind for action in domain.actions}
        self._changes_by_itself = bool(problem.timed) or bool(kinds & {pddl.PROCESS, pddl.EVENT})
        self._takes_time = self._changes_by_itself or pddl.DURATIVE_ACTION in kinds
        self._ignored: dict[str, None] = {}
        self._steps: dict[str, str | None] = {}
        self._predicates: list[pddl.Predicate] = []
        self._initial: list[f.Atom] = []
        # The effects of observing a state.
        self._observed: list[f.Formula] = []
        self._weights: dict[str, Fraction] = {}
        self._step_cost = Fraction(0)
        self._costs = Costs(domain, problem, {})
        self._read_metric()

    def compiled(self) -> Variant:
        """Compile the documents."""
        try:
            return self._compiled()
        except RecursionError as error:
            raise too_deep(self._problem) from error

    def _compiled(self) -> Variant:
        softened: list[_Preference] = []
        goal = tuple(
            self._without_preferences(self._problem.goal, "the goal", softened, self._settled)
        )
        constraints = [
            tuple(self._without_preferences(given, "the constraints", softened, self._watched))
            for given in (self._domain.constraints, self._problem.constraints)
        ]
        acting = observing = None
        if softened:
            observing = self._atom("observing") if self._observed else None
            acting = self._atom("acting", initially=observing is None)
        actions = [
            copy
            for action in self._domain.actions
            for copy in self._copies(action, acting, observing)
        ]
        if acting is not None:
            settlement, goal = self._settlement(softened, goal, acting)
            actions += settlement
            if observing is not None:
                actions += self._observations(acting, observing)
        domain = replace(
            self._domain,
            predicates=(*self._domain.predicates, *self._predicates),
            constraints=constraints[0],
            actions=tuple(costed.action for costed in actions),
        )
        problem = replace(
            self._problem,
            facts=(*self._problem.facts, *self._initial),
            goal=goal,
            constraints=constraints[1],
            metric=None,
        )
        domain, problem = write_costs(domain, problem, actions, self._costs.free, self._unused)
        domain, problem = _with_constants(domain, problem)
        ignored = tuple(self._ignored)
        return Variant(domain, problem, self._steps, ignored, MOST_COMPILED_EFFECTS)

    @property
    def observes_much(self) -> bool:
        """Whether an observation has more conditional effects than planners can compile away."""
        return len(self._observed) > MOST_COMPILED_EFFECTS

    # The metric.

    def _read_metric(self) -> None:
        metric = self._problem.metric
        if metric is None:
            return
        if not self._measured:
            self._ignore("the metric", metric, "the planner knows no such metric")
            return
        try:
            weights = linear(metric.expression)
        except NotLinearError as error:
            self._ignore("the metric", error.args[0], "it is not a weighted sum")
            return
        except RecursionError as error:
            raise too_deep(self._problem) from error
        sign = 1 if metric.optimization == "minimize" else -1
        weights.pop(ONE, None)
        self._weigh({node: sign * weight for node, weight in weights.items() if weight})

    def _weigh(self, weights: Mapping[f.Node, Fraction]) -> None:
        fluents: dict[f.Fluent, Fraction] = {}
        for node, weight in weights.items():
            if isinstance(node, f.IsViolated):
                self._weights[node.preference] = weight
            elif is_function(node, f.TOTAL_TIME):
                self._weigh_time(node, weight)
            elif isinstance(node, f.Fluent):
                fluents[node] = weight
        self._costs = Costs(self._domain, self._problem, fluents)
        for fluent in fluents:
            if reason := self._costs.refused.get(fluent.function):
                self._ignore("the metric", fluent, f"it is not a sum of costs: {reason}")

    def _weigh_time(self, node: f.Node, weight: Fraction) -> None:
        if self._takes_time:
            self._ignore("the metric", node, "the duration of a plan is not a sum of costs")
        elif weight < 0:
            self._ignore("the metric", node, "longer plans would be better without limit")
        else:
            self._step_cost = weight

    def _ignore(self, where: str, construct: object, reason: str) -> None:
        text = " ".join(str(construct).split())
        self._ignored[f"{text} in {where}: {reason}"] = None

    # Preferences.

    def _without_preferences(
        self,
        nodes: Iterable[f.Formula],
        where: str,
        found: list[_Preference],
        known: Callable[[f.Formula], f.Formula] | None = None,
    ) -> Iterator[f.Formula]:
        """Yield what is not a preference; collect the instances of those that the metric counts."""
        for node in nodes:
            match node:
                case f.Preference(name, inner):
                    weight = self._weight(name, node, where)
                    if name is None or not weight:
                        continue
                    try:
                        found.append(_Preference(name, weight, known(inner) if known else inner))
                    except _NotGivenError as error:
                        self._ignore(where, node, str(error))
                case f.And(parts):
                    yield from self._without_preferences(parts, where, found, known)
                case f.Timed(time, inner) if f.mentions(f.Preference, inner):
                    own: list[_Preference] = []
                    for rest in self._without_preferences([inner], where, own, known):
                        yield f.Timed(time, rest)
                    found += [replace(one, formula=f.Timed(time, one.formula)) for one in own]
                case f.Forall(variables, inner) if f.mentions(f.Preference, inner):
                    yield from self._instances(variables, inner, where, found, known)
                case _:
                    yield node

    def _instances(
        self,
        variables: Sequence[f.TypedName],
        inner: f.Formula,
        where: str,
        found: list[_Preference],
        known: Callable[[f.Formula], f.Formula] | None,
    ) -> Iterator[f.Formula]:
        node = f.Forall(tuple(variables), inner)
        grounded = self._grounded(node)
        if grounded is None:
            self._ignore(where, node, f"it has more than {MOST_INSTANCES} instances")
            # The conditions beside the preferences still count.
            rest = tuple(hard([inner]))
            if rest:
                yield f.Forall(tuple(variables), f.And(rest))
            return
        outer, self._ignored = self._ignored, {}
        for one in grounded:
            yield from self._without_preferences([one], where, found, known)
        ignored, self._ignored = self._ignored, outer
        for text in ignored:
            # Only once, with its variables.
            self._ignore(where, node, text.rpartition(f" in {where}: ")[2])
            break

    def _grounded(self, node: f.Forall) -> list[f.Formula] | None:
        ranges = [self._objects.of(variable.types) for variable in node.variables]
        if prod(map(len, ranges)) > MOST_INSTANCES:
            return None
        keys = [fold(variable.name) for variable in node.variables]
        return [
            replaced(node.formula, dict(zip(keys, map(f.Constant, chosen), strict=True)))
            for chosen in product(*ranges)
        ]

    def _weight(self, name: str | None, node: f.Formula, where: str) -> Fraction:
        if self._measured or name is None:
            return self._weights.get(fold(name), Fraction(0)) if name else Fraction(0)
        metric = self._problem.metric
        counted = f.walk(metric) if metric else ()
        if any(isinstance(n, f.IsViolated) and fold(n.preference) == fold(name) for n in counted):
            self._ignore(where, node, "the planner knows no metric that counts it")
        return Fraction(0)

    # Satisfaction of preferences.

    def _settled(self, node: f.Formula) -> f.Formula:
        """Return the condition at the end of the plan under which a goal is satisfied."""
        if self._changes_by_itself:
            raise _NotGivenError("the state changes after the last step")
        return node

    def _watched(self, node: f.Formula) -> f.Formula:
        """Return the condition at the end of the plan under which a constraint was satisfied."""
        match node:
            case f.And(parts):
                return f.And(tuple(map(self._watched, parts)))
            case f.Forall():
                grounded = self._grounded(node)
                if grounded is None:
                    raise _NotGivenError(f"it has more than {MOST_INSTANCES} instances")
                return f.And(tuple(map(self._watched, grounded)))
            case f.Timed(time, inner) if time == f.AT_END:
                return self._settled(inner)
            case f.Modal(operator, _, parts):
                if operator not in SHARED_MODALS:
                    raise _NotGivenError(f"no planner that is known here takes {operator}")
                if self._takes_time:
                    raise _NotGivenError("a plan with durations has no step after each state")
                return self._monitor(operator, parts)
        raise _NotGivenError("it is not a constraint on the trajectory")

    def _monitor(self, operator: str, parts: Sequence[f.Formula]) -> f.Formula:
        """Watch a constraint (PDDL 3.0, section 2); all conditions are about the observed state.

        No effect changes the condition of a later one, so they can happen in sequence.
        """
        held = self._atom("held", initially=operator != "sometime")
        first, last = parts[0], parts[-1]
        broken = f.Not(held)
        if operator == "always":
            self._observed.append(f.When(f.Not(first), broken))
        elif operator == "sometime":
            self._observed.append(f.When(first, held))
        elif operator == "sometime-after":
            self._observed.append(f.When(last, held))
            self._observed.append(f.When(f.And((first, f.Not(last))), broken))
        elif operator == "sometime-before":
            seen = self._atom("seen", initially=False)
            self._observed.append(f.When(f.And((first, f.Not(seen))), broken))
            self._observed.append(f.When(last, seen))
        else:
            begun, ended = (self._atom(word, initially=False) for word in ("begun", "ended"))
            self._observed.append(f.When(f.And((ended, first)), broken))
            self._observed.append(f.When(f.And((begun, f.Not(first))), ended))
            self._observed.append(f.When(first, begun))
        return held

    def _atom(self, word: str, *, initially: bool = True) -> f.Atom:
        """Declare a proposition."""
        name = self._unused(word)
        self._predicates.append(pddl.Predicate(name))
        atom = f.Atom(name)
        if initially:
            self._initial.append(atom)
        return atom

    # Actions.

    def _copies(
        self, action: pddl.Action, acting: f.Atom | None, observing: f.Atom | None
    ) -> Iterator[CostedAction]:
        """Yield an action once for each set of its violated preferences."""
        where = f"{action.kind} {action.name}"
        softened: list[_Preference] = []
        condition = tuple(self._without_preferences(action.condition, where, softened))
        if action.kind in {pddl.PROCESS, pddl.EVENT}:
            kind = f"{'an' if action.kind == pddl.EVENT else 'a'} {action.kind}"
            for one in softened:
                self._ignore(where, one, f"{kind} happens by itself")
            yield CostedAction(replace(action, condition=condition))
            return
        cost, chosen = self._costs.of(action), self._choices(softened, where)
        for violated in product((False, True), repeat=len(chosen)):
            amount, demands = self._step_cost, list(condition)
            for one, is_violated in zip(chosen, violated, strict=True):
                if is_violated:
                    amount += one.weight
                else:
                    demands.append(one.formula)
            name = action.name
            if any(violated):
                names = [one.name for one, is_ in zip(chosen, violated, strict=True) if is_]
                name = self._unused("-".join([name, "forgoing", *names]))
                self._steps[fold(name)] = action.name
            copy = replace(action, name=name, condition=tuple(demands))
            yield CostedAction(_in_turn(copy, acting, observing), cost, amount)

    def _choices(self, softened: list[_Preference], where: str) -> list[_Preference]:
        """Return the preferences of an action that its copies may violate, the heaviest first."""
        possible = []
        for one in softened:
            if one.is_rewarded:
                # Costs are paid per step, so each step that satisfies it would pay again.
                self._ignore(where, one, "the more steps violate it, the better is the metric")
            else:
                possible.append(one)
        possible.sort(key=lambda one: -one.weight)
        for one in possible[MOST_CHOICES:]:
            reason = f"an action is copied for {MOST_CHOICES} preferences at most"
            self._ignore(where, one, reason)
        return possible[:MOST_CHOICES]

    def _settlement(
        self, softened: Sequence[_Preference], goal: tuple[f.Formula, ...], acting: f.Atom
    ) -> tuple[list[CostedAction], tuple[f.Formula, ...]]:
        """Return the steps at the end of the plan, and the goal that they reach."""
        turn = self._atom("settled", initially=False)
        steps = [self._step("end-of-plan", (acting, *goal), (f.Not(acting), turn))]
        for one in softened:
            after = self._atom("settled", initially=False)
            # Without delete: Fast Downward would search for invariants in all sets of these atoms.
            effect = (after,)
            satisfied: tuple[f.Formula, ...] = (turn, one.formula)
            violated: tuple[f.Formula, ...] = (turn,)
            if one.is_rewarded:
                satisfied, violated = (turn,), (turn, f.Not(one.formula))
            collect = self._step(f"collect-{one.name}", satisfied, effect)
            forgo = self._step(f"forgo-{one.name}", violated, effect)
            costly = collect if one.is_rewarded else forgo
            steps += [collect, forgo]
            steps[steps.index(costly)] = replace(costly, amount=abs(one.weight))
            turn = after
        return steps, (turn,)

    def _observations(self, acting: f.Atom, observing: f.Atom) -> Iterator[CostedAction]:
        """Yield the step that observes a state, or several of them in a chain."""
        parts = [(one,) for one in self._observed] if self._chained else [tuple(self._observed)]
        turn = observing
        for number, effects in enumerate(parts, 1):
            after = acting if number == len(parts) else self._atom("observing", initially=False)
            yield self._step("observe", (turn,), (*effects, f.Not(turn), after))
            turn = after

    def _step(
        self, name: str, condition: tuple[f.Formula, ...], effect: tuple[f.Formula, ...]
    ) -> CostedAction:
        """Make an action that plans leave out."""
        chosen = self._unused(name)
        self._steps[fold(chosen)] = None
        return CostedAction(pddl.Action(pddl.ACTION, chosen, (), (), condition, effect))


def _with_constants(domain: pddl.Domain, problem: pddl.Problem) -> tuple[pddl.Domain, pddl.Problem]:
    """Make the objects that the domain mentions constants."""
    nodes = f.walk(*pddl.formulas(domain))
    mentioned = {fold(node.name) for node in nodes if isinstance(node, f.Constant)}
    mentioned -= {fold(part.name) for part in domain.constants}
    constants = [part for part in problem.objects if fold(part.name) in mentioned]
    objects = tuple(part for part in problem.objects if fold(part.name) not in mentioned)
    domain = replace(domain, constants=(*domain.constants, *constants))
    return domain, replace(problem, objects=objects)


def _in_turn(action: pddl.Action, acting: f.Atom | None, observing: f.Atom | None) -> pddl.Action:
    """Allow an action only before the end of the plan, and each one after an observation."""
    if acting is None:
        return action
    if action.kind == pddl.DURATIVE_ACTION:
        turn = tuple(f.Timed(time, acting) for time in f.TIMES)
        return replace(action, condition=(*action.condition, *turn))
    effect = action.effect
    if observing is not None:
        effect = (*effect, f.Not(acting), observing)
    return replace(action, condition=(*action.condition, acting), effect=effect)
