"""What of a condition does not hold, part by part."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from .. import html
from ..dto import formulas as f
from ..dto.lexical import fold
from ..history.revisions import Revision
from .arithmetic import Exact, decimal_of
from .conditions import Compiler, Condition, Conditions, Env
from .grounding import Binding, substitute
from .junctions import Literal, junction
from .world import World

# What notebooks call one of a list.
FAILED = "failed condition"
# Parts of one universal quantifier that are named.
MAX_INSTANCES = 20
# How far a duration may be from what its constraints allow, as in VAL.
TOLERANCE = Decimal("0.01")
# A comparison of a duration with its limit -> whether their difference satisfies it.
_ALLOWS: dict[str, Callable[[Decimal], bool]] = {
    "=": lambda difference: abs(difference) <= TOLERANCE,
    "<=": lambda difference: difference <= TOLERANCE,
    "<": lambda difference: difference < TOLERANCE,
    ">=": lambda difference: difference >= -TOLERANCE,
    ">": lambda difference: difference > -TOLERANCE,
}


@dataclass(frozen=True)
class FailedCondition:
    """A part of a condition that does not hold, or another reason why a step fails.

    Attributes:
        condition: the part as PDDL text, with objects for its variables.
        reason: why it fails.
        left: the value of the left side of a comparison; None without a value.
        right: the value of its right side.
        retracted: for a fact that held before, the revision that retracted it, with its time,
            actor and reason.
    """

    condition: str
    reason: str
    left: Decimal | None = None
    right: Decimal | None = None
    retracted: Revision | None = None

    def __str__(self) -> str:
        return f"{self.condition}: {self.reason}"

    def _html_row_(self) -> html.Row:
        by = self.retracted
        return {
            "condition": self.condition,
            "reason": self.reason,
            "left": self.left,
            "right": self.right,
            "retracted in": None if by is None else by.number,
            "retracted at": None if by is None else by.committed_at,
            "who, why, source": None if by is None else tuple(by.said()),
        }

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_())


def duration_failure(
    constraint: f.Comparison, left: Decimal | None, right: Decimal | None
) -> FailedCondition | None:
    """Return how the sides of a constraint on a duration violate it, if they do."""
    if left is not None and right is not None and _ALLOWS[constraint.operator](left - right):
        return None
    reason = f"{sides_text(left, right)}; a duration may deviate by {TOLERANCE}"
    return FailedCondition(str(constraint), reason, left, right)


def failed_parts(
    world: World,
    conditions: Conditions,
    formula: f.Formula,
    binding: Binding,
    duration: Decimal | None = None,
) -> Iterator[FailedCondition]:
    """Yield the parts of a condition that do not hold.

    Conjunctions and universal quantifiers are taken apart; of the latter, the first
    `MAX_INSTANCES` counterexamples are named.

    Args:
        world: the state.
        conditions: its compiled conditions.
        formula: the condition.
        binding: the objects of its free variables.
        duration: the value of `?duration`.
    """
    stack: list[tuple[f.Formula, bool, Binding, _Truths | None]]
    stack = [(formula, False, binding, None)]
    while stack:
        part, negated, names, truths = stack.pop()
        if truths is None:
            truths = _truths(world, part, negated, names, duration)
        if truths[id(part), negated]:
            continue
        inner = _parts(part, negated)
        if inner is not None and inner[1]:
            stack.extend((one, flag, names, truths) for one, flag in reversed(inner[0]))
        elif isinstance(part, f.Exists if negated else f.Forall):
            assert isinstance(part, f.Forall | f.Exists)
            found = _counterexamples(world, part, negated, names, duration)
            stack.extend((part.formula, negated, one, None) for one in reversed(found))
        else:
            yield _failure(conditions, part, negated, names, duration)


# Whether each part of a formula holds, by its id and whether it is negated.
_Truths = dict[tuple[int, bool], bool]


def _parts(part: f.Formula, negated: bool) -> tuple[list[Literal], bool] | None:
    """Return the parts of a junction; a preference is one without parts, which holds."""
    if isinstance(part, f.Preference):
        return [], True
    if isinstance(part, f.Timed):
        return [(part.formula, negated)], True
    return junction(part, negated)


def _truths(
    world: World, formula: f.Formula, negated: bool, binding: Binding, duration: Decimal | None
) -> _Truths:
    """Evaluate all parts of a formula, each once."""
    parameters = [f.TypedName(name) for name in binding]
    order: list[Literal] = []
    stack: list[Literal] = [(formula, negated)]
    while stack:
        order.append(stack.pop())
        inner = _parts(*order[-1])
        stack.extend(inner[0] if inner is not None else ())
    truths: _Truths = {}
    for part, flag in reversed(order):
        key, inner = (id(part), flag), _parts(part, flag)
        if key in truths:
            continue
        if inner is None:
            holds = Condition(world, part, parameters).holds(tuple(binding.values()), duration)
            truths[key] = holds != flag
        else:
            values = (truths[id(one), each] for one, each in inner[0])
            truths[key] = all(values) if inner[1] else any(values)
    return truths


def _counterexamples(
    world: World,
    part: f.Forall | f.Exists,
    negated: bool,
    binding: Binding,
    duration: Decimal | None,
) -> list[Binding]:
    """Return bindings for which the inner formula fails, in the order of declaration."""
    compiler = Compiler(world, [f.TypedName(name) for name in binding])
    search, slots = compiler.open_search(part.variables, [(part.formula, not negated)])
    env: Env = compiler.template.copy()
    env[: len(binding)] = binding.values()
    env[compiler.duration] = duration
    found = {tuple([env[slot] for slot in slots]) for _ in search(env)}
    order = {name: number for number, name in enumerate(world.objects)}
    rows = sorted(found, key=lambda row: [order[name] for name in row])[:MAX_INSTANCES]
    names = [fold(one.name) for one in part.variables]
    return [{**binding, **dict(zip(names, row, strict=True))} for row in rows]


def _failure(
    conditions: Conditions,
    part: f.Formula,
    negated: bool,
    binding: Binding,
    duration: Decimal | None,
) -> FailedCondition:
    ground = substitute(part, binding)
    text = str(f.Not(ground) if negated else ground)
    if isinstance(part, f.Comparison):
        left = conditions.exact_number(part.left, binding, duration)
        right = conditions.exact_number(part.right, binding, duration)
        return failed_comparison(text, left, right)
    return FailedCondition(text, "does not hold")


def failed_comparison(
    text: str, left: Exact | None, right: Exact | None, when: str = ""
) -> FailedCondition:
    """Say what the sides of a comparison are that does not hold."""
    first, second = (None if side is None else decimal_of(side) for side in (left, right))
    return FailedCondition(text, f"{sides_text(left, right)}{when}", first, second)


def sides_text(left: Exact | None, right: Exact | None) -> str:
    """Write the values of both sides of a comparison."""
    return f"the sides are {_side(left)} and {_side(right)}"


def _side(side: Exact | None) -> str:
    if side is None:
        return "no value"
    number = decimal_of(side)
    text = f"{number:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    if number == side:
        return text
    fraction = str(Fraction(side))
    return fraction if len(fraction) <= len(text) else f"about {text}"
