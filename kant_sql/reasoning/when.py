"""When conditions held: by interval joins of facts, or else by sweeps over revisions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import chain
from operator import itemgetter
from typing import Any, NamedTuple, overload

from typing_extensions import override

from .. import html
from ..arguments import expect_tuple
from ..dto import PddlObjectDto
from ..dto import formulas as f
from ..dto.formulas import Formula
from ..dto.lexical import ROOT_TYPE, fold
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from ..history.moments import Bounds, find_bounds, find_valid_range, is_valid_clock
from ..history.revisions import Revision, read_revisions
from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions, PredicateDefinition
from ..knowledge.sayings import COMMITTED
from ..knowledge.symbols import symbols_of
from ..moment_text import When
from ..pddl.formulas import flatten
from ..pddl.given import disjuncts, text_of
from ..sql.dialects.base import Session
from ..sql.periods import (
    FoundFact,
    Pattern,
    Subjects,
    find_facts,
    find_overlaps,
    read_meanings,
    read_names,
)
from ..sql.valid_periods import Instant
from ..store.state import State
from ..store.store import Store
from . import valid_sweep
from .evaluate import Compiler
from .sweep import (
    RULE,
    PastQuestion,
    Range,
    Sweep,
    Visit,
    ask,
    object_id,
    read_range,
    revision_text,
)
from .world import FluentRow, Row, World

# Periods to read together with their revisions.
PAGE = 200


class Span(NamedTuple):
    """A period, by the numbers of its revisions."""

    since: int  # the first revision; the one before the range if it held there, too
    objects: tuple[int, ...]  # the ids of the objects of the free variables
    until: int | None  # the first revision after it; None if it held to the end of the range


# Periods are sorted by this; those of one binding begin at different revisions.
span_order = itemgetter(0, 1)


@dataclass(frozen=True)
class Held(html.OneRow):
    """A period during which a condition held.

    Attributes:
        binding: the objects of the free variables, by the names of the variables.
        since: the revision that made it hold; None if it already held before the range.
        until: the revision that ended it; None if it still held at the end of the range.
        since_time: when it began, on the chosen clock; None as `since`.
        until_time: when it ended; None as `until`.
    """

    binding: Mapping[str, str]
    since: Revision | None
    until: Revision | None
    since_time: datetime | None = None
    until_time: datetime | None = None

    def _html_row_(self) -> html.Row:
        since, until = self.since, self.until
        return {
            **{f"?{name}": object_ for name, object_ in self.binding.items()},
            "since": "before the range" if since is None else since.number,
            "begun at": self.since_time,
            "begun by": None if since is None else since.actor,
            "reason": None if since is None else since.reason,
            "source": None if since is None else since.source_text,
            "until": "the end of the range" if until is None else until.number,
            "ended at": self.until_time,
            "ended by": None if until is None else until.actor,
            "reason of the end": None if until is None else until.reason,
            "source of the end": None if until is None else until.source_text,
        }

    def __str__(self) -> str:
        names = " ".join(self.binding.values())
        begin = "before" if self.since is None else _end_text(self.since, self.since_time)
        end = "the end" if self.until is None else _end_text(self.until, self.until_time)
        return f"{names}: {begin} until {end}" if names else f"{begin} until {end}"


def _end_text(revision: Revision, time: datetime | None) -> str:
    if time is None or time == revision.committed_at:
        return revision_text(revision)
    return f"{time.isoformat(timespec='seconds')} as of {revision_text(revision)}"


class HeldPeriods(Sequence[Held]):
    """The periods during which a condition held, in the order of their beginnings.

    Those that begin together are in the order of the declarations of their objects. The periods are
    already found; the revisions that began and ended them are read a page at a time.

    Attributes:
        columns: the names of the free variables, without question mark.
    """

    def __init__(
        self,
        columns: Sequence[str],
        *,
        spans: Sequence[Span],
        first: int,
        names: Mapping[int, str],
        read: Callable[[Collection[int]], Mapping[int, Revision]],
        is_valid: bool = False,
    ) -> None:
        """Wrap the found periods."""
        self.columns = expect_tuple(columns, str, "the columns of HeldPeriods")
        self._spans = spans
        self._first = first  # the first revision of the range
        self._names = names  # the names of the objects, by id
        self._read = read  # reads revisions by number
        self._is_valid = is_valid  # whether numbers are positions on the valid clock
        self._pages: dict[int, list[Held]] = {}

    @override
    def __len__(self) -> int:
        return len(self._spans)

    @overload
    def __getitem__(self, index: int) -> Held: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Held]: ...
    @override
    def __getitem__(self, index: int | slice) -> Held | Sequence[Held]:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        at = index + len(self) if index < 0 else index
        if not 0 <= at < len(self):
            raise IndexError(f"there are {len(self)} periods, and none has the index {index}")
        page, place = divmod(at, PAGE)
        return self._page(page)[place]

    @override
    def __iter__(self) -> Iterator[Held]:
        for page in range((len(self) + PAGE - 1) // PAGE):
            yield from self._page(page)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the periods as dictionaries, for tables and JSON.

        Returns:
            For each period the objects by their variables (with `?`), and `since`, `since_time`,
            `since_actor`, `since_reason`, `since_source`, and likewise `until` ...;
            None if a period has no such end.
        """
        return [
            {
                **{f"?{name}": object_ for name, object_ in held.binding.items()},
                **_columns("since", held.since, held.since_time),
                **_columns("until", held.until, held.until_time),
            }
            for held in self
        ]

    def __str__(self) -> str:
        return "\n".join(map(str, self)) or "at no time"

    def __repr__(self) -> str:
        return f"<{len(self)} periods>"

    def _repr_html_(self) -> str:
        return html.guarded(lambda: html.listing(self, "period"))

    def _page(self, page: int) -> list[Held]:
        found = self._pages.get(page)
        if found is None:
            # One page: iterating over millions keeps none.
            found = self._load(self._spans[page * PAGE : (page + 1) * PAGE])
            self._pages = {page: found}
        return found

    def _load(self, spans: Sequence[Span]) -> list[Held]:
        numbers = {span.since for span in spans if span.since >= self._first}
        numbers = numbers.union(span.until for span in spans if span.until)
        said = {n: valid_sweep.instant_at(n) for n in numbers} if self._is_valid else {}
        revisions = self._read({said[n].revision for n in said} or numbers)

        def end(number: int | None) -> tuple[Revision | None, datetime | None]:
            instant = None if number is None else said.get(number)
            if instant is not None:
                return revisions[instant.revision], instant.time
            found = None if number is None else revisions.get(number)
            return found, None if found is None else found.committed_at

        names, held = self._names, []
        for span in spans:
            objects = (names[id_] for id_ in span.objects)
            binding = dict(zip(self.columns, objects, strict=True))
            (since, begun), (until, ended) = end(span.since), end(span.until)
            held.append(Held(binding, since, until, begun, ended))
        return held


