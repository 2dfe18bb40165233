"""`kant-sql verify`: one knowledge base or all of them, in several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from datetime import datetime
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from ..errors import InvalidMetadataError, KantSqlError, printable
from ..knowledge.canonical import time_text
from ..pddl.lexer import read_file
from .common import AnchorFile, Name, Url, choose, json_lines, option, parse_when
from .output import FAILED, Printer, bar, plural, write_json

if TYPE_CHECKING:
    from ..history.anchors import Anchor
    from ..history.verify.sides import Finding
    from ..history.verify.verify import Verification
    from ..knowledge_base import KnowledgeStore

    Progress = Callable[[int, int], None] | None

# Connections of a process: one verifies, one stores the last verified revision.
CONNECTIONS = 2


class VerificationTask(NamedTuple):
    """The verification of one knowledge base."""

    name: str
    anchor: Anchor | None
    structure: bool
    resume: bool


def verify(
    url: Url,
    kb: Name = None,
    verify_all: Annotated[
        bool,
        option("Verify all knowledge bases, each from its last verified revision on.", "--all"),
    ] = False,
    jobs: Annotated[int, option("With --all: the number of processes.", metavar="N", min=1)] = 1,
    is_continued: Annotated[
        bool | None,
        option(
            "Begin where the last verification ended, or at revision 1; default: at revision 1, "
            "with --all where the last one ended.",
            "--continue/--complete",
        ),
    ] = None,
    complete_since: Annotated[
        str | None,
        option(
            "Begin at revision 1 unless a verification did so since this time, such as "
            "'7 days ago'.",
            metavar="TIME",
        ),
    ] = None,
    anchor: AnchorFile = None,
    as_json: Annotated[bool, json_lines("knowledge base")] = False,
) -> int:
    """Verify that the history is intact.

    Recomputes every hash from the tables, compares columns with texts, indexes with their tables,
    and the structure with that of the migrations. Reports findings by revision, and exits with 1 if
    there are any. The store keeps the last verified revision, and the next verification can
    continue there: it checks later revisions, and does not find alterations of earlier ones. After
    an interruption, run --all again to continue.
    """
    from ..history.anchors import parse_anchor

    if kb is not None and verify_all:
        raise typer.BadParameter("give --kb or --all, not both", param_hint="--all")
    if jobs > 1 and not verify_all:
        raise typer.BadParameter("give --all with it", param_hint="--jobs")
    since = _parse_since(complete_since, is_continued)
    anchored = None if anchor is None else parse_anchor(read_file(anchor))
    wants = verify_all or since is not None if is_continued is None else is_continued
    names = _chosen(url, kb, verify_all, anchored)
    tasks = _tasks(url, names, anchored, wants, since)
    printer, totals = Printer(), Counter[str]()
    for done in run_tasks(url, tasks, jobs):
        totals["all"] += 1
        totals["intact"] += done.is_intact
        totals["continued"] += done.continued_from is not None
        totals["done"] += done.revisions
        if as_json:
            write_json(done)
        else:
            _write(printer, done, anchored is not None, verify_all or wants)
        # Readers who follow a long run get each line at once.
        sys.stdout.flush()
    if verify_all and not as_json:
        _write_totals(printer, totals)
    return 0 if totals["intact"] == totals["all"] else FAILED


def _parse_since(text: str | None, is_continued: bool | None) -> datetime | None:
    if text is None:
        return None
    if is_continued is not None:
        other = "--continue" if is_continued else "--complete"
        raise typer.BadParameter(f"not with {other}", param_hint="--complete-since")
    moment = parse_when(text, "--complete-since")
    if not isinstance(moment, datetime):
        raise typer.BadParameter("expected a time", param_hint="--complete-since")
    return moment


def _chosen(url: str, name: str | None, verify_all: bool, anchor: Anchor | None) -> list[str]:
    """Choose the knowledge bases to verify, including anchored ones that are gone."""
    from ..sql.catalog import every_name

    names = every_name(url)
    heads = () if anchor is None else anchor.heads
    gone = [head.knowledge_base for head in heads if head.knowledge_base not in names]
    if verify_all:
        return [*names, *gone]
    if gone and (name in gone or (name is None and not names)):
        return gone
    return [choose(name, names), *gone]


def _tasks(
    url: str, names: list[str], anchor: Anchor | None, wants: bool, since: datetime | None
) -> list[VerificationTask]:
    """Make a task for each knowledge base: where to begin; one also checks the structure."""
    from ..sql.catalog import complete_verifications

    known = complete_verifications(url) if wants else {}

    def is_continued(name: str) -> bool:
        at = known.get(name)
        return at is not None and (since is None or at >= since)

    # All share the structure. A complete verification of that one also compares the indexes.
    first = next((name for name in names if not is_continued(name)), names[0] if names else None)
    return [VerificationTask(name, anchor, name == first, is_continued(name)) for name in names]


def run_tasks(url: str, tasks: list[VerificationTask], jobs: int) -> Iterator[Verification]:
    """Verify knowledge bases, in the order of their tasks."""
    jobs = min(jobs, len(tasks))
    if jobs > 1:
        yield from _run_in_processes(url, tasks, jobs)
    elif tasks:
        from ..knowledge_base import open_store

        with open_store(url, connections=CONNECTIONS) as store:
            for task in tasks:
                with bar(_text(task.name)) as progress:
                    done = _verify(store, task, progress)
                # After the bar, which would capture the output.
                yield done


def _run_in_processes(url: str, tasks: list[VerificationTask], jobs: int) -> Iterator[Verification]:
    # A fork would copy locks that threads of this process hold.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, initializer=_begin, initargs=(url,)) as pool:
        try:
            yield from pool.map(_verify_in_process, tasks)
        except BrokenProcessPool as error:
            raise KantSqlError(
                "a verifying process was killed or could not begin; finished verifications are "
                "kept: run the command again to continue"
            ) from error


# The store of this process, if it is one of several.
_STORES: list[KnowledgeStore] = []


def _begin(url: str) -> None:
    """Open the store in a worker process."""
    from ..knowledge_base import open_store

    # Ctrl-C ends all processes: the first one reports it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _STORES.append(open_store(url, connections=CONNECTIONS))


def _end_with_parent() -> None:
    """End this process when its parent was killed: nobody would read its findings."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _verify_in_process(task: VerificationTask) -> Verification:
    return _verify(_STORES[0], task, None)


