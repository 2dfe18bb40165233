"""The revision at a time, the head, and the bounds of ranges."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from itertools import zip_longest
from typing import NamedTuple

from sqlalchemy import bindparam

from ..arguments import one_of, shown, whole_number
from ..errors import InvalidArgumentError, UnknownRevisionError, reading_rows
from ..knowledge.sayings import COMMITTED
from ..moment_text import Moment, When, is_now, read_when
from ..sql.changes import last_until
from ..sql.dialects.base import Session
from ..sql.query import Query, StoreClock
from ..sql.tables import HeadRow
from ..sql.valid_periods import ValidRange
from ..sql.valid_time import ValidTime
from ..store.snapshot import POSITION, HeadPosition, make_position, read_position, vanished
from ..store.state import State
from ..store.store import Store
from ..store.valid_store import ValidStore
from .revisions import (
    FIRST_MOMENT,
    LARGEST,
    LAST_MOMENT,
    read_revisions,
    refuse_archived_revision,
    refuse_unknown,
)

_MOMENTS = ("one", "other")
_WITH_TIMES = Query(
    POSITION.add_columns(
        HeadRow.committed_at, StoreClock(), *map(last_until, map(bindparam, _MOMENTS))
    )
)


def _read_head(
    store: Store, moments: Sequence[datetime], *, begins: bool = False
) -> tuple[HeadPosition, list[int]]:
    """Read the head, and the last revision up to each of some times, with one statement."""
    # If the first one `begins` a range, the last revision before it.
    for moment in moments:
        check_zone(moment)

    def work(session: Session, kb_id: int | None) -> tuple[HeadPosition, list[int]]:
        if kb_id is None or not moments:
            for moment in moments:
                _refuse_future(moment, store.clock(session), FIRST_MOMENT)
            return read_position(session, kb_id), [0 for _ in moments]
        times = [just_before(moments[0]), *moments[1:]] if begins else moments
        given = zip_longest(_MOMENTS, [session.from_time(clamped(each)) for each in times])
        row = session.first(_WITH_TIMES, kb=kb_id, **dict(given))
        if row is None:
            raise vanished(session)
        position = make_position(session, kb_id, row)
        committed_at, clock, *found = row[4:]
        with reading_rows("head", f"knowledge base {kb_id!r}"):
            last = FIRST_MOMENT if committed_at is None else session.to_time(committed_at)
        for moment in moments:
            _refuse_future(moment, session.now(clock), last)
        return position, [number or 0 for number in found]

    return store.query(work)


def check_zone(moment: datetime) -> None:
    """Refuse a time without zone."""
    if moment.utcoffset() is None:
        raise UnknownRevisionError(f"the time {moment.isoformat()} has no zone; give one, as UTC")


def _refuse_future(moment: datetime, now: datetime, last: datetime) -> None:
    # The clock may have gone back since the last revision.
    if moment > now and moment > last:
        raise UnknownRevisionError(
            f"the time {moment.isoformat()} is in the future: the store's clock says "
            f"{now.isoformat()}"
        )


def head_revision(state: State) -> int:
    """Return the last revision that a state knows; 0 before the first."""
    upto = state.upto
    return state.store.query(read_position).head if upto is None else upto


def revision_at(state: State, when: When) -> int:
    """Return the revision at a number or a time."""
    (revision,), _ = _find(state, [when])
    return revision


def state_at(state: State, when: When) -> int:
    """Return the revision of one state, like `states_at`."""
    (revision,), _ = states_at(state, [when])
    return revision


def last_before(state: State, after: When) -> int:
    """Return the revision after which a feed begins: a number, or the last one up to a time."""
    if isinstance(after, str | datetime):
        return state_at(state, after)
    expected = "a revision's number, or 0 to begin with the first"
    return whole_number(after, "after", expected=expected, error=UnknownRevisionError)


def states_at(state: State, whens: Sequence[When]) -> tuple[list[int], HeadPosition]:
    """Return the revisions of one or two states with one statement; refuse archived states."""
    revisions, head = _find(state, whens)
    for revision in revisions:
        if revision < head.archived:
            refuse_archived_revision(state.store, revision)
    return revisions, head


def _find(state: State, whens: Sequence[When]) -> tuple[list[int], HeadPosition]:
    refuse_valid(state, "this")
    # Now is the time of the store's clock, which may be behind this process's.
    given = [(read_when(when), is_now(when)) for when in whens]
    moments = [when for when, is_head in given if isinstance(when, datetime) and not is_head]
    head, numbers = _read_head(state.store, moments)
    found, last = iter(numbers), _last_known(state, head)
    revisions = []
    for when, is_head in given:
        if is_head:
            revisions.append(last)
        elif not isinstance(when, datetime):
            revisions.append(check_number(state.store.name, when, last))
        else:
            revisions.append(min(next(found), last))
    return revisions, head


def _last_known(state: State, position: HeadPosition) -> int:
    """Return the last revision that a caller may name."""
    upto = state.upto
    return position.head if upto is None else upto


def check_number(name: str, when: int, last: int) -> int:
    """Check the number of a revision."""
    expected = "a revision's number, or an aware time"
    whole_number(when, "the revision", least=None, expected=expected, error=UnknownRevisionError)
    refuse_unknown(name, when, last)
    return when


def refuse_valid(state: State | None, question: str) -> None:
    """Refuse a question about revisions on a state of valid time."""
    if state is not None and isinstance(state.store, ValidStore):
        raise InvalidArgumentError(
            f"{question} asks about revisions, and this is knowledge base {state.store.name!r} as "
            f"it was at {state.store.valid}, one state: ask kb.at(known={state.at}), or give "
            "clock='valid' there, where it takes a clock"
        )


def past_state(state: State, when: When | None, known: When | None, valid: When | None) -> State:
    """Return a past state: known at a revision or time, or true at a time."""
    # Arguments that are not given are those of the state, which may itself be a past one.
    if when is not None and known is not None:
        raise InvalidArgumentError("give the revision as the first argument or as known=, not both")
    known = when if known is None else known
    store, at = state
    if isinstance(store, ValidStore):
        valid = store.valid.moment if valid is None else valid
        store = store.origin
    base = State(store, at)
    if valid is None:
        if known is None:
            raise UnknownRevisionError(
                "give a revision's number, or an aware time, also as known= or as valid="
            )
        return State(store, state_at(base, known))
    moment = store.query(lambda session, _: store.clock(session)) if is_now(valid) else valid
    moment = read_when(moment)
    if not isinstance(moment, datetime):
        raise InvalidArgumentError(
            f"valid is {shown(valid)}, expected a time; give a revision as known="
        )
    asked = "now" if known is None else known, moment
    (last, committed), head = states_at(base, asked)
    true = ValidTime(clamped(moment), last, min(last, committed))
    if true.oldest < head.archived:
        refuse_archived_revision(store, true.oldest)
    return State(ValidStore(store, true), last)


MICROSECOND = timedelta(microseconds=1)


class Bounds(NamedTuple):
    """A range of revisions."""

    low: int
    high: int  # below `low` in an empty range
    redefined: int  # no revision after this one, up to `high`, changed a definition
    known: int  # the last revision that is known


def find_bounds(state: State, since: When | None, until: When | None) -> Bounds:
    """Find the first and last revision of a range, with one statement at most."""
    refuse_valid(state, "this")
    store = state.store
    since, until = read_when(since), None if is_now(until) else read_when(until)
    moments = [moment for moment in (since, until) if isinstance(moment, datetime)]
    head, found = HeadPosition(redefined=LARGEST), list[int]()
    if state.at is None or moments:
        head, found = _read_head(store, moments, begins=isinstance(since, datetime))
    last = _last_known(state, head)
    low, high = 1, last
    if isinstance(since, datetime):
        low = min(found[0], last) + 1
    elif since is not None:
        low = max(1, check_number(store.name, since, last))
    if isinstance(until, datetime):
        high = min(found[len(moments) - 1], last)
    elif until is not None:
        high = check_number(store.name, until, last)
    refuse_reversed(since, until, low, high)
    return Bounds(low, high, head.redefined, last)


# The clocks of a question about a range: times of commits, or valid times.
VALID = "valid"
CLOCKS = COMMITTED, VALID


def is_valid_clock(clock: str) -> bool:
    """Check the clock of a question; return whether it is valid time."""
    return one_of(clock, CLOCKS, "the clock", InvalidArgumentError) == VALID


def find_valid_range(state: State, since: When | None, until: When | None) -> ValidRange:
    """Find a range of valid times; a revision means the time of its commit."""
    given = [since, None if is_now(until) else until]
    times = iter(valid_times(state, [when for when in given if when is not None]))
    begin, end = (None if when is None else next(times) for when in given)
    bounds = find_bounds(state, begin, end)
    return ValidRange(
        clamped(begin or FIRST_MOMENT),
        clamped(end or LAST_MOMENT),
        bounds.low - 1,
        bounds.high,
        bounds.known,
    )


def valid_times(state: State, whens: Sequence[When]) -> list[datetime]:
    """Return times; a revision means that of its commit, and the last revision means now."""
    given = [LARGEST if is_now(when) else read_when(when) for when in whens]
    numbers = {when for when in given if not isinstance(when, datetime)}
    if numbers:
        store, last = state.store, head_revision(state)
        numbers = {last if n == LARGEST else check_number(store.name, n, last) for n in numbers}
        revisions = read_revisions(store, numbers - {0}).values()
        known = {0: FIRST_MOMENT, **{each.number: each.committed_at for each in revisions}}
        given = [known[min(when, last)] if isinstance(when, int) else when for when in given]
    for moment in given:
        if isinstance(moment, datetime):
            check_zone(moment)
    return [when for when in given if isinstance(when, datetime)]


def clamped(moment: datetime) -> datetime:
    """Return a time in UTC, or the nearest one that a store can keep."""
    return min(max(moment, FIRST_MOMENT), LAST_MOMENT).astimezone(UTC)


def just_before(moment: datetime) -> datetime:
    """Return the time one microsecond earlier, the resolution of times."""
    return max(clamped(moment), FIRST_MOMENT + MICROSECOND) - MICROSECOND


def refuse_reversed(since: Moment | None, until: Moment | None, low: int, high: int) -> None:
    """Refuse a range that ends before it begins; there may be no revision between two times."""
    # `low` and `high` are its revisions.
    if since is None or until is None:
        return
    if isinstance(since, datetime) and isinstance(until, datetime):
        is_reversed = since > until
    elif isinstance(since, datetime) or isinstance(until, datetime):
        is_reversed = low > high
    else:
        is_reversed = since > until
    if is_reversed:
        shown = [one.isoformat() if isinstance(one, datetime) else one for one in (since, until)]
        raise InvalidArgumentError(
            f"the range ends before it begins: since {shown[0]} is after until {shown[1]}; "
            "swap them"
        )