def _columns(end: str, revision: Revision | None, time: datetime | None) -> dict[str, Any]:
    said = {
        f"{end}_{name}": getattr(revision, name, None) for name in ("actor", "reason", "source")
    }
    return {end: getattr(revision, "number", None), f"{end}_time": time, **said}


def when(
    state: State,
    condition: Formula | str,
    /,
    *,
    since: When | None = None,
    until: When | None = None,
    parameters: str | None = None,
    clock: str = COMMITTED,
    **bindings: str | PddlObjectDto,
) -> HeldPeriods:
    """Find the periods during which a condition held, for each binding of its free variables.

    Committed changes count. Where a name in the condition is undefined, or has another meaning,
    the condition does not hold. For a conjunction of atoms, the database joins the intervals of
    the facts; any other condition is evaluated at each revision that changed something that it
    mentions.

    Args:
        condition: PDDL text, or a formula.
        since: the first revision, or the earliest time of commit; both inclusive.
        until: the last revision, or the latest time of commit; both inclusive.
        parameters: the free variables with their types, as `(?r - robot ?w - wp)`; by default
            those of the condition, whose objects its atoms restrict.
        clock: `committed`, or `valid` for when it was true, as known in this state: then `since`
            and `until` are such times, and a period begins and ends with the revisions that say so.
        bindings: objects for some of the free variables, as names or DTOs.

    Returns:
        The periods, in the order of their beginnings; none of them adjoin.

    Raises:
        PddlError: the condition is not well-formed, or no state had all its names.
        InvalidArgumentError: a binding names no free variable, or there is no such clock.
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        ArchivedError: a part of the range was moved to an archive.

    Examples:
        >>> _ = kb.propositions.delete(PddlPropositionDto(robot_at, [rb1, wp1]))
        >>> for held in kb.when("(robot_at ?r wp1)"):
        ...     print(held.binding["r"], held.since.number, held.until.number)
        rb1 1 2
    """
    store, upto = state
    where = _find_range(state, since, until, clock)
    given = where.definitions if isinstance(where, valid_sweep.ValidPast) else None
    text = text_of(condition)
    with _archive_named(store, where):
        questions = _questions(
            lambda part: ask(store, part, parameters, bindings, upto, given), text
        )

    def work(session: Session, kb_id: int | None) -> tuple[list[Span], dict[int, str]]:
        searches = [] if kb_id is None else _searches(session, kb_id, questions, where)
        found = [search.run() for search in searches]
        spans = found[0] if len(found) == 1 else sorted(_united(found), key=span_order)
        objects = {id_ for span in spans for id_ in span.objects}
        return spans, read_names(session, kb_id or 0, sorted(objects)) if objects else {}

    spans, names = store.query_in_snapshot(work)

    return HeldPeriods(
        questions[0].columns,
        spans=spans,
        first=where.low if isinstance(where, Bounds) else 1,
        names=names,
        read=partial(read_revisions, store),
        is_valid=isinstance(where, valid_sweep.ValidPast),
    )


