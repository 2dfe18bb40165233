"""Trajectories by valid times, judged by the model of all sayings."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from kant_sql_plugins.trajectory import export_trajectories
from tests.support.profile import PROFILE
from tests.support.statements import count
from tests.support.stores import Connect
from tests.support.two_clocks import FACTS, FLUENTS, Model, Writer

MICROSECOND = timedelta(microseconds=1)
FACT = re.compile(r"\(= \([^)]*\) [^)]*\)|\([^)]*\)")


class Act(NamedTuple):
    """When an act began and ended, and the revisions that are of it."""

    began: datetime
    ended: datetime
    own: set[int]


def write(writer: Writer, acts: dict[str, Act], count: int) -> None:
    """Write revisions of any kind, and acts that are done, or reported with some changes."""
    kb, random, times = writer.kb, writer.random, writer.model.times
    kb.types.save("tick")
    kb.actions.save("(:action mark :parameters (?t - tick) :precondition (and) :effect (and))")
    while len(acts) < count:
        writer.step()
        tick = f"t{len(acts)}"
        kb.objects.save(f"{tick} - tick")
        writer.note()
        first, (began, ended) = max(times) + 1, sorted(random.choices([*times.values()], k=2))
        if random.random() < 0.3:
            kb.apply(f"(mark {tick})")
            writer.note()
            began = ended = times[first]
        else:
            given: Any = {"outcome": "succeeded", "started_at": began, "ended_at": ended}
            step = kb.executions.report("mark", arguments=[tick], **given)
            contents = {one: writer.content(one) for one in random.sample(writer.elements, 2)}
            writer.write(contents, random.choice([began, ended]), execution=step)
        acts[f"(mark {tick})"] = Act(began, ended, {*range(first, max(times) + 1)})


def state(model: Model, moment: datetime) -> frozenset[str]:
    """What learners read of the state at a time: facts and numbers."""
    contents = {one: model.truth(one, moment, max(model.times)) for one in (*FACTS, *FLUENTS[:2])}
    said = {key: key if one is True else f"(= {key} {one})" for key, one in contents.items() if one}
    return frozenset(said.values())


def sayers(model: Model, act: Act) -> list[set[int]]:
    """For each change during an act, the revisions that may have said it."""
    found = []
    for end in [one for one in model.moments() if act.began <= one <= act.ended]:
        for text in state(model, end) ^ state(model, end - MICROSECOND):
            said = {one.since for one in model.sayings if one.element in text and end in one[2:4]}
            plain = {one.since for one in model.plain if one.element in text}
            found.append(said | {one for one in plain if model.times[one] == end})
    return found


def transitions(url: str, folder: Path, **window: Any) -> dict[str, tuple[frozenset[str], ...]]:
    """Export trajectories; return the states before and after each act."""
    window |= {"to": folder, "knowledge_base": "clocks", "replace": True, "clock": "valid"}
    done, found = export_trajectories(url, **window), dict[str, tuple[frozenset[str], ...]]()
    for file in done.files:
        lines = (folder / file.path).read_text().splitlines()[:-1] if file.rows else []
        states = [frozenset(FACT.findall(line.partition(" ")[2])) for line in lines[0::2]]
        for place, act in enumerate(lines[1::2]):
            found[act.removeprefix("(operator: ")[:-1]] = states[place], states[place + 1]
    return found


@pytest.mark.parametrize("seed", range(max(2, PROFILE.episodes)))
def test_states_are_those_of_the_model(
    shared_url: str, connect: Connect, tmp_path: Path, seed: int
) -> None:
    writer, acts = Writer(connect(shared_url, knowledge_base="clocks"), seed), dict[str, Act]()
    write(writer, acts, 25)
    writer.kb.objects.save("early - tick")
    before: Any = {"outcome": "succeeded", "ended_at": "1 hour ago"}
    writer.kb.executions.report("mark", arguments=["early"], **before)
    model, found = writer.model, transitions(shared_url, tmp_path / "out")
    assert found.keys() <= acts.keys()
    for text, act in acts.items():
        said = sayers(model, act)
        if text in found:
            assert found[text] == (state(model, act.began - MICROSECOND), state(model, act.ended))
            assert all(one & act.own for one in said), (text, act)
        else:
            assert not all(one <= act.own for one in said), (text, act)
    since, until = sorted(writer.random.sample([*model.times.values()], 2))
    part = transitions(shared_url, tmp_path / "out", since=since, until=until)
    within = {key for key, act in acts.items() if since <= act.began and act.ended <= until}
    assert part == {key: found[key] for key in found.keys() & within}


def test_it_takes_as_many_statements_however_much_was_said(
    shared_url: str, connect: Connect, tmp_path: Path
) -> None:
    writer, taken = Writer(connect(shared_url, knowledge_base="clocks")), []
    for acts in (3, 30):
        write(writer, {}, acts)
        taken.append(count(partial(transitions, shared_url, tmp_path / "out")))
    assert taken[0] == taken[1] <= 30
