"""Rules that are kept: a transaction that would break one fails, whatever it is about."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random

import pytest

import kant_sql
from kant_sql import DependantsError, KnowledgeBase, UnsupportedConstructError, aio
from kant_sql.errors import InvalidKnowledgeError, InvalidNameError, PddlError
from kant_sql.errors import RuleViolatedError as Refused
from kant_sql.history.moments import head_revision
from kant_sql.knowledge_base import state_of
from kant_sql.reasoning import rule_watch
from kant_sql.reasoning.rule_watch import kept_within
from kant_sql.store.state import State
from tests.support.profile import HUNT
from tests.support.reading import Undone, beside, last_changes, present
from tests.support.statements import count
from tests.support.stores import Connect

DOMAIN = """
(define (domain ward) (:requirements :typing :derived-predicates :fluents :object-fluents)
  (:types robot place - object drone - robot)
  (:predicates (at ?r - robot ?p - place) (open ?p - place) (busy ?r - robot) (alarm))
  (:functions (battery ?r - robot) - number (home ?r - robot) - place)
  (:derived (busy ?r - robot) (exists (?p - place) (and (at ?r ?p) (open ?p)))))
"""
ONE_PLACE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"
SAME = "(imply (and (at ?r ?a) (at ?r ?b)) (= ?a ?b))"
# Rules, and what they say of one state in plain PDDL.
RULES = [
    (ONE_PLACE, f"(forall (?r - robot ?a ?b - place) {SAME})"),
    (
        "(forall (?r - drone) (at-most-one (?p - place) (at ?r ?p)))",
        f"(forall (?r - drone ?a ?b - place) {SAME})",
    ),
    (
        "(forall (?r - robot) (exactly-one (?p - place) (at ?r ?p)))",
        "(forall (?r - robot) (exists (?a - place)"
        " (and (at ?r ?a) (forall (?b - place) (imply (at ?r ?b) (= ?a ?b))))))",
    ),
    (
        "(always (forall (?p - place) (imply (open ?p) (exists (?r - robot) (at ?r ?p)))))",
        "(forall (?p - place) (imply (open ?p) (exists (?r - robot) (at ?r ?p))))",
    ),
    (
        "(and (forall (?r - robot) (always (imply (busy ?r) (>= (battery ?r) 10))))"
        " (always (exists (?p - place) (not (open ?p)))))",
        "(and (forall (?r - robot) (imply (busy ?r) (>= (battery ?r) 10)))"
        " (exists (?p - place) (not (open ?p))))",
    ),
    (
        "(forall (?r - robot) (always (not (and (alarm) (at ?r (home ?r))))))",
        "(forall (?r - robot) (not (and (alarm) (at ?r (home ?r)))))",
    ),
    (
        "(always (forall (?p - place) (or (open ?p) (not (alarm)) (at r1 ?p))))",
        "(forall (?p - place) (or (open ?p) (not (alarm)) (at r1 ?p)))",
    ),
    (
        "(at-most-one (?r - robot ?p - place) (and (at ?r ?p) (open ?p)))",
        "(forall (?r ?s - robot ?p ?q - place) (imply (and (at ?r ?p) (open ?p) (at ?s ?q)"
        " (open ?q)) (and (= ?r ?s) (= ?p ?q))))",
    ),
]


def fill(kb: KnowledgeBase) -> KnowledgeBase:
    kb.load_domain(DOMAIN)
    kb.objects.save(["r1 - robot", "r2 - drone", "hall - place", "room - place"])
    kb.propositions.save(["(at r1 hall)", "(at r2 room)"])
    kb.function_values.save(["(= (battery r1) 50)", "(= (battery r2) 50)"])
    return kb


@pytest.fixture
def kb(fresh_kb: KnowledgeBase) -> KnowledgeBase:
    """Two robots in two places."""
    return fill(fresh_kb)


def test_an_error_names_what_violates_a_part_of_a_rule(kb: KnowledgeBase) -> None:
    kb.rules.save("one", RULES[2][0].replace("robot)", "drone)"), on_violation="refuse")
    kb.rules.save("and", "(always (and (not (alarm)) (not (open hall))))", on_violation="refuse")
    with pytest.raises(Refused, match=r"violated by \(open hall\);"):
        kb.propositions.save("(open hall)")
    kb.rules.delete("and")
    with kb.transaction():
        kb.objects.save("d9 - drone")
        kb.propositions.save("(at d9 hall)")
    with pytest.raises(Refused, match=r"violated by \(at d9 hall\), \(at d9 room\);"):
        kb.propositions.save("(at d9 room)")
    with pytest.raises(Refused, match=r"would be violated;"):
        kb.propositions.delete("(at d9 hall)")


def test_a_rule_is_an_element_with_a_history(kb: KnowledgeBase) -> None:
    assert kb.rules.get_all() == []
    assert kb.rules.save("one-place", ONE_PLACE)
    before = kb.revision
    kb.rules.save("One-Place", ONE_PLACE, on_violation="refuse")
    text = "rule (:rule one-place :on-violation"
    assert last_changes(kb) == [f"+ {text} refuse {ONE_PLACE})", f"- {text} report {ONE_PLACE})"]
    kept = present(kb.rules.get("ONE-place"))
    assert (kept.name, kept.rule, kept.on_violation) == ("one-place", ONE_PLACE, "refuse")
    assert str(kept) == f"one-place (refuse): {ONE_PLACE}"
    for ask in (kb.rules.get, kb.rules.delete):
        with pytest.raises(InvalidNameError, match="a name is a string, not int: 3"):
            ask(3)  # type: ignore[arg-type]
    past = present(kb.at(before).rules.get("one-place"))
    assert past.on_violation == "report"
    assert [kb.rules.delete("one-place"), kb.rules.delete("one-place")] == [True, False]
    assert [each.sign for each in kb.diff(before, kb.revision)] == ["-"]
    assert [each.text for each in kb.history("one-place")][-1].startswith("(:rule one-place")
    kb.restore(before)
    assert kb.rules.get_all() == [past]
    with kb.branch() as branch:
        assert branch.rules.get_all() == [past]
    assert kb.store.verify().is_intact


def test_two_places_are_refused_with_what_is_wrong(kb: KnowledgeBase) -> None:
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    before = kb.revision
    with pytest.raises(Refused) as caught:
        kb.propositions.save("(at r1 room)")
    assert (caught.value.rule, caught.value.instance) == (
        "one-place",
        "(at-most-one (?p - place) (at r1 ?p))",
    )
    assert str(caught.value).startswith(
        "rule 'one-place' refuses this: (at-most-one (?p - place) (at r1 ?p)) would be violated "
        "by (at r1 hall), (at r1 room); nothing was written: "
    )
    assert kb.revision == before
    assert not kb.holds("(at r1 room)")
    with kb.transaction():
        kb.propositions.save("(at r1 room)")
        kb.propositions.delete("(at r1 hall)")
    assert kb.holds("(at r1 room)")
    assert kb.revision == before + 1
    kb.goals.save("(at r1 hall)")
    assert kb.store.verify().is_intact


def test_a_rule_that_is_violated_now_is_not_kept(kb: KnowledgeBase) -> None:
    kb.propositions.save("(at r1 room)")
    with pytest.raises(Refused, match=r"by \(at r1 hall\), \(at r1 room\);"):
        kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    assert kb.rules.get_all() == []
    kb.rules.save("one-place", ONE_PLACE)
    assert [str(each).split(" is ")[1][:8] for each in kb.rules.standing()] == ["violated", "kept"]
    with kb.transaction():
        kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
        kb.propositions.delete("(at r1 room)")
    assert [each.is_satisfied for each in kb.rules.standing()] == [True, True]


@pytest.mark.parametrize(
    ("name", "rule", "error", "message"),
    [
        ("a b", ONE_PLACE, InvalidNameError, "it has ' ' "),
        ("r", "(always (at r9 hall))", PddlError, "r9"),
        ("r", "(sometime (at r1 hall))", UnsupportedConstructError, "no single state violates"),
        ("r", "(preference p (always (alarm)))", UnsupportedConstructError, "no single state"),
        ("r", "(always (sometime (alarm)))", UnsupportedConstructError, "is inside of it"),
        ("r", "(always (alarm)) (always (alarm))", InvalidKnowledgeError, "has 2 formulas"),
        ("r", "(at-most-one (at r1 hall))", PddlError, "at-most-one"),
    ],
)
def test_what_cannot_refuse_is_not_kept(
    kb: KnowledgeBase, name: str, rule: str, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        kb.rules.save(name, rule, on_violation="refuse")
    assert kb.rules.get_all() == []


def test_a_type_that_takes_its_objects_with_it_is_noticed(kb: KnowledgeBase) -> None:
    kb.types.save("closet - place")
    kb.objects.save("c1 - closet")
    kb.propositions.save(["(open hall)", "(open room)"])
    kb.rules.save("r", "(always (exists (?p - place) (not (open ?p))))", on_violation="refuse")
    with pytest.raises(Refused):
        kb.types.delete("closet")
    assert kb.objects.get("c1") is not None


def test_documents_have_no_counts(kb: KnowledgeBase) -> None:
    with pytest.raises(PddlError):
        kb.pddl.constraints.save(ONE_PLACE)
    with pytest.raises(PddlError):
        kb.holds("(at-most-one (?p - place) (at r1 ?p))")


def test_what_a_rule_mentions_is_redefined_with_it(kb: KnowledgeBase) -> None:
    kb.rules.save("one-place", ONE_PLACE)
    with pytest.raises(DependantsError, match="rule one-place"):
        kb.predicates.save("(at ?r - robot)")
    kb.predicates.save("(at ?r - robot)", cascade=True)
    assert kb.rules.get_all() == []
    kb.rules.save("calm", "(always (not (open hall)))")
    kb.objects.delete("hall")
    assert kb.rules.get_all() == []


def test_a_write_that_touches_no_rule_takes_the_same_statements(kb: KnowledgeBase) -> None:
    def write() -> None:
        kb.propositions.save("(open hall)")
        kb.propositions.delete("(open hall)")

    write()
    plain = count(write)
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    write()
    assert count(write) == plain


def test_statements_do_not_grow_with_what_is_touched(kb: KnowledgeBase) -> None:
    kb.objects.save([f"d{number} - drone" for number in range(12)])
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")

    def move(*robots: int) -> Callable[[], object]:
        return lambda: kb.propositions.save([f"(at d{number} hall)" for number in robots])

    move(0)()
    assert count(move(1)) == count(move(*range(2, 12)))
    with pytest.raises(Refused, match=r"\(at d9 hall\), \(at d9 room\)"):
        kb.propositions.save(["(at r1 hall)", "(at d9 room)"])


def test_another_connection_knows_the_rules(kb: KnowledgeBase) -> None:
    second = beside(kb, kb.store.factory.name)
    second.propositions.save("(open hall)")
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    with pytest.raises(Refused):
        second.propositions.save("(at r1 room)")
    kb.rules.delete("one-place")
    second.propositions.save("(at r1 room)")


def test_a_restored_or_branched_state_is_checked(kb: KnowledgeBase) -> None:
    kb.propositions.save("(at r1 room)")
    wrong = kb.revision
    kb.propositions.delete("(at r1 room)")
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    kb.restore(wrong)
    assert kb.rules.get_all() == []
    assert kb.holds("(at r1 room)")
    kb.restore(kb.revision - 1)
    with kb.branch() as branch, pytest.raises(Refused):
        branch.propositions.save("(at r1 room)")
    objects = "(:objects r1 - robot hall room - place)"
    wrong_init = "(:init (at r1 room) (at r1 hall))"
    with pytest.raises(Refused):
        kb.load_problem(f"(define (problem p) (:domain ward) {objects} {wrong_init})")


def test_a_replica_has_the_rules_and_an_archive_those_of_the_past(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    replica, archive = (f"sqlite:///{tmp_path / name}.db" for name in ("replica", "archive"))
    kb.rules.save("one-place", ONE_PLACE)
    kb.store.push(replica)
    kb.rules.save("one-place", ONE_PLACE, on_violation="refuse")
    kb.store.push(replica)
    with kant_sql.connect(replica, knowledge_base=kb.store.factory.name) as other:
        assert other.rules.get_all() == kb.rules.get_all()
        assert other.store.verify().is_intact
        other.store.promote()
        with pytest.raises(Refused):
            other.propositions.save("(at r1 room)")
    kb.store.archive(kb.revision, to=archive)
    assert kb.store.verify().is_intact
    with kant_sql.connect(archive, knowledge_base=kb.store.factory.name) as moved:
        assert moved.store.verify().is_intact


OBJECTS = {"robot": ("r1", "r3"), "drone": ("r2", "r4"), "place": ("hall", "room", "ward")}


def change(random: Random) -> Callable[[KnowledgeBase], None]:
    """One random change; of what is unknown by then, none."""
    robot = random.choice(("r1", "r2", "r3", "r4"))
    place = random.choice(OBJECTS["place"])
    kind = random.choice(("robot", "drone", "place"))
    name = random.choice(OBJECTS[kind])
    fact = random.choice((f"(at {robot} {place})", f"(at {robot} {place})", f"(open {place})"))
    fact = random.choice((fact, fact, fact, "(alarm)"))
    value = random.choice((f"(= (battery {robot}) {random.choice((5, 20))})",) * 2)
    value = random.choice((value, f"(= (home {robot}) {place})"))
    draw = random.random()

    def make(kb: KnowledgeBase) -> None:
        with suppress(PddlError):
            if draw < 0.45:
                kb.propositions.save(fact)
            elif draw < 0.7:
                kb.propositions.delete(fact)
            elif draw < 0.85:
                kb.function_values.save(value)
            elif draw < 0.93:
                kb.objects.save(f"{name} - {kind}")
            else:
                kb.objects.delete(name)

    return make


def judge(kb: KnowledgeBase, twin: KnowledgeBase, seed: int, steps: int) -> int:
    """Refuse by a rule, and by asking the whole state of a twin without rules."""
    random = Random(seed)
    rule, condition = RULES[seed % len(RULES)]
    refused = 0
    for each in (kb, twin):
        fill(each)
    kb.rules.save("rule", rule, on_violation="refuse")
    for _ in range(steps):
        changes = [change(random) for _ in range(random.randint(1, 3))]
        try:
            with twin.transaction():
                for one in changes:
                    one(twin)
                gone = kb.rules.get("rule") is None or (
                    not twin.objects.get("r1") and " r1 " in rule
                )
                if not gone and not twin.holds(condition):
                    raise Undone
            is_kept = True
        except Undone:
            is_kept = False
        try:
            with kb.transaction():
                for one in changes:
                    one(kb)
            assert is_kept, (rule, seed)
        except Refused:
            assert not is_kept, (rule, seed)
            refused += 1
    facts, others = (sorted(map(str, each.propositions.get_all())) for each in (kb, twin))
    assert facts == others
    return refused


@pytest.mark.parametrize("number", range(len(RULES)))
def test_a_change_is_refused_where_the_whole_state_would_be(
    fresh_kb: KnowledgeBase, connect: Connect, number: int
) -> None:
    judge(fresh_kb, connect("sqlite://"), number, 25)


@pytest.mark.more
def test_random_changes_break_each_rule(connect: Connect) -> None:
    refused = [0] * len(RULES)
    for seed in range(HUNT or 5 * len(RULES)):
        refused[seed % len(RULES)] += judge(connect("sqlite://"), connect("sqlite://"), seed, 60)
    assert all(refused)


def test_each_verdict_comes_with_the_commit_that_decides_it(kb: KnowledgeBase) -> None:
    kb.rules.save("one-place", ONE_PLACE)
    kb.rules.save("visit", "(forall (?p - place) (sometime-after (at r1 ?p) (open ?p)))")
    begin = kb.revision
    watching = kb.watch_rules(timeout=0)
    kb.propositions.save("(at r1 room)")
    kb.propositions.save(["(open room)", "(at r2 hall)"])
    kb.rules.save("calm", "(always (not (alarm)))")
    kb.propositions.save("(alarm)")
    own = [(one.name, one.verdict, one.revision and one.revision.number) for one in watching]
    assert own == [
        ("one-place", "violated", begin + 1),
        ("visit", "pending", begin + 1),
        ("one-place", "violated", begin + 2),
        ("visit", "kept", begin + 2),
        ("calm", "kept", begin + 3),
        ("calm", "violated", begin + 4),
    ]
    resumed = [*kb.watch_rules(after=begin + 2, timeout=0)]
    assert [(one.name, one.revision and one.revision.number) for one in resumed] == [
        ("calm", begin + 3),
        ("calm", begin + 4),
    ]
    assert {str(each) for each in resumed} <= {
        str(each) for each in kb.watch_rules(after=0, timeout=0)
    }


def test_an_outage_hides_no_verdict_of_rules_that_are_gone(kb: KnowledgeBase) -> None:
    def verdicts(after: int) -> list[str]:
        return [f"{each.name}: {each}" for each in kb.watch_rules(after=after, timeout=0)]

    random, begin, found = Random(0), kb.revision, list[str]()
    steps: list[Callable[[], object]] = [
        lambda: kb.rules.save("calm", "(always (not (alarm)))"),
        lambda: kb.rules.save("calm", "(sometime (open hall))"),
        lambda: kb.rules.save("one-place", ONE_PLACE),
        lambda: kb.rules.delete("calm"),
        lambda: kb.predicates.delete("alarm"),
        lambda: kb.predicates.save("(alarm)"),
        *[lambda: kb.propositions.save("(alarm)")] * 2,
        *[lambda: change(random)(kb)] * 4,
    ]
    for _ in range(60):
        before = kb.revision
        with suppress(kant_sql.KantSqlError):
            random.choice(steps)()
        found += verdicts(before)
    assert verdicts(begin) == found
    # It was redefined or deleted each time.
    assert sum(each.startswith("calm: ") and "violated" in each for each in found) > 2


def test_a_watched_verdict_is_that_of_check_rules(kb: KnowledgeBase) -> None:
    random = Random(7)
    rules = [
        ONE_PLACE,
        "(forall (?r - robot) (sometime-before (at ?r room) (open room)))",
        "(sometime (alarm))",
        "(forall (?p - place) (sometime-after (open ?p) (exists (?r - robot) (at ?r ?p))))",
        "(forall (?r - robot) (at-most-once (busy ?r)))",
    ]
    watching = kb.watch_rules(rules, after=kb.revision, timeout=0)
    seen = {each.rule: each.verdict for each in kb.watch_rules(rules, after=0, timeout=0)}
    for _ in range(12):
        change(random)(kb)
        seen |= {
            each.rule: each.verdict
            for each in kb.watch_rules(rules, after=kb.revision - 1, timeout=0)
        }
        said = {each.rule: each for each in kb.pddl.check_rules(rules)}
        for rule, verdict in said.items():
            assert verdict.is_satisfied == (seen[rule] == "kept"), rule
    last = {each.rule: each.verdict for each in watching}
    assert last.items() <= seen.items()


def test_within_a_transaction_nobody_else_who_judges_is_waited_for(
    kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb.rules.save("alone", ONE_PLACE)
    judges, has_answer = threading.Event(), threading.Event()

    def wait(state: State) -> int:
        if not judges.is_set():
            judges.set()
            assert has_answer.wait(20)
        return head_revision(state)

    monkeypatch.setattr(rule_watch, "head_revision", wait)
    with ThreadPoolExecutor(1) as other:
        found = other.submit(kb.rules.standing)
        assert judges.wait(60)
        with kb.transaction():
            assert {each.verdict for each in kb.rules.standing()} == {"kept"}
            has_answer.set()
        assert {each.verdict for each in found.result(60)} == {"kept"}


def test_standing_goes_on_from_the_last_call(kb: KnowledgeBase) -> None:
    assert kb.rules.standing() == []
    kb.rules.save("calm", "(always (not (alarm)))")
    [kept] = kb.rules.standing()
    assert (kept.name, kept.verdict) == ("calm", "kept")
    kb.propositions.save("(alarm)")
    [violated] = kb.rules.standing()
    assert (violated.verdict, present(violated.revision).number) == ("violated", kb.revision)
    [before] = kb.at(kb.revision - 1).rules.standing()
    assert before.verdict == "kept"
    kb.rules.delete("calm")
    assert kb.rules.standing() == []


KEPT = [
    ONE_PLACE,
    "(forall (?r - robot) (sometime-before (at ?r room) (open room)))",
    "(within 0.02 (alarm))",
    "(forall (?p - place) (sometime-after (open ?p) (exists (?r - robot) (at ?r ?p))))",
    "(always-within 0.01 (alarm) (not (alarm)))",
    "(hold-during 0.01 0.05 (not (open hall)))",
    "(forall (?r - robot) (at-most-once (busy ?r)))",
]


@pytest.mark.more
def test_rules_that_are_judged_together_are_judged_as_each_alone(kb: KnowledgeBase) -> None:
    random, saved = Random(3), dict[str, int]()
    for number in range(60):
        if random.random() < 0.2:
            name = f"rule-{random.randrange(9)}"
            kb.rules.save(name, random.choice(KEPT))
            saved[name] = kb.revision
        change(random)(kb)
        if number % 7:
            continue
        for view in (kb, kb.at(kb.revision)):
            found = view.rules.standing()
            alone = [
                replace(one, name=rule.name)
                for rule in kb.rules.get_all()
                for one in kb.pddl.check_rules(rule.rule, since=saved[rule.name])
            ]
            assert [one.rule for one in found] == [one.rule for one in alone]
            for one, other in zip(found, alone, strict=True):
                # What is open is violated if the last state is the end.
                assert one == other or (one.is_pending and not other.is_satisfied)
    assert {one.verdict for one in found} >= {"kept", "violated"}


@pytest.mark.more
@pytest.mark.parametrize("clock", ["committed", "valid"])
def test_a_quantifier_within_a_preference_has_the_objects_of_each_state(
    kb: KnowledgeBase, clock: str
) -> None:
    random, violated = Random(5), 0
    for number in range(80):
        change(random)(kb)
        if number % 10 < 9:
            continue
        for inner in (
            "(sometime-after (open ?p) (exists (?r - robot) (at ?r ?p)))",
            "(sometime-before (open ?p) (alarm))",
            "(always (not (open ?p)))",
            "(at end (not (open ?p)))",
        ):
            each = f"(forall (?p - place) {inner})"
            hard = kb.pddl.check_rules(each, clock=clock)
            [soft] = kb.pddl.check_rules(f"(preference own {each})", clock=clock)
            ends = [present(one.revision).number for one in hard.violated]
            assert soft.is_satisfied == hard.is_satisfied
            assert ends == [] or present(soft.revision).number == min(ends)
            violated += bool(ends)
    assert 0 < violated < 32


def test_what_was_archived_since_the_last_verdict_is_passed_over(
    kb: KnowledgeBase, tmp_path: Path
) -> None:
    kb.rules.save("one-place", "(at-most-one (?p - place) (at r1 ?p))")
    kb.propositions.save("(at r1 hall)")
    assert [each.verdict for each in kb.rules.standing()] == ["kept"]
    kb.propositions.delete("(at r1 hall)")
    kb.propositions.save("(open hall)")
    kb.store.archive(kb.revision, to=f"sqlite:///{tmp_path / 'archive.db'}")
    kb.propositions.save("(at r1 room)")
    assert [each.verdict for each in kb.rules.standing()] == ["kept"]


def test_verdicts_forget_what_is_erased(kb: KnowledgeBase) -> None:
    kb.rules.save("one-place", "(forall (?r - drone) (at-most-one (?p - place) (at ?r ?p)))")
    kb.rules.save("calm", "(always (not (open hall)))")
    kb.objects.save(["alice - drone"])
    kb.propositions.save(["(at alice hall)", "(at alice room)", "(open hall)"])
    watching = kb.watch_rules(ONE_PLACE, timeout=0)
    assert "alice" in str(kb.rules.standing())
    list(watching)
    other = beside(kb, kb.store.factory.name)
    other.erase("alice", reason="asked for")
    other.propositions.delete("(open hall)")
    found = kb.rules.standing()
    assert "alice" not in str(found)
    assert found == kb.at(kb.revision).rules.standing()
    kb.propositions.delete("(at erased-1 hall)")
    assert "alice" not in str([*kb.watch_rules(ONE_PLACE, after=0, timeout=0)])
    assert "alice" not in str([*watching])


def test_rules_that_are_kept_share_their_statements(kb: KnowledgeBase) -> None:
    def counted() -> list[int]:
        watching = kb.watch_rules(after=kb.revision, timeout=0)
        kb.rules.standing()
        kb.propositions.save("(alarm)")
        kb.propositions.delete("(alarm)")
        ends = kb.revision - 1, kb.revision
        of_report = partial(kept_within, state_of(kb), *ends)
        return [count(kb.rules.standing), count(lambda: [*watching]), count(of_report)]

    kb.rules.save("calm", "(always (not (alarm)))")
    counted()
    alone = counted()
    for number, rule in enumerate(KEPT[:2] * 4):
        kb.rules.save(f"rule-{number}", rule)
    assert counted() == alone


async def test_asyncio_follows_rules(url: str) -> None:
    async with await aio.connect(url) as kb:
        await kb.load_domain(DOMAIN)
        await kb.rules.save("calm", "(always (not (alarm)))")
        begin = await kb.watch(0)
        await kb.propositions.save("(alarm)")
        assert [each.name for each in await kb.rules.get_all()] == ["calm"]
        followed = [each.verdict async for each in kb.watch_rules(after=begin, timeout=0)]
        assert followed == ["violated"]