def _find_range(
    state: State, since: When | None, until: When | None, clock: str
) -> Bounds | valid_sweep.ValidPast:
    """Find the revisions, or the valid times, of a question."""
    if is_valid_clock(clock):
        return valid_sweep.read_past(state.store, find_valid_range(state, since, until))
    return find_bounds(state, since, until)


@contextmanager
def _archive_named(store: Store, where: Bounds | valid_sweep.ValidPast) -> Iterator[None]:
    """If a name is unknown, refuse a range with an archived part, which may have the name."""
    try:
        yield
    except InvalidKnowledgeError:
        if isinstance(where, Bounds):
            store.query_known(partial(read_range, bounds=where), None)
        raise


def _searches(
    session: Session,
    kb_id: int,
    questions: Iterable[PastQuestion],
    where: Bounds | valid_sweep.ValidPast,
) -> list[_Search]:
    """Return the searches of a range; none for an empty range."""
    if isinstance(where, valid_sweep.ValidPast):
        valid_sweep.check_range(session, kb_id, where.span)
        return [_ValidSearch(session, kb_id, question, where) for question in questions]
    span = read_range(session, kb_id, where)
    if span.high < span.low:
        return []
    return [_Search(session, kb_id, question, span) for question in questions]


def _questions(read: Callable[[str], PastQuestion], text: str) -> list[PastQuestion]:
    """Read a condition; part by part if it is a disjunction whose names no one state has."""
    try:
        return [read(text)]
    except InvalidKnowledgeError:
        with suppress(InvalidKnowledgeError, InvalidArgumentError):
            found = [read(part) for part in disjuncts(text)]
            if len({question.columns for question in found}) == 1:
                return found
        raise


def _united(found: Iterable[Iterable[Span]]) -> Iterator[Span]:
    """Unite the periods of the parts of a disjunction."""
    ends: dict[tuple[int, ...], list[Span]] = {}
    for span in sorted(chain(*found), key=span_order):
        own = ends.setdefault(span.objects, [])
        before = own[-1].until if own else span.since - 1
        if before is not None and before < span.since:
            own.append(span)
        elif before is not None and (span.until is None or span.until > before):
            own[-1] = own[-1]._replace(until=span.until)
    yield from chain(*ends.values())


