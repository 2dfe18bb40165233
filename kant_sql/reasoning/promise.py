"""One condition on the state before a step: it can begin if and only if the condition holds.

A step can begin if its objects fit, its duration is allowed, its conditions at the start hold, its
effects at the start have results, and its conditions over all hold right after them. The same
condition judges a step, explains why it cannot begin, and finds all steps of an action.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from ..dto import formulas as f
from ..dto.formulas import AT_START, OVER_ALL, TOTAL_COST
from ..dto.lexical import fold
from ..errors import NotApplicableError, TypeMismatchError, UnsupportedConstructError
from ..knowledge import resolved as r
from ..knowledge.atoms import FluentKey
from ..knowledge.grounding import bound, substitute
from ..knowledge.reads import Head, heads_of
from ..knowledge.rules import rules_of
from ..sql.answers import GUARDS
from ..sql.relations import ConditionStatement
from ..store.snapshot import DefinitionsMovedError, View
from .after import After, OpaqueError, is_linear, mapped, with_numbers
from .arithmetic import ADDITIVE, EXACT, SCALING, Exact
from .ask import OF_TRUTHS, asked, given_numbers, question, statement_key
from .effects import EffectReader, StepChanges, settled
from .explain import Changed, Explainer, number_of
from .failures import TOLERANCE, FailedCondition, duration_failure
from .steps import CONTINUOUS, EffectItem, GroundStep, PreparedAction, misfits

AFTER_START = "right after the start"
_LASTING = r.Parameter(f.DURATION)
_HALF = Decimal("0.5")
Numbers = dict[str, Decimal]


@dataclass(frozen=True)
class Promise:
    """The condition under which steps of an action can begin."""

    part: r.Part  # the condition
    is_whole: bool  # whether it is complete; if not, judge conditions over all for each step
    listed: r.Part  # the same for steps without a duration, including the constraints on it


def promise_of(action: PreparedAction) -> Promise:
    """Return the condition under which steps of an action can begin."""
    return action.kept(Promise, lambda: _promise(action))


def _promise(action: PreparedAction) -> Promise:
    items = action.items(AT_START)
    conflicts = (
        _conflict(action, one, other)
        for number, one in enumerate(items)
        for other in items[number:]
    )
    parts = [action.condition(AT_START), *(_has_result(action, each) for each in items), *conflicts]
    is_whole = True
    if action.is_durative:
        try:
            kept = After(action.definitions, items, action.numbers).part(action.condition(OVER_ALL))
            r.check_levels(kept)
            parts.append(kept)
        except (OpaqueError, UnsupportedConstructError):
            is_whole = False
    part = r.all_of(parts)
    return Promise(part, is_whole, _with_duration(action, part) if action.is_durative else part)


def _fresh(action: PreparedAction, bound: Sequence[r.Bound], part: r.Part) -> r.Part:
    """Quantify a part existentially, with variables that no other part has."""
    whole = r.Witness(tuple(bound), part) if bound and part != r.FALSE else part
    return r.replaced(whole, {}, action.numbers)


def _has_result(action: PreparedAction, item: EffectItem) -> r.Part:
    """Make the condition that an effect has a result wherever it takes place."""
    lacking = _fresh(action, item.around, item.lacking)
    wanted = r.all_of([*_types_fit(action, item), *_is_defined(action, item)])
    if wanted == r.TRUE:
        return r.negate(lacking)
    wrong = _fresh(action, item.bound, r.all_of([item.condition, r.negate(wanted)]))
    return r.all_of([r.negate(lacking), r.negate(wrong)])


def _types_fit(action: PreparedAction, item: EffectItem) -> Iterator[r.Part]:
    """Yield the conditions that objects fit, if their variables have wider types."""
    definitions = action.definitions
    declared = definitions.predicates, definitions.functions
    head = declared[item.operator not in ("add", "delete")].live(item.head)
    places: list[tuple[r.Place, r.TypeSet]] = [
        (term, r.closure(definitions, parameter.type_ids))
        for term, parameter in zip(item.terms, head.parameters, strict=True)
    ]
    if isinstance(item.value, r.Slot | r.Known):
        wanted_ids = definitions.functions.live(item.head).type_ids
        places.append((item.value, r.closure(definitions, wanted_ids)))
    types = {each.slot: each.types for each in (*action.parameters, *item.bound)}
    for term, wanted in places:
        if wanted is None:
            continue
        if isinstance(term, r.Known):
            if not r.fits(definitions, term.id, wanted):
                yield r.FALSE
        elif not any(own is not None and own <= wanted for own in types[term]):
            yield r.HasType(term, wanted)


def _is_defined(action: PreparedAction, item: EffectItem) -> Iterator[r.Part]:
    """Yield the conditions that a number and the fluent that it changes have values."""
    value = item.value
    if value is None or isinstance(value, r.Slot | r.Known):
        return
    if any(not isinstance(each, Decimal) for each in r.parts_of(value)):
        yield r.Compares("=", value, value)
    function = action.definitions.functions.live(item.head)
    is_cost = fold(function.name) == TOTAL_COST and not function.parameters
    if item.operator != "assign" and not is_cost:
        own = r.NumberOf(item.head, item.terms)
        yield r.Compares("=", own, own)
    if item.operator == "scale-down":
        yield r.Lacks(r.Compares("=", value, Decimal(0)))


def _conflict(action: PreparedAction, one: EffectItem, other: EffectItem) -> r.Part:
    """Make the condition that two effects do not change one fluent in conflicting ways."""
    operators = {one.operator, other.operator}
    is_same_kind = operators <= ADDITIVE or operators <= SCALING
    is_other = one.head != other.head or not operators.isdisjoint(("add", "delete"))
    if is_other or is_same_kind or (one is other and not one.bound):
        return r.TRUE
    places: dict[r.Slot, r.Place] = {
        each.slot: r.Slot(next(action.numbers)) for each in other.bound
    }
    copied = tuple(r.Bound(places[each.slot], each.types) for each in other.bound)  # type: ignore[arg-type]
    terms = [places.get(each, each) if isinstance(each, r.Slot) else each for each in other.terms]
    hit = [r.same(left, right) for left, right in zip(one.terms, terms, strict=True)]
    differ: r.Part = r.TRUE
    if operators == {"assign"}:
        differ = r.negate(_equal(one.value, other.value, places, action.numbers))
    inner = [one.condition, r.replaced(other.condition, dict(places), action.numbers), *hit, differ]
    return r.negate(_fresh(action, (*one.bound, *copied), r.all_of(inner)))


def _equal(
    left: r.Quantity | r.Place | None,
    right: r.Quantity | r.Place | None,
    places: dict[r.Slot, r.Place],
    numbers: Iterator[int],
) -> r.Part:
    """Make the condition that two assigned values are equal."""
    assert left is not None
    assert right is not None
    if isinstance(left, r.Slot | r.Known) and isinstance(right, r.Slot | r.Known):
        return r.same(left, places.get(right, right) if isinstance(right, r.Slot) else right)
    moved: r.Quantity = r.replaced(right, dict(places), numbers)  # type: ignore[arg-type, assignment]
    assert not isinstance(left, r.Slot | r.Known)
    return r.Compares("=", left, moved)


# Durations.


def limits_of(action: PreparedAction) -> list[tuple[str, r.Quantity, r.Needed]]:
    """Return the constraints on the duration at the start, with their limits and conditions."""
    found = []
    for constraint in action.constraints(AT_START):
        operator, side = constraint.operator, constraint.right
        if constraint.right == f.Variable(f.DURATION):
            operator, side = f.MIRRORED[operator], constraint.left
        limit, needed = action.resolver.number(side)
        found.append((operator, limit, needed))
    return found


def _with_duration(action: PreparedAction, part: r.Part) -> r.Part:
    """Return the condition under which steps without a duration can begin."""
    limits = limits_of(action)
    fixed = next((limit for operator, limit, _ in limits if operator == "="), None)
    if fixed is None and action.needs_duration:
        return r.FALSE
    numbers = [limit for _, limit, _ in limits if not isinstance(limit, Decimal)]
    parts = [part, *(r.Compares("=", each, each) for each in numbers)]
    if fixed is not None:
        values: dict[r.Quantity, r.Quantity] = {_LASTING: fixed}
        parts[0] = mapped(
            part, lambda one, _: with_numbers(one, values) if isinstance(one, r.Compares) else one
        )
        parts += [
            each
            for operator, limit, _ in [*limits, (">=", Decimal(0), None)]
            if limit is not fixed
            for each in _within(operator, fixed, limit, TOLERANCE if limit else Decimal(0))
        ]
    else:
        lower = [limit for operator, limit, _ in limits if operator in (">", ">=")]
        upper = [limit for operator, limit, _ in limits if operator in ("<", "<=")]
        for most in upper:
            parts += _within("<=", Decimal(0), most, TOLERANCE)
            for least in lower:
                parts += _within("<=", least, most, 2 * TOLERANCE)
    variables = tuple(each for _, _, needed in limits for each in needed.bound)
    inner = r.all_of([*(each for _, _, needed in limits for each in needed.needed), *parts])
    return r.Witness(variables, inner) if variables and inner != r.FALSE else inner


def _within(
    operator: str, left: r.Quantity, right: r.Quantity, tolerance: Decimal
) -> Iterator[r.Part]:
    """Yield the conditions that a comparison holds within a tolerance."""
    difference = r.Operation("-", (left, right))
    if operator in ("<", "<=", "="):
        yield r.Compares("<" if operator == "<" else "<=", difference, tolerance)
    if operator in (">", ">=", "="):
        yield r.Compares(">" if operator == ">" else ">=", difference, -tolerance)


def duration_of(
    view: View, step: GroundStep, time: str, known: Decimal | None
) -> tuple[Numbers, list[FailedCondition]]:
    """Find the duration that a constraint at a time fixes, and check it against all of them."""
    duration, action = known, step.action
    binding = bound(action.variables, step.names)
    found: list[tuple[f.Comparison, bool, Decimal | None]] = []
    for constraint in action.constraints(time):
        closed = substitute(constraint, binding)
        is_left = constraint.left == f.Variable(f.DURATION)
        limit = number_of(view, closed.right if is_left else closed.left, {})
        found.append((closed, is_left, limit))
        if duration is None and constraint.operator == "=":
            duration = limit
    failed = []
    for closed, is_left, limit in found:
        if duration is not None or limit is None:
            failed += duration_failure(
                closed, *((duration, limit) if is_left else (limit, duration))
            )
    if duration is None and not failed:
        failed = [*_contradictions(found)]
    if duration is not None:
        return {f.DURATION: duration}, failed + no_duration(step, duration)
    return {}, failed or no_duration(step, duration)


def no_duration(step: GroundStep, duration: Decimal | None) -> list[FailedCondition]:
    """Return the fault of a negative duration, or of a missing one that matters."""
    if duration is not None and duration < 0:
        return [FailedCondition("(>= ?duration 0)", f"the duration is {duration:f}")]
    if duration is None and step.action.needs_duration:
        reason = f"is not given; write it after the step, as in '{step} [5]'"
        return [FailedCondition("?duration", reason)]
    return []


def _contradictions(
    found: Sequence[tuple[f.Comparison, bool, Decimal | None]],
) -> Iterator[FailedCondition]:
    """Yield the bounds that exclude each other."""
    least: list[tuple[str, Decimal]] = [("0", Decimal(0))]
    most: list[tuple[str, Decimal]] = []
    for closed, is_left, limit in found:
        operator = closed.operator if is_left else f.MIRRORED[closed.operator]
        assert limit is not None
        (least if operator in (">", ">=") else most).append((str(closed), limit))
    for upper, high in most:
        for lower, low in least:
            allowed = TOLERANCE if lower == "0" else 2 * TOLERANCE
            if low - high > allowed:
                text = upper if lower == "0" else f"(and {lower} {upper})"
                reason = f"no duration is from {low:f} to {high:f}"
                yield FailedCondition(text, reason, low, high)


# Judging of steps.


def judge(view: View, step: GroundStep) -> tuple[Numbers, list[FailedCondition]]:
    """Return the duration of a step, and why it cannot begin; nothing if it can."""
    is_same = step.action.definitions is view.definitions
    wrong = step.misfits if is_same else misfits(view.definitions, step)
    if wrong:
        # No statement has compared the definitions with the head yet.
        _need_snapshot(view)
        return {}, wrong
    action = step.action
    if action.is_durative:
        check_linear(action)
        _need_snapshot(view)
    numbers: Numbers = {} if step.duration is None else {f.DURATION: step.duration}
    if action.is_durative:
        numbers, wrong = duration_of(view, step, AT_START, step.duration)
        if wrong:
            return numbers, wrong
    promise = promise_of(action)
    if not is_true(view, step, None, numbers):
        failed = _explain(view, step, numbers)
        return numbers, failed or [FailedCondition(str(step), "its condition does not hold")]
    return numbers, [] if promise.is_whole else _explain(view, step, numbers)


def _need_snapshot(view: View) -> None:
    """Require that several statements see one state."""
    if view.definition_revision is not None:
        raise DefinitionsMovedError


def is_true(view: View, step: GroundStep, time: str | None, numbers: Mapping[str, Decimal]) -> bool:
    """Return whether a step can begin, or with a time, whether its conditions at it hold."""
    action = step.action
    key = ("truth", time, *statement_key(view, numbers))

    def write() -> ConditionStatement:
        part = promise_of(action).part if time is None else action.condition(time)
        return question(view, numbers).truths([part], step.places)

    statement = action.kept(key, write)
    given = {**step.values, **given_numbers(numbers)} if numbers else step.values
    [row] = asked(view, statement, given, OF_TRUTHS)
    return bool(row[GUARDS])


def _explain(view: View, step: GroundStep, numbers: Numbers) -> list[FailedCondition]:
    """Return the failing conditions at start, or effects at start, or invariants."""
    _need_snapshot(view)
    failed = Explainer(view, numbers).failed(closed_nodes(step, AT_START))
    if failed:
        return failed
    try:
        read = EffectReader(view, step, numbers).read(step.action.items(AT_START))
    except NotApplicableError as error:
        return [*error.unsatisfied]
    except TypeMismatchError as error:
        return [FailedCondition(str(step), str(error))]
    items, failed = settled(view, read)
    if failed or not step.action.is_durative:
        return failed
    changed = Changed(view.definitions, items, AFTER_START)
    return Explainer(view, numbers, changed).failed(closed_nodes(step, OVER_ALL))


def closed_nodes(step: GroundStep, time: str) -> list[f.Formula]:
    """Return the conditions at a time with the objects of a step."""
    binding = bound(step.action.variables, step.names)
    return [substitute(node, binding) for node in step.action.nodes(time)]


# Continuous change.


def changing(action: PreparedAction) -> set[Head]:
    """Return the functions that an action changes continuously."""
    return {(False, item.head) for item in action.items(CONTINUOUS)}


def check_linear(action: PreparedAction) -> None:
    """Refuse nonlinear continuous change, or a condition over all that cannot be followed."""
    items, heads = action.items(CONTINUOUS), changing(action)
    functions = action.definitions.functions
    for item in items:
        for number in item.numbers:
            if (False, number.function) in heads:
                name = functions.live(number.function).name
                raise UnsupportedConstructError(
                    f"the action {action.name} changes {functions.live(item.head).name} "
                    f"continuously at a rate that depends on {name}, which it changes, too: "
                    "that is not linear in time, and only linear change can be executed"
                )
    rules = rules_of(action.definitions)
    for node in action.nodes(OVER_ALL) if items else ():
        part = action.resolver.part(node)
        if not is_linear(part, heads, rules):
            names = ", ".join(functions.live(head).name for _, head in sorted(heads))
            raise UnsupportedConstructError(
                f"the action {action.name} has the condition over all {node}, which cannot be "
                f"followed while {names} changes continuously; comparisons that are linear in time "
                "can, in conjunctions and universal quantifiers"
            )


def is_executable(action: PreparedAction) -> bool:
    """Return whether its continuous change, if any, can be executed."""
    try:
        check_linear(action)
    except UnsupportedConstructError:
        return False
    return True


def until_end(
    view: View, step: GroundStep, numbers: Mapping[str, Decimal]
) -> list[FailedCondition]:
    """Return the conditions over all that fail before the end, if time passes as planned."""
    nodes, heads = closed_nodes(step, OVER_ALL), changing(step.action)
    kept = step.action.condition(OVER_ALL)
    if not heads or heads_of(rules_of(view.definitions), kept).isdisjoint(heads):
        is_kept = is_true(view, step, OVER_ALL, numbers)
        return [] if is_kept else Explainer(view, numbers).failed(nodes)
    reader = EffectReader(view, step, numbers)
    read = reader.read(step.action.items(CONTINUOUS))
    moments = (Decimal(0), AFTER_START), (Decimal(1), "at the end"), (_HALF, "halfway")
    for share, said in moments:
        assignments: dict[FluentKey, tuple[str, list[tuple[str, Exact | int]]]] = {
            key: (text, [(operator, _times(by, share)) for operator, by in made])
            for key, (text, made) in read.assignments.items()
        }
        items, failed = settled(view, StepChanges(assignments=assignments))
        loosened = None if share == _HALF else heads
        changed = Changed(view.definitions, items, said, loosened)
        failed = failed or Explainer(view, numbers, changed).failed(nodes)
        if failed:
            return failed
    return []


def _times(by: Exact | int, share: Decimal) -> Exact:
    found = EXACT.apply("*", Decimal(by) if isinstance(by, int) else by, share)
    assert found is not None
    return found
