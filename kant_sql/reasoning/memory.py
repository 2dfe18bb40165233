"""States in memory: you query, change and compare them without the store, and commit one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

from ..arguments import count_limit, expect
from ..dto.elements import value_text
from ..dto.formulas import Formula, Node
from ..dto.lexical import decimal_text
from ..errors import InvalidArgumentError, StaleRevisionError
from ..history.diff import diff_lines
from ..history.restore import Origin, origin_of, refuse_open
from ..history.revisions import read_numbered
from ..knowledge.atoms import AtomKey, FluentKey
from ..knowledge.definitions import Definitions
from ..planning import PlanStep
from ..sql.changes import Change
from ..sql.rows import FACT, VALUE
from ..store.snapshot import View
from ..store.state import State
from ..store.store import Store
from .ask import Answers, Binding, Prepared, prepare
from .effects import StepChanges, objects_of, write
from .evaluate import Compiler
from .explain import hard_goals
from .operators import GroundedTask, Near, Values, changing_heads, task_of
from .step_run import Durations, StepRun, listed
from .steps import Step, ground, misfits
from .sweep import revision_text
from .world import FluentRow, Row, Value


class _First(NamedTuple):
    """The state of the store that a state in memory began as; no step changes these parts."""

    task: GroundedTask
    origin: Origin  # without its facts and values
    is_past: bool
    bits: int
    values: Values


class KnowledgeState:
    """Facts and values in memory, with the definitions and goals that give them meaning.

    `kb.state()` makes the first one, and `apply` makes others from it. A state never changes and
    needs no store: you can share it between threads, and use it in sets and as a key. Two states
    are equal if they have the same definitions, goals, facts and values. A state answers like the
    knowledge base in this state, with the same classes of errors.
    """

    __slots__ = ("__weakref__", "_bits", "_first", "_near", "_task", "_values")

    def __init__(
        self, task: GroundedTask, first: _First, bits: int, values: Values, near: Near | None
    ) -> None:
        self._task, self._first, self._near = task, first, near
        self._bits, self._values = bits, values

    @property
    def revision(self) -> int:
        """The revision of the store that these states began with."""
        return self._first.origin.revision

    def holds(self, condition: str | Node, /, **bindings: Binding) -> bool:
        """Return whether a condition holds; same arguments and errors as `KnowledgeBase.holds`."""
        return bool(self._ask(condition, None, bindings)[1])

    def query(
        self,
        condition: str | Node,
        /,
        *,
        parameters: str | None = None,
        limit: int | None = None,
        **bindings: Binding,
    ) -> Answers:
        """Find the objects for which a condition holds.

        Same arguments and errors as `KnowledgeBase.query`; the answers have no SQL.
        """
        most = None if limit is None else count_limit(limit)
        prepared, rows = self._ask(condition, parameters, bindings)
        names = self._task.world.names
        found = [names(row) for row in sorted(rows)[:most]]
        return Answers(found.copy, columns=prepared.columns, sql=_no_sql)

    def _ask(
        self, condition: str | Node, parameters: str | None, bindings: Mapping[str, Binding]
    ) -> tuple[Prepared, set[Row]]:
        """Return a question and its answers; compile it once for all states of a task."""
        task = self._task
        prepared = prepare(task.definitions, condition, parameters, bindings)
        given = [*prepared.values(task.definitions, bindings).values()]
        with task.lock:
            if prepared not in task.asked:
                compiler, asked = Compiler(task.world, prepared.places), prepared.condition
                columns = [each.bound for each in asked.columns]
                task.asked[prepared] = compiler, compiler.rows(columns, asked.part)
            compiler, rows = task.asked[prepared]
            task.go((self._bits, self._values))
            return prepared, rows(compiler.env(given))

    def goal_reached(self) -> bool:
        """Return whether all goals hold; preferences do not count.

        Returns:
            True if they hold, or if there are no goals.
        """
        return self._task.is_goal((self._bits, self._values))

    def applicable_actions(self) -> list[PlanStep]:
        """Find the executable steps, as `KnowledgeBase.applicable_actions`.

        Returns:
            The steps, ordered by action and by the declarations of their objects. Durative steps
            have the shortest duration that their constraints allow, so the list includes steps
            whose duration you must choose; `durations` returns the other durations.
        """
        task, bits, values, near = self._task, self._bits, self._values, self._near
        if near is None or near[1] != bits:
            near = self._near = task.in_reach(near, (bits, values))
        found = near[0]
        if task.is_tested:
            found = [each for each in found if not each.test or each.test(bits, values)]
            task.tested = bits, values, frozenset(found)
        if not task.timed:
            return [each.step for each in found]
        with task.lock:
            timed = [each for one in task.timed for each in listed(task, one, (bits, values))]
        plain = [(each.order, each.step) for each in found]
        return [step for _, step in sorted([*plain, *timed], key=itemgetter(0))]

    def durations(self, step: Step) -> Durations | None:
        """Return the durations that the constraints of a durative step allow at its start.

        Args:
            step: as for `apply`.

        Returns:
            The shortest and the longest, up to the tolerance of 0.01; None for an instantaneous
            step.

        Raises:
            NotApplicableError: there is none, a number that limits it has no value, or an object
                does not fit.
            PddlError, InvalidKnowledgeError: the step names an unknown element.
        """
        task = self._task
        with task.lock:
            run = StepRun(task, given := ground(task.definitions, step))
            at = self._bits, self._values
            return run.durations(at) if given.action.is_durative else None

    def apply(self, step: Step) -> KnowledgeState:
        """Return the state after a step, as `KnowledgeBase.apply` would write it.

        Args:
            step: as for `KnowledgeBase.apply`, which raises the same errors; fastest if it comes
                from `applicable_actions`.

        Returns:
            The new state.

        Raises:
            NotApplicableError: a condition does not hold, a duration is not allowed, or a
                right-hand side has no value.
        """
        task, bits, first = self._task, self._bits, self._first
        given, found = None, task.listed.get(id(step))
        if found is not None and found.is_plain and bits & found.care == found.want:
            # As `Operator.after`, inline: the call would take a third of the whole time.
            now = bits & found.keep | found.adds
            return KnowledgeState(task, first, now, self._values, self._near)
        if found is None:
            given = ground(task.definitions, step)
            if not (given.action.is_durative or misfits(task.definitions, given)):
                found = task.operator(given.action.name, given.ids)
        after = None if found is None else found.after(bits, self._values, task.tested)
        if after is None:
            given = ground(task.definitions, step) if given is None else given
            with task.lock:
                after = StepRun(task, given).finish((bits, self._values))
        return KnowledgeState(task, first, *after, self._near)

    def difference(self, other: KnowledgeState | None = None) -> list[Change]:
        """Compare with another state, as `KnowledgeBase.diff`.

        Args:
            other: the state before; by default the one from the store.

        Returns:
            The changes from the other state to this one: `+` for facts and values only in this
            one, `-` for those only in the other; sorted.
        """
        first = self._first
        if other is None:
            other = KnowledgeState(first.task, first, first.bits, first.values, None)
        expect(other, KnowledgeState, "the other state", InvalidArgumentError)
        return diff_lines([*other._lines(self)], [*self._lines(other)])

    def _lines(self, other: KnowledgeState) -> Iterator[tuple[str, str]]:
        """Yield kind and text of the facts and values here, without some that the other has."""
        task = self._task
        values, theirs = task.values_of(self._values), task.values_of(other._values)
        facts: Iterable[FluentRow] = task.facts_of(self._bits & ~other._bits)
        if other._task is not task:
            facts = chain(task.facts, task.facts_of(self._bits))
            values, theirs = {**task.values, **values}, {}
        for head, row in facts:
            yield FACT, task.world.text((True, head), row)
        for key, value in values.items():
            if theirs.get(key) != value:
                yield VALUE, value_text(task.world.text((False, key[0]), key[1]), self._said(value))

    def _said(self, value: Value) -> str:
        if isinstance(value, int):
            return self._task.definitions.objects.live(value).name
        return decimal_text(value)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, KnowledgeState):
            return NotImplemented
        same = self._task is other._task and self._bits == other._bits
        return same and self._values == other._values

    def __hash__(self) -> int:
        return hash((self._bits, *self._values))

    def __deepcopy__(self, memo: object) -> KnowledgeState:
        return self

    def __repr__(self) -> str:
        task, origin = self._task, self._first.origin
        facts = len(task.facts) + self._bits.bit_count()
        values = len(task.values) + len(task.values_of(self._values))
        where = f"{origin.parent!r} from revision {origin.revision}: {facts} facts"
        return f"<{type(self).__name__} of {where}, {values} values>"

    def _changes(self) -> StepChanges:
        """Return the differences from the original state, as effects."""
        task, first, changes = self._task, self._first, StepChanges()
        for head, row in task.facts_of(first.bits & ~self._bits):
            changes.deletes[AtomKey(False, head, _arguments(row))] = None
        for head, row in task.facts_of(self._bits & ~first.bits):
            key = AtomKey(False, head, _arguments(row))
            changes.adds[key] = task.world.text((True, head), row)
        before = task.values_of(first.values)
        for (head, row), value in task.values_of(self._values).items():
            if before.get((head, row)) != value:
                text = task.world.text((False, head), row)
                changes.assignments[FluentKey(head, _arguments(row))] = text, [("assign", value)]
        return changes


def _arguments(row: Row) -> str:
    return " ".join(map(str, row))


def _no_sql() -> str:
    raise InvalidArgumentError(
        "a state in memory is not asked with SQL; take the statement from kb.query(...).sql"
    )


def state(state: State) -> KnowledgeState:
    """Read this state into memory, for search, simulation and tests of executives.

    It takes a few statements; later questions to the state take none.

    Returns:
        The state, which never changes.

    Raises:
        ReadOnlyError: a transaction is open: pending changes have no revision yet.
        ArchivedError: a part of the state was moved to an archive.
        InvalidKnowledgeError: derived predicates are not stratified.

    Examples:
        >>> kb.load_domain('''(define (domain doors) (:predicates (open) (key))
        ...   (:action unlock :parameters () :precondition (key) :effect (open)))''').revision
        2
        >>> _ = kb.propositions.save("(key)")
        >>> first = kb.state()
        >>> then = first.apply("(unlock)")
        >>> first.holds("(open)"), then.holds("(open)"), kb.holds("(open)")
        (False, True, False)
        >>> print(*then.difference())
        Change(sign='+', kind='fact', text='(open)')
        >>> kb.commit(then)
        4
    """
    store, at = state
    if at is None:
        refuse_open(store, "that it could be read at")

    def work(view: View) -> tuple[Origin, Sequence[Formula]]:
        return origin_of(store, view), hard_goals(view)

    origin, goals = store.read_in_snapshot(work, at)
    definitions = origin.definitions
    changing = definitions.derive(changing_heads)
    keys = [atom.key for atom in origin.atoms if not atom.key.is_goal]
    facts = [(key.predicate_id, objects_of(key)) for key in keys]
    values: dict[FluentRow, Value] = {}
    for fluent, (text, object_id) in origin.values:
        key = fluent.key.function_id, objects_of(fluent.key)
        values[key] = Decimal(text) if object_id is None else object_id
    moving = {key: each for key, each in values.items() if (False, key[0]) in changing}
    task = task_of(
        definitions,
        goals,
        [each for each in facts if (True, each[0]) not in changing],
        {key: each for key, each in values.items() if key not in moving},
    )
    bits = sum(task.bit(each) for each in facts if (True, each[0]) in changing)
    begun = origin._replace(definitions=Definitions(), atoms=[], values=[])
    numbers = task.numbered(moving)
    first = _First(task, begun, at is not None, bits, numbers)
    return KnowledgeState(task, first, bits, numbers, None)


def commit(
    state: State, new: KnowledgeState, *, reason: str | None = None, actor: str | None = None
) -> int | None:
    """Write a state in memory as one revision, if nothing else happened meanwhile.

    It writes only the differences, under the lock of the head.

    Args:
        new: a state from `kb.state()`, or from `apply` on one.
        reason: the revision's reason.
        actor: who writes; by default the knowledge base's actor.

    Returns:
        The new revision; None if nothing differs.

    Raises:
        StaleRevisionError: the knowledge base has another revision than the original state;
            the error says who wrote it.
        InvalidArgumentError: the state belongs to another knowledge base, or to the past.
        ReadOnlyError: a transaction is open, or this is a view of the past.
    """
    store = state.store
    expect(new, KnowledgeState, "what is committed", InvalidArgumentError)
    refuse_open(store, "that the state could be compared with")
    first = new._first
    origin, number = first.origin, first.origin.revision
    if origin.parent != store.name:
        raise _foreign(store, origin)
    if first.is_past:
        raise InvalidArgumentError(
            f"the state is of the past: it was read from revision {number} with kb.at(); "
            "commit states that begin as kb.state(), or restore the revision with kb.restore()"
        )
    try:
        with store.transaction(actor, reason, expected_revision=number) as transaction:
            if origin.hash != transaction.head.hash:
                raise _foreign(store, origin)
            write(transaction, "the state", new._changes())
    except StaleRevisionError as error:
        found = store.query(lambda session, kb_id: read_numbered(session, kb_id or 0, [number + 1]))
        said = "".join(f"; after it came revision {revision_text(each)}" for each in found.values())
        raise StaleRevisionError(f"{error}{said}", error.expected, error.actual) from error
    return transaction.made


def _foreign(store: Store, origin: Origin) -> InvalidArgumentError:
    return InvalidArgumentError(
        f"the state is of another knowledge base: {origin.parent!r} at revision {origin.revision}, "
        f"which is no revision of {store.name!r} in {store.backend.label}; commit it where "
        "kb.state() read it"
    )