@dataclass(eq=False)
class _Search:
    """Finds the periods of one question, in one snapshot."""

    _session: Session
    _kb_id: int
    _question: PastQuestion
    _range: Range

    def run(self) -> list[Span]:
        """Find the periods, in order."""
        atoms = conjunction(self._question.formula)
        is_join = atoms is not None and self._is_join(atoms)
        return sorted(self._join(atoms or ()) if is_join else self._sweep(), key=span_order)

    def _is_join(self, atoms: Sequence[f.Atom]) -> bool:
        """Return whether versions of facts are enough to show when a conjunction held."""
        definitions, given = self._question.definitions, self._question.unbound
        unbound = conjunction(given.formula) or []
        mentioned = {fold(str(term)[1:]) for atom in unbound for term in atom.terms}
        if any(fold(variable.name) not in mentioned for variable in given.free):
            return False
        ids = sorted({self._predicate(atom).id for atom in atoms})
        meanings, rules = read_meanings(self._session, self._kb_id, ids, *self._range[:2])
        derived = {fold(found[1]) for rule in rules if (found := RULE.match(rule))}
        if any(fold(atom.predicate) in derived for atom in atoms):
            return False
        if not given.are_declared:
            return True
        stable = [
            atom for atom in unbound if meanings[(one := self._predicate(atom)).id] == {one.text}
        ]
        return all(_is_implied(variable, stable, definitions) for variable in given.free)

    def _predicate(self, atom: f.Atom) -> PredicateDefinition:
        found = self._question.definitions.predicates.named(atom.predicate)
        assert found is not None
        return found

    def _join(self, atoms: Sequence[f.Atom]) -> Iterable[Span]:
        low, high, _ = self._range
        # Each version of the first fact is looked up in those of the others, so it has the fewest.
        facts = sorted(self._facts(atoms, low, high), key=_size)
        found = [*_combinations(self._question.definitions, facts, self._question.free)]
        if not found:
            return
        ids = [own for _, own in found]
        for place, since, until in find_overlaps(self._session, self._kb_id, ids, low, high):
            yield Span(since, found[place][0], None if until > high else until)

    def _facts(self, atoms: Sequence[f.Atom], low: int, high: int) -> list[_Found]:
        """Find the facts that match each atom."""
        of = partial(object_id, self._question.definitions)
        patterns = [Pattern(self._predicate(one).id, tuple(map(of, one.terms))) for one in atoms]
        facts = find_facts(self._session, self._kb_id, patterns, low, high)
        return [*zip(atoms, patterns, facts, strict=True)]

    def _sweep(self) -> Iterator[Span]:
        """Evaluate the condition at each revision that touched what it mentions."""
        question = self._question
        sweep = self._visits([question.formula, *question.objects], bool(question.free))
        held: dict[Row, int] = {}
        solutions: Solutions | None = None
        world: World | None = None
        for visit in sweep.visits():
            if visit.world is not world:
                world, solutions = visit.world, solutions_of(visit, question)
            now = set() if solutions is None else solutions()
            for row in [row for row in held if row not in now]:
                since = held.pop(row)
                # If it ended with the first revision, it held only before the range.
                if visit.revision > self._range.low:
                    yield Span(since, row, visit.revision)
            for row in now:
                held.setdefault(row, visit.revision)
        for row, since in held.items():
            yield Span(since, row, None)

    def _visits(self, nodes: Sequence[f.Node], ranges: bool) -> Sweep:
        known = self._question.definitions
        return Sweep(self._session, self._kb_id, nodes, known, self._range, ranges)


class _ValidSearch(_Search):
    """The same on the valid clock: positions on it take the place of revisions."""

    def __init__(
        self, session: Session, kb_id: int, question: PastQuestion, past: valid_sweep.ValidPast
    ) -> None:
        # Rules and meanings count if they were known at any of its times.
        span = Range(past.span.before + 1, past.span.known, 0)
        super().__init__(session, kb_id, question, span)
        self._past = past

    @override
    def run(self) -> list[Span]:
        """Find the periods; join adjoining ones of a binding, and drop those that take no time."""
        begin = valid_sweep.position_of(Instant(self._past.span.since, 0))
        found: dict[tuple[int, ...], list[Span]] = {}
        for span in super().run():
            own = found.setdefault(span.objects, [])
            if span.until is not None and valid_sweep.is_same_time(
                max(span.since, begin), span.until
            ):
                continue
            if own and valid_sweep.is_same_time(own[-1].until or 0, span.since):
                own[-1] = own[-1]._replace(until=span.until)
            else:
                own.append(span)
        return sorted(chain(*found.values()), key=span_order)

    @override
    def _join(self, atoms: Sequence[f.Atom]) -> Iterable[Span]:
        session, kb_id = self._session, self._kb_id
        found = self._facts(atoms, 0, 0)
        pairs = [(one, own) for _, one, own in found]
        whole = {one.owner for one, _ in pairs if not one.is_restricted}
        ids = {fact.id for one, own in pairs if one.is_restricted for fact in own}
        which = Subjects(predicates=tuple(sorted(whole)), facts=tuple(sorted(ids)))
        keys = {fact.id: (True, one.owner, fact.objects) for one, own in pairs for fact in own}
        periods = valid_sweep.read_periods(session, kb_id, which, self._past)
        for objects, own in _combinations(self._question.definitions, found, self._question.free):
            for since, until in valid_sweep.common([periods.get(keys[id_], ()) for id_ in own]):
                yield Span(since, objects, None if until == valid_sweep.ENDLESS else until)

    @override
    def _visits(self, nodes: Sequence[f.Node], ranges: bool) -> Sweep:
        return valid_sweep.ValidSweep(self._session, self._kb_id, nodes, self._past, ranges)


