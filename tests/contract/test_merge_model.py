"""Random changes on both sides of a merge, beside a model of sets that is merged by brute force."""

from __future__ import annotations

from typing import Any, Literal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kant_sql
from kant_sql import KnowledgeBase
from tests.support.profile import PROFILE

# Kind and text -> what it is: of a value the number, of all else True.
Key = tuple[str, str]
State = dict[Key, Any]
Op = tuple[str, Any]

OBJECTS = ["a", "b"]
ATOMS = [("fact", "(p a)"), ("fact", "(q a b)"), ("fact", "(p b)"), ("goal", "(p a)")]
FLUENTS = [("value", "(f a)"), ("value", "(f b)")]
DOMAIN = "(define (domain d) (:predicates (p ?x) (q ?x ?y)) (:functions (f ?x)))"
_flips = st.sampled_from([*ATOMS, *(("object", name) for name in OBJECTS)])
_sets = st.tuples(st.sampled_from(FLUENTS), st.sampled_from([None, 1, 2, 3]))
_ops = st.lists(st.one_of(_flips.map(lambda key: ("flip", key)), st.tuples(st.just("set"), _sets)))
OPS = st.tuples(_ops, _ops)


def mentioned(key: Key) -> set[Key]:
    """The objects that something mentions."""
    words = key[1].strip("()").split()[1:]
    return set() if key[0] == "object" else {("object", name) for name in words}


class Side:
    """A knowledge base with its model, and what each of its revisions touched."""

    def __init__(self, kb: KnowledgeBase, state: State) -> None:
        self.kb, self.state = kb, dict(state)
        self.touched: list[set[Key]] = []

    def run(self, op: Op) -> None:
        """Apply a change to both; one that would mention what is not there is left out."""
        what, given_ = op
        key, value = given_ if what == "set" else (given_, None if given_ in self.state else True)
        if not mentioned(key) <= self.state.keys():
            return
        before = dict(self.state)
        if value is None:
            self.state.pop(key, None)
        else:
            self.state[key] = value
        if key[0] == "object" and value is None:
            self.state = {one: own for one, own in self.state.items() if key not in mentioned(one)}
        _write(self.kb, key, value)
        self.note(before)

    def note(self, before: State) -> None:
        """Note what a revision touched."""
        keys = before.keys() | self.state.keys()
        touched = {key for key in keys if before.get(key) != self.state.get(key)}
        if touched:
            self.touched.append(touched)


def _write(kb: KnowledgeBase, key: Key, value: Any) -> None:
    kind, text = key
    if kind == "value":
        names = text.strip("()").split()[1:]
        if value is None:
            kb.function_values.delete(text)
        else:
            kb.function_values.set("f", objects=names, value=value)
        return
    daos: dict[str, Any] = {"fact": kb.propositions, "goal": kb.goals, "object": kb.objects}
    if value is None:
        daos[kind].delete(text)
    else:
        daos[kind].save(f"{text} - object" if kind == "object" else text)


def read(kb: KnowledgeBase) -> State:
    """What is there, as the model has it."""
    found: State = {("object", one.name): True for one in kb.objects.get_all()}
    found |= {("fact", str(one)): True for one in kb.propositions.get_all()}
    found |= {("goal", str(one)): True for one in kb.goals.get_all()}
    for one in kb.function_values.get_all():
        names = " ".join(each.name for each in one.objects)
        found["value", f"(f {names})"] = int(str(one.value))
    return found


class Model:
    """The merge of two models, by brute force over all keys."""

    def __init__(self, ours: Side, theirs: Side, base: State, since: tuple[int, int]) -> None:
        self.ours, self.theirs = ours.state, theirs.state
        touched_here = set().union(*ours.touched[since[0] :])
        self.ever = set().union(*ours.touched)
        changed = set().union(*theirs.touched[since[1] :])
        differing = {key for key in changed if self.ours.get(key) != self.theirs.get(key)}
        self.contested = {
            key for key in differing if key in touched_here or self.ours.get(key) != base.get(key)
        }
        self.taken = differing - self.contested

    def users(self, key: Key, also: set[Key]) -> set[Key]:
        """What mentions an object that one side lacks, if the result may lack it and have that."""
        if (key in self.ours) == (key in self.theirs):
            return set()
        own = self.ours if key in self.ours else self.theirs
        on = self.ever - self.taken if own is self.ours else self.taken
        is_there = (key in self.taken) == (own is self.theirs)
        if is_there and key not in also:
            return set()
        return {
            one
            for one in on | also
            if key in mentioned(one) and one in own and self.ours.get(one) != self.theirs.get(one)
        }

    def conflicts(self) -> set[Key]:
        found, before = set(self.contested), None
        while found != before:
            before = set(found)
            found |= {("object", one) for one in OBJECTS if self.users(("object", one), before)}
        return found

    def merged(self, side: str) -> State:
        """The result when all conflicts are decided alike."""
        decided = self.conflicts()
        while decided:
            self.taken = self.taken - decided if side == "ours" else self.taken | decided
            decided = set().union(*(self.users(("object", one), set()) for one in OBJECTS))
        result = dict(self.ours)
        for key in self.taken:
            result.pop(key, None)
            if key in self.theirs:
                result[key] = self.theirs[key]
        return result


@settings(max_examples=PROFILE.programs, deadline=None)
@given(st.lists(OPS, min_size=1, max_size=3), st.sampled_from(["ours", "theirs"]))
@pytest.mark.more
def test_a_merge_is_that_of_the_model(rounds: list[Any], side: Literal["ours", "theirs"]) -> None:
    with kant_sql.connect("sqlite://", knowledge_base="tiago") as kb:
        kb.load_domain(DOMAIN)
        start = Side(kb, read(kb))
        for key in (*(("object", name) for name in OBJECTS), *ATOMS[:2], ATOMS[3]):
            start.run(("flip", key))
        start.run(("set", (FLUENTS[0], 1)))
        with kb.branch() as trial:
            ours, theirs = Side(kb, start.state), Side(trial, start.state)
            base, since = dict(start.state), (0, 0)
            for here, there in rounds:
                for one, ops in ((ours, here), (theirs, there)):
                    for op in ops:
                        one.run(op)
                model = Model(ours, theirs, base, since)
                found = kb.merge_preview(trial)
                conflicts = {f"{kind} {text}" for kind, text in model.conflicts()}
                assert {each.element for each in found.conflicts} == conflicts
                decide = dict.fromkeys(conflicts, side)
                made = kb.merge(trial, decide=decide)
                before = dict(ours.state)
                ours.state = model.merged(side)
                assert read(kb) == ours.state
                if made.revision is not None:
                    ours.note(before)
                    assert kb.diff(made.revision - 1, made.revision) == [*made.changes]
                    base, since = dict(theirs.state), (len(ours.touched), len(theirs.touched))
            assert kb.store.verify().is_intact
