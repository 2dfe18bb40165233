"""Trajectory constraints of PDDL 3.0, judged while the states of a trajectory pass by.

A trajectory is a sequence of states with times. The semantics is that of Gerevini, Haslum, Long,
Saetti and Dimopoulos, Deterministic planning in the fifth international planning competition:
PDDL3 and experimental evaluation of the planners (Artificial Intelligence 173, 2009), section 2.
For states S0, S1 ... Sn at times t0 <= t1 ... <= tn:

- `(always A)`: A holds in all states.
- `(sometime A)`: A holds in some state.
- `(within t A)`: A holds in some state Si with ti <= t.
- `(at-most-once A)`: the states in which A holds are consecutive.
- `(sometime-after A B)`: for each Si in which A holds, B holds in some Sj with j >= i.
- `(sometime-before A B)`: for each Si in which A holds, B holds in some Sj with j < i.
- `(always-within t A B)`: for each Si in which A holds, B holds in some Sj with j >= i and
  tj - ti <= t.
- `(hold-during t u A)`: A holds in each Si with t <= ti < u, and, if t < u, in the state at t:
  the last Si with ti <= t, if a later state follows.
- `(hold-after t A)`: A holds in each Si with t <= ti, and in the state at t, likewise.
- `(at end A)`: A holds in Sn.

`forall` around a preference makes one preference for each object; `forall` and `and` inside one
belong to it. Modal operators do not nest, and `or`, `not` and `imply` do not contain them.

A monitor keeps the same few values, however long the trajectory is. VAL deviates:
- it treats the time of `hold-after` as 0, which makes it `always`;
- it judges a window of `hold-during` only by the first state inside it, by the state before a
  happening if an invariant is checked at that time, and not at all if no state is inside it;
- it counts `(preference p (and ...))` once for each violated conjunct.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from itertools import product

from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError
from ..knowledge.grounding import Binding, bound, substitute

# Whether a formula holds in the present state, for a binding of its free variables.
Truth = Callable[[f.Formula, Binding], bool]
# The names of the objects that a variable ranges over.
Range = Callable[[f.TypedName], Sequence[str]]


@dataclass(frozen=True, slots=True, order=True)
class Moment:
    """The place of a state in its trajectory, from 0, and its time."""

    index: int
    time: Decimal


class Monitor(ABC):
    """Judges one modal formula; a violation is final, whatever states follow."""

    def __init__(self, formula: f.Modal | f.Timed, binding: Binding) -> None:
        self.formula = formula
        self.binding = binding
        self.violation: Moment | None = None
        self.last: Moment | None = None  # the last judged state
        self.inner = formula.formulas if isinstance(formula, f.Modal) else (formula.formula,)
        self._first, self._second = self.inner[0], self.inner[-1]
        self._times = [one.value for one in getattr(formula, "numbers", ())]

    def observe(self, now: Moment, holds: Truth) -> None:
        """Judge the next state, by `holds`."""
        self.last = now
        if self.violation is None:
            self._judge(now, holds)

    @abstractmethod
    def _judge(self, now: Moment, holds: Truth) -> None: ...

    def open(self) -> Moment | None:
        """Return the state that violates it if the last one is the end; None if none does."""
        return None

    @property
    def key(self) -> tuple[str, tuple[str, ...]]:
        """Its identity, in any world."""
        names = (f"{fold(name)} {value}" for name, value in self.binding.items())
        return fold(str(self.formula)), tuple(sorted(names))

    def conclude(self) -> None:
        """Judge the trajectory after its last state."""
        moment = self.open()
        if moment is not None:
            self._violate(moment)

    def _violate(self, moment: Moment) -> None:
        if self.violation is None:
            self.violation = moment


class _Always(Monitor):
    def _judge(self, now: Moment, holds: Truth) -> None:
        if not holds(self._first, self.binding):
            self._violate(now)


class _Sometime(Monitor):
    _is_met = False

    def _judge(self, now: Moment, holds: Truth) -> None:
        del now
        self._is_met = self._is_met or holds(self._first, self.binding)

    def open(self) -> Moment | None:
        return None if self._is_met else self.last


class _Within(_Sometime):
    def _judge(self, now: Moment, holds: Truth) -> None:
        if not self._is_met and now.time > self._times[0]:
            self._violate(now)
        else:
            super()._judge(now, holds)


class _AtMostOnce(Monitor):
    _has_held = False
    _holds = False

    def _judge(self, now: Moment, holds: Truth) -> None:
        held, self._holds = self._holds, holds(self._first, self.binding)
        if self._holds and not held and self._has_held:
            self._violate(now)
        self._has_held = self._has_held or self._holds


class _SometimeAfter(Monitor):
    # The first state that still waits for the second formula.
    _waiting: Moment | None = None

    def _judge(self, now: Moment, holds: Truth) -> None:
        if self._waiting is None and not holds(self._first, self.binding):
            return
        self._waiting = self._waiting or now
        if holds(self._second, self.binding):
            self._waiting = None

    def open(self) -> Moment | None:
        return self._waiting


class _AlwaysWithin(_SometimeAfter):
    def _judge(self, now: Moment, holds: Truth) -> None:
        waiting = self._waiting
        if waiting is not None and now.time - waiting.time > self._times[0]:
            self._violate(waiting)
        else:
            super()._judge(now, holds)


class _SometimeBefore(Monitor):
    _is_met = False

    def _judge(self, now: Moment, holds: Truth) -> None:
        if self._is_met:
            return
        if holds(self._first, self.binding):
            self._violate(now)
        self._is_met = holds(self._second, self.binding)


class _HoldDuring(Monitor):
    # The last state up to the beginning of the window, if the formula does not hold in it.
    _failing: Moment | None = None

    def __init__(self, formula: f.Modal | f.Timed, binding: Binding) -> None:
        super().__init__(formula, binding)
        self._end = self._times[1] if len(self._times) > 1 else Decimal("Infinity")

    def _judge(self, now: Moment, holds: Truth) -> None:
        begin = self._times[0]
        if self._failing is not None and now.time > begin:
            self._violate(self._failing)
        elif max(begin, now.time) < self._end and not holds(self._first, self.binding):
            if now.time >= begin:
                self._violate(now)
            else:
                self._failing = now
                return
        self._failing = None


class _AtEnd(Monitor):
    _holds = True

    def _judge(self, now: Moment, holds: Truth) -> None:
        del now
        self._holds = holds(self._first, self.binding)

    def open(self) -> Moment | None:
        return None if self._holds else self.last


_MONITORS: dict[str, type[Monitor]] = {
    "always": _Always,
    "sometime": _Sometime,
    "within": _Within,
    "at-most-once": _AtMostOnce,
    "sometime-after": _SometimeAfter,
    "sometime-before": _SometimeBefore,
    "always-within": _AlwaysWithin,
    "hold-during": _HoldDuring,
    "hold-after": _HoldDuring,
}


@dataclass(frozen=True)
class Rule:
    """A constraint, or one instance of a preference, with monitors of its modal formulas."""

    formula: f.Formula  # the constraint; the whole preference, if it is one
    binding: Binding  # the objects of the variables of quantifiers around it
    # The name of the preference; None for a hard constraint or without a name.
    preference: str | None
    is_soft: bool  # whether it is a preference
    monitors: list[Monitor] = field(repr=False)

    @property
    def violation(self) -> Moment | None:
        """The first state that violates it; None while it is satisfied or undecided."""
        found = [one.violation for one in self.monitors if one.violation is not None]
        return min(found, default=None)

    @property
    def is_open(self) -> bool:
        """Whether it is violated unless a later state fulfils it."""
        return self.violation is None and any(one.open() is not None for one in self.monitors)

    @property
    def violated(self) -> tuple[Monitor, ...]:
        """The monitors whose formulas are violated."""
        return tuple([one for one in self.monitors if one.violation is not None])

    def meet(self, other: Rule) -> list[Monitor]:
        """Add the monitors of the same rule in another world; return those that count there."""
        if not self.is_soft:
            return self.monitors
        # A quantifier within a preference has a monitor for each object of the world.
        own = {one.key: one for one in self.monitors}
        found = [own.setdefault(one.key, one) for one in other.monitors]
        self.monitors[:] = own.values()
        return found

    def __str__(self) -> str:
        return str(substitute(self.formula, self.binding))


class Trajectory:
    """Judges constraints as states are observed; `objects` returns those of a variable's types."""

    def __init__(self, constraints: Iterable[f.Formula], objects: Range) -> None:
        """Create the monitors."""
        self.rules = tuple([rule for one in constraints for rule in rules_of(one, objects)])
        self._monitors = [monitor for rule in self.rules for monitor in rule.monitors]
        self.last: Moment | None = None

    def observe(self, time: Decimal, holds: Truth) -> None:
        """Judge the next state."""
        now = self.last = Moment(0 if self.last is None else self.last.index + 1, time)
        for monitor in self._monitors:
            monitor.observe(now, holds)

    def conclude(self) -> None:
        """Judge the trajectory after its last state."""
        for monitor in self._monitors:
            monitor.conclude()

    def violated(self) -> list[Rule]:
        """Return the rules that have been violated so far."""
        return [rule for rule in self.rules if rule.violation is not None]