def _size(found: _Found) -> tuple[int, int]:
    return len(found[2]), sum(fact.versions for fact in found[2])


Solutions = Callable[[], set[Row]]


def solutions_of(visit: Visit, question: PastQuestion) -> Solutions | None:
    """Compile a condition for a state; None if it has no meaning there."""
    try:
        read = question.read(symbols_of(visit.definitions))
    except InvalidKnowledgeError:
        return None
    condition = r.resolve(visit.definitions, read)
    compiler = Compiler(visit.world)
    rows = compiler.rows([column.bound for column in condition.columns], condition.part)
    return lambda: rows(compiler.env())


def conjunction(formula: f.Formula) -> list[f.Atom] | None:
    """Return the atoms of a conjunction of plain atoms; None for anything else."""
    parts = flatten(formula)
    atoms = [part for part in parts if isinstance(part, f.Atom)]
    is_plain = len(atoms) == len(parts) and not f.mentions(f.Fluent, *atoms)
    return atoms if atoms and is_plain else None


def _is_implied(variable: f.TypedName, atoms: Iterable[f.Atom], definitions: Definitions) -> bool:
    """Return whether an atom restricts a variable to objects of its declared types."""
    declared = {fold(name) for name in variable.types}
    if ROOT_TYPE in declared:
        return True
    for atom in atoms:
        predicate = definitions.predicates.named(atom.predicate)
        assert predicate is not None
        for term, parameter in zip(atom.terms, predicate.parameters, strict=True):
            if isinstance(term, f.Variable) and fold(term.name) == fold(variable.name):
                types = {fold(definitions.types.live(id_).name) for id_ in parameter.type_ids}
                if types and types <= declared:
                    return True
    return False


_Found = tuple[f.Atom, Pattern, Sequence[FoundFact]]


def _combinations(
    definitions: Definitions, found: Iterable[_Found], free: Iterable[f.TypedName]
) -> Iterator[tuple[Row, tuple[int, ...]]]:
    """Yield objects of the free variables, with the facts about them, whenever these held."""
    world, slots, ids = World(definitions), dict[str, r.Slot](), dict[FluentRow, int]()
    parts = []
    for atom, (owner, objects), facts in found:
        for fact in facts:
            world.add(owner, fact.objects)
            ids[owner, fact.objects] = fact.id
        terms = (
            r.Known(id_ or 0)
            if not isinstance(term, f.Variable)
            else slots.setdefault(fold(term.name), r.Slot(len(slots)))
            for term, id_ in zip(atom.terms, objects, strict=True)
        )
        parts.append(r.HoldsFact(owner, tuple(terms), is_stored=True))
    compiler = Compiler(world)
    # Without the present types of objects: objects of facts fitted when these were asserted.
    search = compiler.search([r.Bound(slot, ()) for slot in slots.values()], r.all_of(parts))
    pick = compiler.picker([slots[fold(variable.name)] for variable in free])
    picks = [(part.predicate, compiler.picker(part.terms)) for part in parts]
    env = compiler.env()
    for _ in search(env):
        yield pick(env), tuple([ids[owner, row(env)] for owner, row in picks])
