"""An erasure reaches what was moved to an archive: the same is left as in a whole replica."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.errors import (
    ConflictError,
    DivergedError,
    InvalidArgumentError,
    StoreBusyError,
    StoreIntegrityError,
    UnknownNameError,
)
from kant_sql.history.archive import archive as archiving
from kant_sql.history.archive.archive import replicate
from kant_sql.history.erasure import archived as reaching
from kant_sql.history.erasure.retention import read_rules
from tests.contract.test_erasure import NAME, everything, files_of, fill, rehash
from tests.support.archives import damage, intact, rows_of, target_url
from tests.support.processes import commands
from tests.support.processes.crashes import die_after
from tests.support.processes.workers import dies
from tests.support.stores import Connect

ALSO = ["reason", "source"]


def live(kb: KnowledgeBase) -> int:
    """A history of which much ends, and some comes back; give its last revision."""
    fill(kb)
    kb.propositions.delete(f"(at {NAME} bath)")
    kb.function_values.save(f"(= (age {NAME}) 82)")
    kb.rules.delete("watch")
    kb.objects.save("eva - person")
    kb.propositions.save("(at eva bath)")
    kb.propositions.save("(at eva hall)")
    kb.objects.delete("eva")
    kb.objects.delete("bob")
    return kb.revision


def names_it(url: str) -> bool:
    """Tell whether a byte of the name is in a store; another name contains it."""
    files = [file.read_bytes().lower() for file in files_of(url)]
    return any(NAME.encode() in file.replace(f"{NAME}2".encode(), b"") for file in files)


def same(one: str, other: str) -> bool:
    """Tell whether two replicas have the same rows."""
    rows, others = ({**rows_of(url), "head": None, "verification": None} for url in (one, other))
    return rows == others


@pytest.mark.every_backend
def test_it_is_erased_in_both_and_in_replicas(
    shared_url: str, any_archive_url: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    before = live(kb)
    away, new = (target_url(tmp_path, f"{name}.db") for name in ("away", "new"))
    kb.store.push(away)
    kb.store.archive(before, to=any_archive_url)
    # What comes back has other ids here than in the archive.
    kb.objects.save("eva - person")
    kb.propositions.save("(at eva bath)")
    kb.propositions.delete("(at eva bath)")
    kb.propositions.save("(at eva hall)")
    anchor = kb.store.anchor()
    assert kb.erasure_preview(NAME, archive=any_archive_url).revisions > 10
    erased = kb.erase(NAME, reason="asked", also=ALSO, archive=any_archive_url)
    assert (erased.pseudonym, erased.remaining) == ("erased-1", ())
    assert not names_it(shared_url)
    assert not names_it(any_archive_url)
    # Others in texts that were replaced already, and one that ended and came back.
    for name in ("bath", "eva"):
        kb.erase(name, reason="asked", archive=any_archive_url)
        assert kb.store.verify(anchor).findings == ()
    kb.store.archive(kb.revision, to=any_archive_url)
    kb.erase("bob", reason="left", archive=any_archive_url)
    archive = connect(any_archive_url, knowledge_base="tiago")
    for each in (kb, archive):
        verification = each.store.verify(anchor)
        assert (verification.findings, len(verification.erasures)) == ((), 4)
    assert NAME not in everything(archive).replace(f"{NAME}2", "")
    assert archive.at(2).holds("(at erased-1 hall)")
    assert "erased-1" in str([*archive.diff(1, before)])
    for url in (away, new):
        kb.store.push(url, archive=any_archive_url)
        intact(url)
        assert same(url, any_archive_url)
        assert not names_it(url)
    kb.propositions.save("(at erased-3 erased-2)")
    assert kb.store.push(any_archive_url).revisions == 1


def test_a_preview_lists_archives_that_are_called_so(
    shared_url: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    url = target_url(tmp_path, f"of {NAME}.db")
    kb.store.archive(live(kb), to=url)
    mention = kb.erasure_preview(NAME, archive=url).mentions[-1]
    assert (mention.place, NAME in mention.text) == ("archive", True)


def test_what_revisions_say_is_erased_by_rules(
    shared_url: str, any_archive_url: str, connect: Connect
) -> None:
    kb = connect(shared_url, knowledge_base="tiago", actor="test")
    kb.store.archive(live(kb), to=any_archive_url)
    with pytest.raises(ConflictError, match="--archive"):
        kb.store.retain(read_rules(["camera 0s reason,source"]))
    done = kb.store.retain(read_rules(["camera 0s reason,source"]), archive=any_archive_url)
    assert (done.parts, done.revisions) == (2, 1)
    assert kb.erase(NAME, reason="asked", archive=any_archive_url).parts > 15
    assert kb.store.verify().findings == ()
    intact(any_archive_url)
    assert not names_it(any_archive_url)


@pytest.mark.parametrize("way", ["push", "erase", "archive"])
def test_an_archive_that_was_not_reached_follows_later(
    file_url: str, archive_url: str, connect: Connect, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    kb = connect(file_url, knowledge_base="tiago", actor="test")
    kb.store.archive(live(kb), to=archive_url)
    copy = f"{archive_url}-copy"
    kb.erasure_preview(NAME, archive=archive_url)
    shutil.copy(archive_url.removeprefix("sqlite:///"), copy.removeprefix("sqlite:///"))

    def unreachable(*_: object) -> tuple[str, ...]:
        return ("it",)

    with monkeypatch.context() as patch:
        patch.setattr(reaching.ArchivedPart, "follow", unreachable)
        assert kb.erase(NAME, reason="asked", also=ALSO, archive=archive_url).remaining == ("it",)
    assert kb.store.verify().findings == ()
    assert names_it(archive_url)
    if way == "push":
        kb.store.push(archive_url)
    elif way == "archive":
        kb.store.archive(kb.revision, to=archive_url)
    else:
        with pytest.raises(UnknownNameError):
            kb.erase(NAME, reason="asked", archive=archive_url)
    for url in (archive_url, copy):
        kb.store.push(url)
        intact(url)
        assert not names_it(url)
    assert same(archive_url, copy)
    intact(file_url)


def erase_and_die(here: str, there: str, statements: int) -> None:
    """Erase, and be killed behind so many statements; with none, between the two commits."""

    def follow(*_: object) -> None:
        os.kill(os.getpid(), signal.SIGKILL)

    with kant_sql.connect(here, knowledge_base="tiago") as kb:
        if statements:
            die_after(statements)
        else:
            setattr(reaching.ArchivedPart, "follow", follow)  # noqa: B010
        kb.erase(NAME, reason="asked", also=ALSO, archive=there)


@pytest.mark.more
def test_a_killed_erasure_leaves_both_intact(
    file_url: str, archive_url: str, connect: Connect
) -> None:
    kb = connect(file_url, knowledge_base="tiago", actor="test")
    end = live(kb)
    kb.store.archive(end, to=archive_url)
    for statements in (*random.sample(range(1, 600), 5), 0):
        assert dies(erase_and_die, file_url, archive_url, statements) or statements
        is_done = kb.revision > end + 1
        for url in (file_url, archive_url):
            intact(url)
        if is_done:
            break
    assert is_done
    assert kb.objects.get(NAME) is None
    kb.store.push(archive_url)
    intact(archive_url)
    assert not names_it(archive_url)
    assert kb.erase("hall", reason="rebuilt", archive=archive_url).parts > 5
    intact(file_url)


WRONG = {
    "none": (ConflictError, "no such archive"),
    "same": (ConflictError, "the same store"),
    "short": (ConflictError, "lacks the versions"),
    "other": (DivergedError, "another knowledge base"),
    "ahead": (DivergedError, "another knowledge base"),
    "promoted": (DivergedError, "another knowledge base"),
    "partial": (ConflictError, "not an archive there"),
    "altered": (StoreIntegrityError, "the archive .* was altered"),
    "lacking": (StoreIntegrityError, "the archive .* was altered"),
    "left": (StoreIntegrityError, "the rest of the revisions"),
}


def prepare(wrong: str, here: str, there: str, other: str) -> tuple[str, str]:
    """Make what cannot be erased in; give the store and the archive to erase in."""
    file, copy = there.removeprefix("sqlite:///"), other.removeprefix("sqlite:///")
    with kant_sql.connect(here, knowledge_base="tiago") as kb:
        end = live(kb)
        kb.store.archive(6, to=there)
        if wrong == "short":
            shutil.copy(file, copy)
        kb.store.archive(end, to=there)
        if wrong in ("ahead", "partial"):
            kant_sql.operations.backup(here, copy)
        if wrong == "ahead":
            kb.types.save("crane")
            kb.store.push(there)
    if wrong == "other":
        with kant_sql.connect(other, knowledge_base="tiago") as kb:
            fill(kb)
    if wrong == "promoted":
        with kant_sql.connect(there, knowledge_base="tiago") as archive:
            archive.store.promote()
    if wrong in DAMAGED:
        damage(here if wrong == "left" else there, DAMAGED[wrong])
    places = {"same": (here, here), "ahead": (other, there)}
    is_other = wrong in ("none", "short", "other", "partial")
    return places.get(wrong, (here, other if is_other else there))


DAMAGED = {
    "altered": "UPDATE revision SET reason = 'another' WHERE number = 4",
    "lacking": "DELETE FROM proposition_version WHERE since = 4",
    "left": "UPDATE revision SET reason = 'another' WHERE number = 4",
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_is_not_the_whole_archive_is_refused(
    wrong: str, file_url: str, archive_url: str, connect: Connect, tmp_path: Path
) -> None:
    other = target_url(tmp_path, "other.db")
    here, there = prepare(wrong, file_url, archive_url, other)
    before = rows_of(here), rows_of(archive_url)
    kb = connect(here, knowledge_base="tiago", actor="test")
    error, match = WRONG[wrong]
    with pytest.raises(error, match=match):
        kb.erase(NAME, reason="asked", also=ALSO, archive=there)
    assert before[0] == rows_of(here)
    assert before[1] == rows_of(archive_url)
    assert wrong != "none" or not (tmp_path / "other.db").exists()


@pytest.mark.parametrize("what", ["moved", "erased"])
def test_what_another_does_to_the_archive_meanwhile_is_not_overlooked(
    what: str, file_kb: KnowledgeBase, archive_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    end = live(file_kb)
    file_kb.store.archive(6, to=archive_url)

    def meanwhile(*given: Any) -> tuple[str, ...]:
        monkeypatch.setattr(reaching, "replicate", replicate)
        if what == "moved":
            file_kb.store.archive(end, to=archive_url)
        else:
            file_kb.erase("hall", reason="rebuilt", archive=archive_url)
        return replicate(*given)

    monkeypatch.setattr(reaching, "replicate", meanwhile)
    with pytest.raises(StoreBusyError, match="meanwhile"):
        file_kb.erase(NAME, reason="asked", also=ALSO, archive=archive_url)
    assert file_kb.erase(NAME, reason="asked", also=ALSO, archive=archive_url).parts
    assert not names_it(archive_url)
    intact(archive_url)


@pytest.mark.parametrize("moment", ["_move_all", "rest_digest"])
def test_what_is_erased_while_it_is_archived_is_in_neither(
    moment: str,
    shared_url: str,
    archive_url: str,
    connect: Connect,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kb, other = (connect(shared_url, knowledge_base="tiago") for _ in range(2))
    end, original = live(kb), getattr(archiving, moment)

    def after_an_erasure(*given: Any) -> Any:
        monkeypatch.undo()
        found = original(*given) if moment == "rest_digest" else None
        with ThreadPoolExecutor(1) as another:
            another.submit(other.erase, NAME, reason="asked", also=ALSO).result(60)
        return found or original(*given)

    monkeypatch.setattr(archiving, moment, after_an_erasure)
    assert kb.store.archive(end, to=archive_url).revision == end + 2
    assert not names_it(archive_url)
    intact(shared_url)
    intact(archive_url)


def test_of_two_archives_the_one_that_has_all_is_named(
    file_url: str, connect: Connect, tmp_path: Path
) -> None:
    kb = connect(file_url, knowledge_base="tiago", actor="test")
    live(kb)
    first, second = (tmp_path / f"{year}.db" for year in (2026, 2027))
    kb.store.archive(kb.revision - 3, to=f"sqlite:///{first}")
    shutil.copy(first, second)
    kb.store.archive(kb.revision, to=f"sqlite:///{second}")
    with pytest.raises(ConflictError, match=re.escape(f"in the archive sqlite:///{second}, ")):
        kb.erase(NAME, reason="asked")
    kb.erase(NAME, reason="asked", archive=f"sqlite:///{second}")


def test_without_an_archive_there_is_nothing_to_name(
    file_kb: KnowledgeBase, archive_url: str
) -> None:
    fill(file_kb)
    file_kb.store.push(archive_url)
    with pytest.raises(InvalidArgumentError, match="leave archive="):
        file_kb.erase(NAME, reason="asked", archive=archive_url)


def test_moved_revisions_of_form_1_are_erased(
    file_url: str, archive_url: str, connect: Connect, tmp_path: Path
) -> None:
    fill(connect(file_url, knowledge_base="tiago")).close()
    rehash(file_url)
    kb = connect(file_url, knowledge_base="tiago")
    away, new = (target_url(tmp_path, f"{name}.db") for name in ("away", "new"))
    kb.store.push(away)
    kb.store.archive(kb.revision, to=archive_url)
    anchor = kb.store.anchor()
    with pytest.raises(ConflictError, match="revisions of form 1 mention it"):
        kb.erase(NAME, reason="asked", also=ALSO, archive=archive_url)
    for name in (NAME, "bath"):
        found = kb.erase(name, reason="asked", also=ALSO, form_1=True, archive=archive_url)
        assert (found.form_1 > 5, found.remaining) == (True, ())
        assert kb.store.verify(anchor=anchor).findings == ()
        intact(archive_url)
    for url in (away, new):
        kb.store.push(url, archive=archive_url)
        intact(url)
    assert same(away, new)
    assert not any(map(names_it, (file_url, archive_url, away, new)))
    damage(archive_url, "UPDATE revision SET actor = 'x' WHERE number = 3")
    assert not connect(archive_url, knowledge_base="tiago").store.verify().is_intact


def test_the_prompt_takes_an_archive(file_url: str, archive_url: str, connect: Connect) -> None:
    kb = connect(file_url, knowledge_base="tiago", actor="test")
    kb.store.archive(live(kb), to=archive_url)
    words = "erase", file_url, NAME, "--archive", archive_url
    assert "Nothing was changed" in commands.run(*words).output
    done = commands.run(
        *words, "--reason", "asked", "--also", "reason", "--also", "source", "--yes"
    )
    assert (done.exit_code, "erased-1" in done.output) == (0, True)
    rules = "retention", file_url, "--after", "0s", "--archive", archive_url
    assert commands.run(*rules).exit_code == 0
    assert not names_it(archive_url)
    assert commands.run("verify", archive_url).exit_code == 0