def rules_of(constraint: f.Formula, objects: Range) -> Iterator[Rule]:
    """Yield the rules of a constraint, whose quantifiers and preferences are outermost."""
    for part, binding in _parts(constraint, {}, objects):
        if isinstance(part, f.Preference):
            inner = _parts(part.formula, binding, objects)
            monitors = [_monitor(one, names) for one, names in inner]
            yield Rule(part, binding, part.name, True, monitors)
        else:
            yield Rule(part, binding, None, False, [_monitor(part, binding)])


def _parts(
    constraint: f.Formula, binding: Binding, objects: Range
) -> Iterator[tuple[f.Formula, Binding]]:
    """Yield the parts of conjunctions and universal quantifiers, in order."""
    if isinstance(constraint, f.And):
        for part in constraint.formulas:
            yield from _parts(part, binding, objects)
    elif isinstance(constraint, f.Forall):
        for names in product(*map(objects, constraint.variables)):
            own = bound(constraint.variables, names)
            yield from _parts(constraint.formula, {**binding, **own}, objects)
    else:
        yield constraint, binding


def _monitor(part: f.Formula, binding: Binding) -> Monitor:
    if isinstance(part, f.Count):
        part = f.Modal("always", (), (part,))
    if isinstance(part, f.Timed) and part.time == f.AT_END:
        kind: type[Monitor] | None = _AtEnd
    else:
        kind = _MONITORS.get(part.operator) if isinstance(part, f.Modal) else None
    if kind is None:
        raise _unsupported(
            part, "a trajectory constraint is a modal operator, such as (always ...)"
        )
    assert isinstance(part, f.Modal | f.Timed)
    monitor = kind(part, binding)
    for node in f.walk(*monitor.inner):
        if isinstance(node, f.Modal | f.Timed | f.Preference):
            raise _unsupported(part, f"({f.head(node)} ...) is inside of it")
    return monitor


def _unsupported(part: f.Formula, reason: str) -> UnsupportedConstructError:
    text = str(part)
    short = text if len(text) <= 120 else text[:117] + "..."
    return UnsupportedConstructError(
        f"no semantics is defined for the constraint {short}: {reason}; give modal operators with "
        "formulas without such operators, in conjunctions, universal quantifiers and preferences"
    )
