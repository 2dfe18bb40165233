"""Merging what a branch has said of periods: examples, and random sayings beside a model."""

from __future__ import annotations

from datetime import datetime, timedelta
from decimal import Decimal
from random import Random
from typing import Any, Literal

import pytest

import kant_sql
from kant_sql import ConflictError, InvalidArgumentError, KnowledgeBase, Merge
from kant_sql.errors import MergeConflictError
from kant_sql.history.merge import _Merging
from kant_sql.knowledge_base import state_of
from tests.contract.test_reasoning_branch import Branch, branch_of
from tests.support.profile import PROFILE
from tests.support.reading import loaded, present, store_of
from tests.support.two_clocks import FACTS, FLUENTS, Content, Model, Plain, Saying, Writer

__all__ = ["branch_of"]

DOMAIN = """(define (domain rooms) (:types robot place)
  (:predicates (open ?p - place) (home ?r - robot))
  (:functions (battery ?r - robot) - number (home ?r - robot) - place))"""
PROBLEM = """(define (problem monday) (:domain rooms) (:objects rb1 - robot p1 p2 p3 - place)
  (:init (open p2)) (:goal (and)))"""


@pytest.fixture
def rooms(kb: KnowledgeBase) -> KnowledgeBase:
    return loaded(kb, DOMAIN, PROBLEM)


def period(begin: int, end: int) -> dict[str, Any]:
    """A period of hours of a day that is over."""
    return {"valid_from": hour(begin), "valid_until": hour(end)}


def hour(number: int) -> str:
    return f"2020-01-01T{number:02}:00Z"


def said(found: Merge) -> list[str]:
    """What a merge says of periods, without these."""
    lines = (text for _, kind, text in found.changes if kind == "saying")
    return [line.partition(" :from")[0] for line in lines]


def save(kb: KnowledgeBase, begin: int, end: int, *texts: str, **given: Any) -> None:
    with kb.transaction(**period(begin, end), **given):
        kb.propositions.save([*texts])


def open_at(kb: KnowledgeBase, number: int) -> list[str]:
    found = kb.at(valid=hour(number)).propositions.get_by_predicate("open")
    return sorted(str(one) for one in found)