def _verify(store: KnowledgeStore, task: VerificationTask, progress: Progress) -> Verification:
    from ..history.verify.sides import Finding
    from ..history.verify.verify import Verification

    try:
        with closing(store.knowledge_base(task.name)) as knowledge_base:
            return knowledge_base.store.verify(
                task.anchor,
                progress=progress,
                structure=task.structure,
                resume=task.resume,
                keep=True,
            )
    except InvalidMetadataError as error:
        # The library never writes such a name; continue with the others.
        return Verification(_text(task.name), 0, 0, (Finding(None, "knowledge_base", str(error)),))


def _text(name: object) -> str:
    """Write a name: SQLite stores any type in any column."""
    return name if isinstance(name, str) else repr(name)


def _write(printer: Printer, done: Verification, has_anchor: bool, is_resumable: bool) -> None:
    """Write the findings of one knowledge base."""
    line, name = printer.line, printable(done.knowledge_base)
    counts = f"{done.revisions} revisions, {done.changes} changes"
    for finding in done.findings:
        line(f"{name}: {printable(_finding_text(finding))}", "red")
    if done.is_intact:
        line(f"{name}: intact ({counts})", "green")
    else:
        line(f"{name}: {plural(len(done.findings), 'finding')} ({counts})", "bold red")
    if done.continued_at is not None:
        line(f"{name}: {_continued(done)}")
    if is_resumable and done.keep_error is not None:
        line(f"{name}: {_not_kept(done.is_intact, printable(done.keep_error))}", "yellow")
    for erased in done.erasures:
        line(f"{name}: {printable(erased)}")
    for archive in done.archives:
        line(f"{name}: {printable(archive)}")
    if has_anchor and done.anchored is None:
        line(f"{name}: not in the anchor", "yellow")


def _write_totals(printer: Printer, totals: Mapping[str, int]) -> None:
    """Write the totals of all knowledge bases."""
    wrong = totals["all"] - totals["intact"]
    found = f"{wrong} not intact" if wrong else "all intact"
    printer.line(
        f"{plural(totals['all'], 'knowledge base')}: {found}; "
        f"{plural(totals['done'], 'revision')} verified, {totals['continued']} continued",
        "bold red" if wrong else "bold",
    )


def _continued(done: Verification) -> str:
    assert done.continued_at is not None
    complete = done.complete_at
    whole = "" if complete is None else f", all of it last at {time_text(complete)}"
    return (
        f"revisions 1 to {done.continued_from} verified at {time_text(done.continued_at)}, "
        f"continued from there{whole}"
    )


def _not_kept(is_intact: bool, why: str) -> str:
    if is_intact:
        return f"where this ended is not kept: {why}"
    return f"where an earlier one ended may still be kept, so verify with --complete next: {why}"


def _finding_text(finding: Finding) -> str:
    place = "" if finding.revision is None else f"revision {finding.revision}: "
    table = "" if finding.table is None else f"{finding.table}: "
    return f"{place}{table}{finding.message}"
