"""Causes: the acts whose conditions used a fact, and the origins of a fact.

Conditions are evaluated in memory, in the states in which acts began and ended. A page of acts is
read at once, level by level, so statements grow only with the depth, and with the definitions that
changed between acts.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import islice, product
from typing import Any, NamedTuple, TypeVar

from .. import html
from ..acts import Execution
from ..acts.recording import ExecutionReader
from ..arguments import shown, whole_number
from ..dto.elements import Dto, atom_text
from ..dto.formulas import AT_END, AT_START, OVER_ALL, TIMES, Node
from ..errors import InvalidKnowledgeError
from ..history.elements import Applied, Element, comparable, refuse_unknown_element, sought
from ..history.revisions import LARGEST, Revision, at_most, read_numbered
from ..history.versions import read_newest
from ..knowledge import resolved as r
from ..knowledge.definitions import Definitions
from ..knowledge.reads import Head, Reading, head_of, read_by
from ..knowledge.rules import rules_of
from ..pddl.document import EXECUTABLE
from ..sql.causes import PastReader, WantedActs, changed_atoms, find_acts, find_origins
from ..sql.definition_rows import find_identities, last_change, load_at
from ..sql.executions import ABORTED, REFUSED, RUNNING, SUCCEEDED, Key, read_outcome
from ..sql.rows import FACT, VALUE
from ..store.snapshot import View, read_position
from ..store.state import State
from .derived import world_of
from .steps import PreparedAction, executable, prepared
from .uses import Given, Literal, Uses, parts_used, users_of
from .world import Row, World

# The maximum number of versions of the element to follow, and of derived facts to check.
VERSIONS, DERIVED = 50, 1_000
_HEADS = ("predicate", "function")
_ABSENT = re.compile(r"\s*\(\s*not\s*(\(.*\))\s*\)\s*", re.DOTALL | re.IGNORECASE)


@dataclass(frozen=True)
class CauseLink:
    """An act, a plan, a derived fact, an observation or a document, with its literals.

    Attributes:
        depth: its distance from the element, from 1.
        kind: `execution`, `plan`, `derived fact`, `observation` (a revision without an execution),
            `document` (a revision that loaded a domain or a problem) or `branch` (the first
            revision of a branch, whose source names the knowledge base and the revision).
        id: the id of the execution or the plan; None for others.
        text: the act, the derived fact, or the document.
        revision: the revision in which it began, or the observation; for a plan, the revision of
            its initial state; None for a derived fact.
        used: the literals that its condition used, as far as the question follows them.
        made: the literals that it made true, as far as the question follows them.
    """

    depth: int
    kind: str
    id: str | None
    text: str
    revision: Revision | None
    used: tuple[str, ...]
    made: tuple[str, ...]

    def _html_row_(self) -> html.Row:
        revision = self.revision
        return {
            "depth": self.depth,
            "kind": self.kind,
            "id": self.id,
            "text": self.text,
            "revision": None if revision is None else revision.number,
            "actor": None if revision is None else revision.actor,
            "reason": None if revision is None else revision.reason,
            "used": self.used,
            "made": self.made,
        }


@dataclass(frozen=True)
class CauseLinks:
    """The consequences or the origins of an element.

    Attributes:
        element: the element.
        links: the links, the nearest first, then the newest.
        searched: the first searched revision; None for all. After an archive, acts before it are in
            the archive: ask it.
        has_more: whether there are more than the limit.
    """

    element: str
    links: tuple[CauseLink, ...]
    searched: int | None
    has_more: bool

    def __iter__(self) -> Iterator[CauseLink]:
        return iter(self.links)

    def __len__(self) -> int:
        return len(self.links)

    def _repr_html_(self) -> str:
        return html.listing(self.links, "link")


class _Asked(NamedTuple):
    """A part to evaluate, with the objects of its parameters."""

    part: r.Part
    parameters: Sequence[r.Slot] = ()
    arguments: Row = ()
    duration: Decimal | None = None


class _Dated(NamedTuple):
    """A literal of a state, and the revision since which it held; 0: always, or by rules."""

    literal: Literal
    since: int
    at: int
    text: str

    def asked(self, world: World) -> list[_Asked]:
        """Return the literal, if rules may have derived it."""
        _, owner, row, holds = self.literal
        if not self.literal.is_fact or not rules_of(world.definitions).of(owner):
            return []
        fact = r.HoldsFact(owner, tuple(map(r.Known, row)))
        return [_Asked(fact if holds else r.Lacks(fact))]


class _ActJob(NamedTuple):
    """The conditions of an execution at a time, in a state."""

    execution: Execution
    time: str
    at: int

    def asked(self, world: World) -> list[_Asked]:
        """Return the conditions to evaluate; none for acts whose action is not in the domain."""
        definitions, act = world.definitions, self.execution
        definition = definitions.actions.named(act.action)
        found = [definitions.objects.named(name) for name in act.arguments]
        if definition is None or None in found or definition.kind not in EXECUTABLE:
            return []
        action = prepared(definitions, definition)
        has_time = action.is_durative or self.time == AT_START
        if not has_time or len(found) != len(action.parameters):
            return []
        ids = tuple([one.id for one in found if one is not None])
        slots = [one.slot for one in action.parameters]
        return [_Asked(part, slots, ids, act.duration) for part in parts_used(action, self.time)]


_Job = _ActJob | _Dated
J = TypeVar("J", _Job, _Dated)
# Parts, with the given objects of their variables.
_Read = list[tuple[r.Part, Given]]


class _Evaluation:
    """Evaluates jobs in their states, which it reads together."""

    def __init__(self, view: View, head: int) -> None:
        assert view.kb_id is not None
        self._view = view
        self._session, self._kb_id = view.session, view.kb_id
        self._reader = PastReader(view.session, view.kb_id, head)
        # The revision since which the view's definitions have not changed.
        self._epoch: int | None = None

    def run(self, jobs: Sequence[_Job]) -> list[list[_Dated]]:
        """Return the literals that each job used."""
        found: list[list[Literal]] = [[] for _ in jobs]
        texts: dict[Literal, str] = {}
        for world, uses, place in self._in_states(jobs, _read_by_asked):
            for asked in jobs[place].asked(world):
                own = dict.fromkeys(uses.of(*asked))
                texts |= {one: _text(world, one) for one in own if one not in texts}
                found[place] += own
        return self._dated(jobs, found, texts)

    def derived(self, jobs: Sequence[_Dated]) -> Iterator[tuple[str, str]]:
        """Yield the derived facts that used literals, with these literals."""
        for world, uses, place in self._in_states(jobs, _read_by_users):
            job = jobs[place]
            for one in sorted(islice(uses.users(job.literal), DERIVED)):
                yield _text(world, one), job.text

    def _in_states(
        self, jobs: Sequence[J], read: Callable[[World, J], _Read]
    ) -> Iterator[tuple[World, Uses, int]]:
        """Yield the index of each job while the world has its state; all are read together."""
        of_state: defaultdict[int, list[int]] = defaultdict(list)
        for place, job in enumerate(jobs):
            of_state[job.at].append(place)
        worlds = [(world_of(one), own) for one, own in self._epochs(sorted(of_state)[::-1])]
        states = self._states(
            {
                (pattern, at)
                for world, revisions in worlds
                for at in revisions
                for place in of_state[at]
                for part, given in read(world, jobs[place])
                for pattern in read_by(rules_of(world.definitions), [part], given)
            }
        )
        for world, revisions in worlds:
            uses = Uses(world)
            for at in revisions:
                with_state(world, states[at])
                for place in of_state[at]:
                    yield world, uses, place

    def _epochs(self, revisions: Sequence[int]) -> Iterator[tuple[Definitions, list[int]]]:
        """Yield definitions with the revisions at which they were valid, the newest first."""
        session, kb_id, at = self._session, self._kb_id, self._view.at
        definitions, rest = self._view.definitions, [*revisions]
        if self._epoch is None:
            if at is None:
                self._epoch = read_position(session, kb_id).redefined
            else:
                self._epoch = last_change(session, kb_id, at)
        epoch = self._epoch
        while rest:
            if rest[0] < epoch:
                epoch = last_change(session, kb_id, rest[0])
                definitions = load_at(session, kb_id, rest[0])
            own = [one for one in rest if one >= epoch]
            yield definitions, own
            rest = rest[len(own) :]

    def _states(self, wanted: set[tuple[Reading[int], int]]) -> dict[int, list[Any]]:
        """Read the wanted facts and values that held at each revision."""
        states: defaultdict[int, list[Any]] = defaultdict(list)
        atoms: Any = [one for one in wanted if None not in one[0][2]]
        for (atom, at), held in self._reader.versions(atoms).items():
            if held.until is None or held.until > at:
                states[at].append((atom, held.value))
        for atom, at, value in self._reader.fitting(wanted.difference(atoms)):
            states[at].append((atom, value))
        return states

    def _dated(
        self, jobs: Sequence[_Job], found: list[list[Literal]], texts: dict[Literal, str]
    ) -> list[list[_Dated]]:
        """Add the revisions since which literals held, and their texts."""
        pairs = [*zip(jobs, found, strict=True)]
        versions = self._reader.versions({(one[:3], job.at) for job, own in pairs for one in own})

        def dated(literal: Literal, at: int) -> _Dated:
            last = versions.get((literal[:3], at))
            since = 0
            if last is not None:
                holds = last.until is None or last.until > at
                since = last.since if holds else last.until or 0
                since = since if holds == literal.holds else 0
            return _Dated(literal, since, at, texts[literal])

        return [[dated(one, job.at) for one in own] for job, own in pairs]


def _read_by_asked(world: World, job: _Job) -> _Read:
    """Return the parts on which the truth of a job depends."""
    asked = job.asked(world)
    return [(one.part, dict(zip(one.parameters, one.arguments, strict=True))) for one in asked]


def _read_by_users(world: World, job: _Dated) -> _Read:
    """Return the parts that decide which derived facts use a literal."""
    return [one for some in users_of(world.definitions, job.literal).values() for one in some]


def with_state(world: World, state: Iterable[Any]) -> None:
    """Replace the facts and values of a world."""
    for fact in world.facts():
        world.remove(*fact)
    for fluent in world.values():
        world.set(*fluent, None)
    for atom, value in state:
        world.change(atom, value)


def _text(world: World, literal: Literal) -> str:
    text = world.text(literal[:2], literal.row)
    return text if literal.holds else f"(not {text})"


def _moments(execution: Execution) -> Iterator[_ActJob]:
    """Yield the conditions of an execution, each in the state in which it had to hold."""
    outcomes = [(read_outcome(one.text).outcome, one.since.number) for one in execution.outcomes]
    outcomes = [one for one in outcomes if one[0] != REFUSED]
    if not outcomes or (outcomes[0][0] == ABORTED and execution.plan_id is not None):
        return
    (first, begun), (last, ended) = outcomes[0], outcomes[-1]
    yield _ActJob(execution, AT_START, begun - 1)
    if first == RUNNING:
        yield _ActJob(execution, OVER_ALL, begun)
    if last == SUCCEEDED:
        yield _ActJob(execution, OVER_ALL, ended - 1)
        yield _ActJob(execution, AT_END, ended - 1)


class _Target(NamedTuple):
    """A literal that may have been used, from one revision until another (None: still)."""

    literal: Literal
    since: int
    until: int | None
    text: str

    def last(self, at: int) -> _Dated:
        """Return it in its last state up to a revision."""
        last = at if self.until is None else min(self.until - 1, at)
        return _Dated(self.literal, self.since, last, self.text)


class _Sought(NamedTuple):
    """The versions of an element, the newest first, and its text; the first revision, if cut."""

    text: str
    targets: list[_Target]
    first: int


def _find(view: View, element: Element, at: int) -> _Sought | None:
    """Find a fact, a fluent, or the absence of one; None if its names never existed."""
    assert view.kb_id is not None
    text = str(element) if isinstance(element, Dto | Node) else element
    absent = _ABSENT.fullmatch(text) if isinstance(text, str) else None
    # `(= (battery rb1) 90)` may be a formula, too.
    applied = [one for one in sought(absent[1] if absent else element) if isinstance(one, Applied)]
    if len(applied) != 1:
        raise InvalidKnowledgeError(
            f"{shown(element)} is not a fact or a fluent; give one such as (robot_at rb1 wp1), "
            "(battery rb1), or (not (robot_at rb1 wp1)) for its absence"
        )
    [wanted] = applied
    keys = {"object": {*wanted.arguments}, **{kind: {wanted.name} for kind in _HEADS}}
    ids = {kind: find_identities(view.session, view.kb_id, kind, keys[kind]) for kind in keys}
    heads = [(kind, one) for kind in _HEADS if (one := ids[kind][wanted.name]) is not None]
    objects = [one for name in wanted.arguments if (one := ids["object"][name]) is not None]
    if not heads or len(objects) != len(wanted.arguments):
        return None
    [(kind, (owner, name)), *_] = heads
    plain = atom_text(name, [one[1] for one in objects])
    row = tuple([one[0] for one in objects])
    literal = Literal(kind == "predicate", owner, row, absent is None)
    of_kind = [wanted._replace(kinds=frozenset({FACT, VALUE}))]
    rows = read_newest(view.session, view.kb_id, of_kind, at, VERSIONS)
    first = max(1, min(one[2] for one in rows)) if len(rows) == VERSIONS else 0
    has_value = wanted.kinds == {VALUE} and not absent and not isinstance(element, Dto)
    if has_value:
        rows = [one for one in rows if comparable(one[1]) == comparable(text)]
    spans = sorted(((one[2], one[3]) for one in rows), reverse=True)
    if absent:
        begins = [*(until for _, until in spans), 0]
        ends = [None, *(since for since, _ in spans)]
        gaps = zip(begins, ends, strict=True)
        spans = [(begin, end) for begin, end in gaps if begin is not None]
    elif not spans and not has_value:
        # Only rules can derive it.
        spans = [(0, None)]
    plain = f"(not {plain})" if absent else plain
    targets = [_Target(literal, since, until, plain) for since, until in spans if since <= at]
    return _Sought(plain, targets, first)


# The texts of the literals that an execution, a step of a plan or a derived fact used.
_Texts = dict[Any, dict[str, None]]
# Links, each after the number of its revision, which is read at the end; 0: none.
_Links = list[tuple[int, CauseLink]]
_EXECUTION, _DERIVED = "execution", "derived fact"


def _link(
    depth: int, kind: str, id_: str | None, text: str, used: Iterable[str], made: Iterable[str]
) -> CauseLink:
    """Make a link whose revision is read later."""
    return CauseLink(depth, kind, id_, text, None, tuple(used), tuple(made))


def _at(link: CauseLink, revision: Revision | None) -> CauseLink:
    """Give a link its revision; the first one of a branch loaded a state, not a document."""
    source: Any = None if revision is None else revision.source
    if link.kind == "document" and isinstance(source, dict) and {"parent", "hash"} <= source.keys():
        said = f"{source['parent']} at revision {source.get('revision')}"
        link = replace(link, kind="branch", text=f"branch of {said}")
    return replace(link, revision=revision)


class _Tracer:
    """Follows links within one snapshot."""

    def __init__(self, state: State, view: View, limit: int) -> None:
        assert view.kb_id is not None
        self.view, self.session, self.kb_id = view, view.session, view.kb_id
        position = read_position(view.session, view.kb_id)
        self.at = position.head if state.at is None else state.at
        self.archived = position.archived
        self.limit = limit
        self.links: _Links = []
        # Conditions are first judged in the state after the last archived revision.
        self.searched = position.archived and position.archived + 1
        self._reader = ExecutionReader(state.store, view)
        self._evaluation = _Evaluation(view, position.head)

    def result(self, text: str) -> CauseLinks:
        """Return the found links, up to the limit."""
        shown = self.links[: self.limit]
        revisions = read_numbered(self.session, self.kb_id, {one for one, _ in shown if one})
        links = tuple(_at(link, revisions.get(number)) for number, link in shown)
        return CauseLinks(text, links, self.searched or None, self.is_full)

    @property
    def is_full(self) -> bool:
        """Whether there are more links than requested."""
        return len(self.links) > self.limit

    # Consequences.

    def follow(self, found: _Sought, depth: int) -> None:
        """Find what used an element, then what used the results of that, and so on."""
        self.searched = max(self.searched, found.first)
        targets, seen = found.targets, set[Key]()
        for level in range(1, depth + 1):
            if not targets or self.is_full:
                return
            targets = self._used(targets, level, seen)

    def _used(self, targets: list[_Target], level: int, seen: set[Key]) -> list[_Target]:
        """Find the users of some literals; return the literals that they made."""
        wanted = dict.fromkeys(one for target in targets for one in self._wanted(target))
        found, searched = find_acts(
            self.session, self.kb_id, self.view.definitions, wanted, self.limit + 1
        )
        self.searched = max(self.searched, searched)
        acts: dict[Any, Execution] = {**self._reader.listed([one.key for one in found])}
        # Find the state that a plan was made from, unless it was recorded after the asked state;
        # its steps come from other keys than their executions.
        known = [one for one in found if one.is_planned and one.key in acts]
        planned = {(*one.key, 0): one.revision for one in known}
        jobs: list[tuple[Any, _Job]] = [
            (key, job)
            for key in dict.fromkeys(one.key for one in found if not one.is_planned)
            if key in acts and key not in seen
            for job in _moments(acts[key])
        ]
        for key, at in planned.items():
            acts[key] = acts[key[:2]]
            jobs += [(key, _ActJob(acts[key], time, at)) for time in TIMES]
        ready = {(one.literal, one.since) for one in targets}
        used: _Texts = defaultdict(dict)
        for (owner, _), own in zip(jobs, self._run(jobs), strict=True):
            texts = dict.fromkeys(one.text for one in own if (one.literal, one.since) in ready)
            if texts:
                used[owner].update(texts)
        seen.update(used)
        if len(found) > self.limit >= len(self.links) + len(used):
            self.searched = max(self.searched, found[-1].revision)
        if len(self.links) + len(used) <= self.limit:
            self._add_derived(targets, used)
        return self._linked(level, acts, used, planned)

    def _add_derived(self, targets: list[_Target], used: _Texts) -> None:
        """Add the derived facts that used some literals, which come last."""
        jobs = [one.last(self.at) for one in targets]
        is_one = len({one.literal for one in targets}) == 1
        for text, own in self._evaluation.derived(jobs):
            used[text][own] = None
            if is_one and len(self.links) + len(used) > self.limit:
                return

    def _wanted(self, target: _Target) -> Iterator[WantedActs]:
        """Yield the acts that may have used a literal."""
        low = max(target.since, self.archived, 1)
        high = self.at if target.until is None else min(target.until, self.at)
        users = [*users_of(self.view.definitions, target.literal)]
        for definition in executable(self.view.definitions) if low <= high else ():
            action = prepared(self.view.definitions, definition)
            places = {one.slot: place for place, one in enumerate(action.parameters)}
            for (head, terms), user in product(occurrences(action), users):
                # The literal may have an arity that no longer exists, or never did.
                if head != user[:2] or len(terms) != len(user.row):
                    continue
                pairs = [
                    (term, id_)
                    for term, id_ in zip(terms, user.row, strict=True)
                    if id_ is not None
                ]
                if any(isinstance(term, r.Known) and term.id != id_ for term, id_ in pairs):
                    continue
                fixed = [(id_, places[term]) for term, id_ in pairs if term in places]
                (one, first), (other, second) = [*fixed, (0, 0), (0, 0)][:2]
                yield WantedActs(definition.id, one, first, low, high, other, second)

    def _linked(
        self, level: int, acts: dict[Any, Execution], used: _Texts, planned: dict[Any, int]
    ) -> list[_Target]:
        """Add the users, and return the literals that they made."""
        done = {key: acts[key].revisions for key in used if key in acts and key not in planned}
        numbers = {one for revisions in done.values() for one in revisions}
        made: defaultdict[int, list[_Target]] = defaultdict(list)
        for one in changed_atoms(self.session, self.kb_id, numbers) if numbers else ():
            text = one.text if one.holds else f"(not {one.text})"
            target = _Target(Literal(*one.atom, one.holds), one.revision, one.until, text)
            made[one.revision].append(target)
        targets, found = list[_Target](), _Links()
        for key, texts in used.items():
            if key in done:
                own = [one for number in done[key] for one in made[number]]
                targets += own
                changed = dict.fromkeys(one.text for one in own)
                what = _EXECUTION, acts[key].id, str(acts[key])
                found.append((done[key][0], _link(level, *what, texts, changed)))
            elif key in planned:
                what = "plan", str(key[0]), str(acts[key])
                found.append((planned[key], _link(level, *what, texts, ())))
            else:
                found.append((0, _link(level, _DERIVED, None, key, texts, [key])))
        self._add(found)
        return targets

    def _add(self, found: _Links) -> None:
        """Add links, the newest first."""
        self.links += sorted(found, key=lambda one: -one[0])

    # Origins.

    def go_back(self, sought: _Sought, depth: int) -> None:
        """Find what made the last version of an element true, then what that used, and so on."""
        if not sought.targets:
            return
        level = [sought.targets[0].last(self.at)]
        seen = {one[:2] for one in level}
        for number in range(1, depth + 1):
            if not level or self.is_full:
                return
            found = {one[:2]: one for one in self._made(level, number)}
            level = [one for key, one in found.items() if key not in seen]
            seen.update(found)

    def _made(self, level: list[_Dated], depth: int) -> list[_Dated]:
        """Find what made literals true; return the literals that it used."""
        made: defaultdict[int, dict[str, None]] = defaultdict(dict)
        for one in level:
            made[one.since][one.text] = None
        acted, loaded = find_origins(self.session, self.kb_id, made)
        acts = self._reader.listed([key for _, key in acted])
        jobs: list[tuple[Any, _Job]] = [
            ((number, key), job)
            for number, key in acted
            for job in _moments(acts[key])
            if job.at < number
        ]
        jobs += [(one, one) for one in level if not one.since]
        used: defaultdict[Any, list[_Dated]] = defaultdict(list)
        for (owner, job), own in zip(jobs, self._run(jobs), strict=True):
            # The first literal of a fact is that fact.
            used[owner] += own[isinstance(job, _Dated) :]
        found = _Links()
        for number in made.keys() - {number for number, _ in acted} - {0}:
            kind = "document" if number in loaded else "observation"
            text = loaded.get(number) or " ".join(made[number])
            found.append((number, _link(depth, kind, None, text, (), made[number])))
        for number, key in acted:
            texts = dict.fromkeys(one.text for one in used[number, key])
            what = _EXECUTION, acts[key].id, str(acts[key])
            found.append((number, _link(depth, *what, texts, made[number])))
        for one in level:
            if used.get(one):
                texts = dict.fromkeys(each.text for each in used[one])
                found.append((0, _link(depth, _DERIVED, None, one.text, texts, [one.text])))
        self._add(found)
        return [one for own in used.values() for one in own]

    def _run(self, jobs: list[tuple[Any, _Job]]) -> list[list[_Dated]]:
        return self._evaluation.run([job for _, job in jobs])


def occurrences(action: PreparedAction) -> list[tuple[Head, tuple[r.Place, ...]]]:
    """Return the facts and fluents that the conditions of an action mention."""
    return action.kept("mentioned", lambda: list(_occurrences(action)))


def _occurrences(action: PreparedAction) -> Iterator[tuple[Head, tuple[r.Place, ...]]]:
    for part in (part for time in TIMES for part in parts_used(action, time)):
        for one in r.parts_of(part):
            head = head_of(one)
            if head is not None:
                yield head, one.terms


def consequences(
    state: State, element: Element, *, depth: int = 1, limit: int | None = 50
) -> CauseLinks:
    """Find the consequences of a fact or value: the acts, plans and derived facts that used it.

    An act used a version if the version held when the act's condition held, and the condition
    depends on it: see the page "Causes". Conditions of conditional effects, and numbers that an
    effect reads, count, too.

    Args:
        element: a fact or a fluent, as for `history`; `(not (robot_at rb1 wp1))` for its absence;
            `(= (battery rb1) 10)` for the versions with this value.
        depth: the number of links to follow; 1 for direct uses.
        limit: the most links, the newest of each level first; None for all.

    Returns:
        The links, the nearest first.

    Raises:
        InvalidKnowledgeError: it is not a fact or a fluent.
        UnknownNameError: its names never existed.

    Examples:
        >>> kb.consequences("(robot_at rb1 wp1)").links
        ()
    """
    return _trace(state, element, depth, limit, _Tracer.follow)


def origins(
    state: State, element: Element, *, depth: int = 10, limit: int | None = 100
) -> CauseLinks:
    """Find the origins of a fact or a value: acts, observations and documents.

    Args:
        element: a fact or a fluent, as for `consequences`.
            Its present or last version counts.
        depth: the number of links to go back.
        limit: the most links, the newest of each level first; None for all.

    Returns:
        The links, the nearest first. A literal in `used` that is in no `made` was always so, or has
        an origin beyond `depth`.

    Raises:
        InvalidKnowledgeError: it is not a fact or a fluent.
        UnknownNameError: its names never existed.

    Examples:
        >>> [(link.kind, link.made) for link in kb.origins("(robot_at rb1 wp1)")]
        [('observation', ('(robot_at rb1 wp1)',))]
    """
    return _trace(state, element, depth, limit, _Tracer.go_back)


def _trace(
    state: State,
    element: Element,
    depth: int,
    limit: int | None,
    trace: Callable[[_Tracer, _Sought, int], None],
) -> CauseLinks:
    """Find links within one snapshot."""
    whole_number(depth, "depth", least=1, expected="a whole number from 1 on")
    # One more is read, to know whether there are more than the limit.
    most = min(at_most(limit), LARGEST - 1)

    def work(view: View) -> CauseLinks | None:
        if view.kb_id is None:
            return None
        tracer = _Tracer(state, view, most)
        found = _find(view, element, tracer.at)
        if found is None:
            return None
        trace(tracer, found, depth)
        return tracer.result(found.text)

    links = state.store.read_in_snapshot(work, state.at)
    if links is None:
        refuse_unknown_element(state.store, element)
        return CauseLinks(str(element), (), None, False)
    return links


def literals_used(state: State, executions: Sequence[Execution]) -> list[list[tuple[str, int]]]:
    """Return the literals that each execution used, each with its first revision."""

    def work(view: View) -> list[list[tuple[str, int]]]:
        jobs = [(place, job) for place, one in enumerate(executions) for job in _moments(one)]
        found: list[list[tuple[str, int]]] = [[] for _ in executions]
        head = read_position(view.session, view.kb_id).head
        used = _Evaluation(view, head).run([job for _, job in jobs]) if jobs else []
        for (place, _), own in zip(jobs, used, strict=True):
            found[place] += [(one.text, one.since) for one in own]
        return found

    return state.store.read_in_snapshot(work, state.at)