def test_what_was_said_of_periods_comes_over_in_one_revision(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    save(rooms, 8, 9, "(open p1)")
    with trial.transaction(**period(9, 11)):
        trial.propositions.save(["(open p1)", "(open p3)"])
        # A predicate and a function of one name: the texts of these two are the same.
        trial.propositions.delete("(home rb1)")
        trial.function_values.unset("(home rb1)")
        trial.function_values.set("(battery rb1)", value=80)
    with trial.transaction(valid_from="5 minutes ago"):
        trial.objects.save("p4 - place")
        trial.propositions.save("(open p4)")
        trial.propositions.delete("(open p2)")
    before = rooms.revision
    made = rooms.merge(trial)
    [log] = rooms.log(limit=1)
    assert (made.conflicts, made.revision) == ((), before + 1)
    assert sorted(log.changes) == [*made.changes]
    assert said(made) == [
        *("(:held (= (battery rb1) 80)", "(:held (open p1)", "(:held (open p3)"),
        *("(:held (open p4)", "(:not-held (home rb1)", "(:not-held (home rb1)"),
        "(:not-held (open p2)",
    ]
    assert open_at(rooms, 8) == ["(open p1)"]
    assert open_at(rooms, 10) == ["(open p1)", "(open p3)"]
    assert rooms.at(valid=hour(10)).function_values.get("(battery rb1)") == 80
    assert rooms.at(valid="4 minutes ago").holds("(and (open p4) (not (open p2)))")
    assert rooms.holds("(and (open p4) (not (open p2)))")
    assert rooms.merge(trial).revision is None
    assert rooms.store.verify().is_intact


@pytest.mark.parametrize("side", ["ours", "theirs"])
def test_what_differs_from_what_was_said_here_of_the_time_is_decided(
    rooms: KnowledgeBase, branch_of: Branch, side: Literal["ours", "theirs"]
) -> None:
    save(rooms, 9, 12, "(open p3)")
    trial = branch_of(rooms)
    with rooms.transaction(actor="door", reason="a log", **period(10, 11)):
        rooms.propositions.delete_all(["(open p1)", "(open p3)"])
    for kb, number in ((rooms, "80"), (trial, "80.0")):
        with kb.transaction(actor="camera", **period(9, 11)):
            kb.propositions.save("(open p2)")
            kb.function_values.set("(battery rb1)", value=Decimal(number))
    save(trial, 9, 11, "(open p1)", actor="camera")
    save(trial, 8, 10, "(open p3)")
    with pytest.raises(MergeConflictError, match=r"here \(:not-held \(open p1\).*door, a log"):
        rooms.merge(trial)
    [conflict] = rooms.merge_preview(trial).conflicts
    assert conflict.element.startswith("saying (:held (open p1) :from")
    assert present(conflict.theirs.revision).actor == "camera"
    made = rooms.merge(trial, decide={conflict.element: side})
    # What is said of the same period here needs nothing.
    both = ["(:held (open p1)", "(:held (open p3)"]
    assert said(made) == (both if side == "theirs" else both[1:])
    is_open = ["(open p1)"] if side == "theirs" else []
    assert open_at(rooms, 10) == [*is_open, "(open p2)"]
    assert rooms.merge(trial).revision is None
    # The branch corrects what was taken over, and contradicts what was not.
    save(trial, 10, 11, "(open p3)")
    with trial.transaction(**period(8, 9)):
        trial.propositions.delete("(open p3)")
    [conflict] = rooms.merge_preview(trial.at(5)).conflicts
    assert present(conflict.ours.text).startswith("(:not-held (open p3)")
    assert rooms.merge(trial.at(5), decide={conflict.element: "theirs"}).revision is not None
    assert rooms.merge(trial).conflicts == ()
    assert open_at(rooms, 8) == []


def test_what_was_changed_here_in_the_period_is_a_conflict(
    rooms: KnowledgeBase, branch_of: Branch
) -> None:
    trial = branch_of(rooms)
    with rooms.transaction(actor="door"):
        rooms.propositions.delete("(open p2)")
    rooms.function_values.set("(battery rb1)", value=80)
    before = rooms.store.revisions()[-2].committed_at - timedelta(minutes=1)
    with trial.transaction(valid_from=before):
        trial.propositions.save("(open p2)")
        trial.function_values.set("(battery rb1)", value=Decimal("80.0"))
    [conflict] = rooms.merge_preview(trial).conflicts
    assert conflict.element.startswith("saying (:held (open p2)")
    assert conflict.ours.text is None
    assert present(conflict.ours.revision).actor == "door"


def test_a_revision_says_one_thing_of_an_element(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    save(trial, 9, 11, "(open p1)")
    with trial.transaction(**period(10, 12)):
        trial.propositions.delete("(open p1)")
    save(trial, 11, 13, "(open p3)")
    save(trial, 10, 14, "(open p3)")
    with pytest.raises(ConflictError, match=r"\(open p1\).*as in kb\.merge\(branch\.at\(2\)\)"):
        rooms.merge(trial)
    assert "one saying about an element" in (rooms.merge_preview(trial).refused or "")
    first = trial.log(limit=10)
    [text] = [change.text for one in first for change in one.changes if ":not-held" in change.text]
    left = rooms.merge_preview(trial, decide={text: "ours"})
    assert (left.refused, said(left)) == (None, ["(:held (open p1)", "(:held (open p3)"])
    assert said(rooms.merge(trial.at(2))) == ["(:held (open p1)"]
    # Of what the branch said first of a time, nothing is left.
    assert said(rooms.merge(trial)) == ["(:held (open p3)", "(:not-held (open p1)"]
    assert [len(open_at(rooms, number)) for number in range(9, 15)] == [1, 1, 1, 1, 1, 0]
    assert rooms.store.verify().is_intact


def test_what_does_not_fit_here_is_left_out(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    save(trial, 9, 11, "(open p1)", "(open p3)")
    rooms.objects.delete("p3")
    found = rooms.merge_preview(trial)
    assert found.conflicts == ()
    assert "(open p3)" in (found.refused or "")
    with pytest.raises(ConflictError, match=r"\(open p3\).*'p3'.*decide each as 'ours'"):
        rooms.merge(trial)
    text = next(change.text for change in found.changes if "p3" in change.text)
    with pytest.raises(InvalidArgumentError, match="is not a conflict"):
        rooms.merge(trial, decide={text.replace("11:00", "12:00"): "ours"})
    assert said(rooms.merge(trial, decide={text: "ours"})) == ["(:held (open p1)"]


def test_a_time_that_is_yet_to_come_here(rooms: KnowledgeBase, branch_of: Branch) -> None:
    trial = branch_of(rooms)
    save(trial, 9, 11, "(open p1)")
    merging = _Merging(state_of(rooms), state_of(trial), None)
    early = datetime.fromisoformat(hour(11)) - timedelta(seconds=1)
    with store_of(rooms).transaction() as transaction:
        transaction.head = transaction.head._replace(clock=early)
        failed = merging.write(transaction).failed
    assert isinstance(failed, ConflictError)
    assert "after the store's clock, 2020-01-01T10:59:59" in str(failed)


class Trial(Writer):
    """A writer of a branch, whose domain is there."""

    def __init__(self, kb: KnowledgeBase, seed: int) -> None:
        self.kb, self.model, self.random = kb, Model(), Random(seed)
        self.elements = [*FACTS, *FLUENTS]
        self.note()


class Merging:
    """Two writers, and what the first has after merges, by brute force."""

    def __init__(self, kb: KnowledgeBase, seed: int) -> None:
        self.ours = Writer(kb, seed)
        self.ours.run(3)
        self.origin = self.base = kb.revision
        self.trial = kb.branch("trial")
        self.theirs = Trial(self.trial, -seed)
        self.merged, self.own = 1, set[int]()

    def said_here(self, element: str, at: datetime) -> tuple[Content, int] | None:
        """What was said here of a time since the branch began, and by which revision."""
        model = self.ours.model
        for one in reversed(model.sayings):
            covers = one.element == element and one.valid_from <= at < one.valid_until
            if covers and one.since > self.origin:
                return one.content, one.since
        for plain in reversed(model.plain):
            is_new = plain.element == element and plain.since > self.base
            is_change = model.then(element, plain.since - 1) != plain.content
            if is_new and is_change and model.times[plain.since] <= at:
                return plain.content, plain.since
        return None

    def contradicted(self, own: Saying) -> bool:
        """Whether a saying of the branch differs from what was said here of any time in it."""
        times = [at for at in self.ours.model.moments() if own.valid_from <= at < own.valid_until]
        found = [self.said_here(own.element, at) for at in (own.valid_from, *times)]
        return any(one and one[1] not in self.own and one[0] != own.content for one in found)

    def new(self, upto: int) -> list[Saying]:
        """What the branch says up to a revision, and says not otherwise of all its time later."""
        said = [one for one in self.theirs.model.sayings if self.merged < one.since <= upto]
        return [
            one
            for place, one in enumerate(said, 1)
            if not any(
                later.element == one.element
                and later.valid_from <= one.valid_from
                and one.valid_until <= later.valid_until
                for later in said[place:]
            )
        ]

    def run(self, random: Random) -> None:
        """Let both write; what only says the last saying of an element again is no change."""
        for writer in (self.theirs, self.ours):
            writer.run(random.randint(0, 4))
            last: dict[str, Saying] = {}
            for one in [*writer.model.sayings]:
                before = last.get(one.element)
                if before is not None and before[:4] == one[:4]:
                    writer.model.sayings.remove(one)
                last[one.element] = one

    def merge(self, upto: int, side: Literal["ours", "theirs"]) -> None:
        """Merge up to a revision of the branch, with all decided alike, and note what follows."""
        kb, branch = self.ours.kb, self.trial.at(upto)
        found, new = kb.merge_preview(branch), self.new(upto)
        listed = [one for one in found.conflicts if one.element.startswith("saying")]
        conflicts = [one for one in new if self.contradicted(one)]
        assert len(listed) == len(conflicts)
        assert all(one.ours.revision and one.theirs.revision for one in listed)
        decide: Any = {one.element: side for one in found.conflicts}
        taken = [one for one in new if side == "theirs" or one not in conflicts]
        if len({one.element for one in taken}) < len(taken):
            with pytest.raises(ConflictError, match=r"kb\.merge\(branch\.at\("):
                kb.merge(branch, decide=decide)
            for number in range(self.merged + 1, upto + 1):
                self.merge(number, side)
            return
        before = kb.revision
        made = kb.merge(branch, decide=decide)
        self.note(made, taken)
        if made.revision is not None:
            assert made.revision == before + 1 == kb.revision
            [last] = kb.log(limit=1)
            assert sorted(last.changes) == [*made.changes]
            self.base, self.merged = made.revision, upto
            self.own.add(made.revision)

    def note(self, made: Merge, taken: list[Saying]) -> None:
        """Note in the model what a merge has changed."""
        self.ours.note()
        number = made.revision or 0
        texts = {text for _, kind, text in made.changes if kind == "saying"}
        for one in taken:
            if number and any(element_in(text, one) for text in texts):
                self.ours.model.sayings.append(one._replace(since=number))
            else:
                # It was said here in the same words.
                same = [own[:4] for own in self.ours.model.sayings]
                assert one[:4] in same
        asserted = {}
        for sign, kind, text in made.changes:
            if kind in ("fact", "value"):
                element = text if kind == "fact" else text[3:].rpartition(" ")[0]
                content: Content = True if kind == "fact" else text[:-1].rpartition(" ")[2]
                if sign == "-":
                    content = False if kind == "fact" else None
                if sign == "+" or element not in asserted:
                    asserted[element] = content
        self.ours.model.plain += [Plain(*one, number) for one in asserted.items()]


def element_in(text: str, one: Saying) -> bool:
    """Whether the text of a change says this."""
    said = text.partition(" :from ")[0]
    held = isinstance(one.content, str)
    inner = f"(= {one.element} {one.content})" if held else one.element
    return said == f"({':held' if one.content else ':not-held'} {inner}"


def check(merging: Merging, random: Random) -> None:
    """Compare states of valid time with the model."""
    model, kb = merging.ours.model, merging.ours.kb
    now = max(model.times.values())
    moments = [at for at in model.moments() if at <= now]
    for at in random.sample(moments, min(8, len(moments))):
        state = kb.at(valid=at)
        facts = {str(one) for one in state.propositions.get_all()}
        assert facts == {one for one in FACTS if model.truth(one, at, kb.revision)}, at
        values = {}
        for one in state.function_values.get_all():
            name = f"({' '.join([one.function.name, *(each.name for each in one.objects)])})"
            values[name] = one.value.name if hasattr(one.value, "name") else str(one.value)
        truth = {one: model.truth(one, at, kb.revision) for one in FLUENTS}
        assert values == {one: said for one, said in truth.items() if said is not None}, at


@pytest.mark.more
@pytest.mark.parametrize("seed", range(PROFILE.programs))
def test_what_was_said_of_periods_is_merged_as_in_the_model(seed: int) -> None:
    random = Random(seed)
    with kant_sql.connect("sqlite://", knowledge_base="tiago") as kb:
        merging = Merging(kb, seed)
        with merging.trial:
            for _ in range(random.randint(1, 3)):
                merging.run(random)
                merging.merge(merging.trial.revision, random.choice(["ours", "theirs"]))
                check(merging, random)
            assert kb.store.verify().is_intact
