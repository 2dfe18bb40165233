"""`kant-sql log`, `history`, `blame`, `origins`, `diff`, `restore`, `watch` ...: revisions."""

from __future__ import annotations

import math
import select
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import ConnectionLostError, StoreUnreachableError, printable
from ..knowledge.canonical import time_text
from . import common as c
from .output import Printer, json_text, write_each, write_json

if TYPE_CHECKING:
    from ..history.corrections import Correction
    from ..history.revisions import LogEntry, Revision, Version
    from ..knowledge_base import KnowledgeBase
    from ..reasoning.because import CauseLink, CauseLinks
    from ..sql.changes import Change

_STYLES = {"+": "green", "-": "red"}


def write_entry(printer: Printer, entry: LogEntry) -> None:
    """Write a revision with its changes."""
    write_revision(printer, "", entry.revision, style="bold")
    write_changes(printer, entry.changes, "  ")


def write_revision(
    printer: Printer, said: str, revision: Revision, indent: str = "", style: str = ""
) -> None:
    """Write a label and a revision, and below it who, why and the source."""
    moment = time_text(revision.committed_at)
    printer.line(f"{indent}{said}revision {revision.number}  {moment}", style)
    for line in _metadata(revision):
        printer.line(f"{indent}  {line}")


def write_changes(printer: Printer, changes: Iterable[Change], indent: str = "") -> None:
    """Write changes, each on one line, or more if its text has several."""
    for sign, kind, text in changes:
        printer.line(f"{indent}{sign} {kind} {_indented(text, indent)}", _STYLES[sign])


def _write_version(printer: Printer, version: Version) -> None:
    """Write a version, and the revisions that asserted and retracted it."""
    printer.line(f"{version.kind} {_indented(version.text, '')}", "bold")
    ends = [("asserted", version.since, "+"), ("retracted", version.until, "-")]
    for what, revision, sign in ends:
        if revision is None:
            printer.line("  holds now")
            continue
        write_revision(printer, f"{what} in ", revision, "  ", _STYLES[sign])
    seen = version.confirmed
    if version.acts:
        printer.line(f"  effect of {', '.join(version.acts)}")
    if seen is not None:
        write_revision(printer, "confirmed in ", seen, "  ", _STYLES["+"])


def _indented(text: str, indent: str) -> str:
    return text.replace("\n", f"\n{indent}  ")


def _metadata(revision: Revision) -> Iterable[str]:
    """Yield the metadata of a revision, one line each."""
    for name, value in (("actor", revision.actor), ("reason", revision.reason)):
        if value is not None:
            yield f"{name}: {printable(value)}"
    if revision.source is not None:
        yield f"source: {json_text(revision.source)}"
    if revision.observed_at is not None:
        yield f"observed at: {time_text(revision.observed_at)}"
    if revision.execution is not None:
        yield str(revision.execution).replace(",", "")


_OfActor = Annotated[
    str | None, c.option("Show only revisions of this actor.", "--actor", metavar="NAME")
]
_OfElement = Annotated[
    str | None,
    c.option(
        "Only changes of this element: a name, or PDDL such as '(robot_at rb1 wp1)'; of an object, "
        "of all that involves it.",
        "--element",
        metavar="NAME|PDDL",
    ),
]


def log(
    url: c.Url,
    kb: c.Name = None,
    limit: Annotated[int | None, c.most("Show only the N newest.")] = None,
    since: c.Since = None,
    until: c.Until = None,
    actor: _OfActor = None,
    element: _OfElement = None,
    as_json: Annotated[bool, c.json_lines("revision")] = False,
) -> None:
    """Show the revisions, newest first: when, who, why and what."""
    first, last = c.parse_range(since, until)
    with c.open_to_read(url, kb) as (name, knowledge_base):
        found = knowledge_base.log(
            since=first, until=last, actor=actor, element=element, limit=limit
        )
        count = write_each(found, as_json, write_entry, is_spaced=True)
        if not count and element is not None and not any(knowledge_base.log(element=element)):
            raise c.unknown_element(
                knowledge_base, name, element, "has never been there; see: kant-sql log"
            )


_ELEMENT = c.CommandWords("[URL] NAME|PDDL", "sqlite:///robot.db '(robot_at rb1 wp1)'")
_Words = Annotated[list[str], _ELEMENT.argument("a name, or PDDL such as '(robot_at rb1 wp1)'.")]


def history(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    as_json: Annotated[bool, c.json_lines("version")] = False,
) -> None:
    """Show when an element held, and the revisions at both ends.

    The oldest version comes first.
    """
    url, (element,) = _ELEMENT.split(words)
    with c.open_state(url, kb, at) as (name, state):
        versions = state.history(element)
        if not versions:
            what = (
                "has never been there; see: kant-sql log; for periods: kant-sql when --clock valid"
            )
            raise c.unknown_element(state, name, element, what)
        write_each(versions, as_json, _write_version, is_spaced=True)


def blame(words: _Words, kb: c.Name = None, at: c.At = None, as_json: c.AsJson = False) -> None:
    """Show who asserted a fact or another element, when and why."""
    url, (element,) = _ELEMENT.split(words)
    with c.open_state(url, kb, at) as (name, state):
        version = state.blame(element)
        if version is None:
            raise c.unknown_element(state, name, element, "does not hold; see: kant-sql history")
        if as_json:
            write_json(version)
        else:
            _write_version(Printer(), version)


def unconfirmed(
    url: c.Url,
    kb: c.Name = None,
    at: c.At = None,
    older_than: Annotated[float | None, c.seconds("Show only what is older than this.")] = None,
    contradicted: Annotated[
        bool,
        c.option(
            "Show those that another actor retracted before anyone had confirmed them.",
            "--contradicted",
        ),
    ] = False,
    as_json: Annotated[bool, c.json_lines("fact")] = False,
) -> None:
    """Show the effects of acts that no other actor has confirmed."""
    if contradicted and older_than is not None:
        raise typer.BadParameter("does not go with --contradicted", param_hint="--older-than")
    with c.open_state(url, kb, at) as (_, state):
        found = state.contradicted() if contradicted else state.unconfirmed(older_than=older_than)
        write_each(found, as_json, _write_version)


def corrections(
    url: c.Url,
    kb: c.Name = None,
    since: c.Since = None,
    until: c.Until = None,
    limit: Annotated[int | None, c.most("Show at most N corrections.")] = None,
    as_json: Annotated[bool, c.json_lines("correction")] = False,
) -> None:
    """Show sayings that differ from earlier beliefs."""
    first, last = c.parse_range(since, until)
    with c.open_state(url, kb, None) as (_, state):
        found = state.corrections(since=first, until=last, limit=limit)
        write_each(found, as_json, _write_correction)


def _write_correction(printer: Printer, one: Correction) -> None:
    period = f"{time_text(one.valid_from)} to {time_text(one.valid_until)}"
    printer.line(f"{period}  {one.text}")
    for verb, belief in (("believed", one.believed), ("said", one.said)):
        revision = belief.revision
        said = [] if revision is None else [f"  r{revision.number}", *revision.said()]
        who = " ".join(map(printable, said))
        printer.line(f"  {verb}: {belief.content}{who}")


_Depth = Annotated[int, c.option("Follow up to N links.", "--depth", metavar="N", min=1)]
_Most = Annotated[int, c.most("Show at most N links.")]
_LinkLines = Annotated[bool, c.json_lines("link")]


def consequences(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    depth: _Depth = 1,
    limit: _Most = 50,
    as_json: _LinkLines = False,
) -> None:
    """Show which acts, plans and derived facts used a fact."""
    url, (element,) = _ELEMENT.split(words)
    with c.open_state(url, kb, at) as (_, state):
        _write_links(state.consequences(element, depth=depth, limit=limit), as_json)


def origins(
    words: _Words,
    kb: c.Name = None,
    at: c.At = None,
    depth: _Depth = 10,
    limit: _Most = 100,
    as_json: _LinkLines = False,
) -> None:
    """Show the acts, observations and files behind a fact."""
    url, (element,) = _ELEMENT.split(words)
    with c.open_state(url, kb, at) as (_, state):
        _write_links(state.origins(element, depth=depth, limit=limit), as_json)


def _write_links(found: CauseLinks, as_json: bool) -> None:
    write_each(found, as_json, _write_link)
    if found.searched is not None and not as_json:
        Printer().line(f"searched back to revision {found.searched}")
    if found.has_more and not as_json:
        Printer().line("there are more; see --limit")


def _write_link(printer: Printer, link: CauseLink) -> None:
    indent = "  " * (link.depth - 1)
    what = " ".join(filter(None, (link.kind, link.id, printable(link.text))))
    printer.line(f"{indent}{what}", "bold")
    if link.revision is not None:
        said = ", ".join(map(printable, link.revision.said()))
        printer.line(f"{indent}  revision {link.revision.number}{': ' if said else ''}{said}")
    for name, texts in (("used", link.used), ("made", link.made)):
        if texts:
            printer.line(f"{indent}  {name}: {' '.join(map(printable, texts))}")


_DIFF = c.CommandWords("[URL] A[..B] [B]", "sqlite:///robot.db 12 '2 hours ago'")


def diff(
    words: Annotated[
        list[str],
        _DIFF.argument(
            "two moments, as A B or A..B, each a revision's number, a time in ISO 8601, or such as "
            "'yesterday'; a moment that is left out is now.",
        ),
    ],
    kb: c.Name = None,
    clock: c.Clock = "committed",
    as_json: c.AsJson = False,
) -> None:
    """Show elements that hold only at B (+) or only at A (-)."""
    url, (a, *rest) = _DIFF.split(words)
    a, dots, b = a.partition("..")
    if rest and dots:
        raise typer.BadParameter("give A B or A..B, not both", param_hint=_DIFF.usage)
    b = rest[0] if rest else b
    moments = c.parse_state(a or None, "A"), c.parse_state(b or None, "B")
    with c.open_to_read(url, kb) as (name, knowledge_base):
        head = knowledge_base.revision
        first, second = (head if moment is None else moment for moment in moments)
        changes = knowledge_base.diff(first, second, clock=clock)
        if as_json:
            ends = [knowledge_base.at(when).revision for when in (first, second)]
            write_json(knowledge_base=name, a=ends[0], b=ends[1], changes=changes)
        else:
            write_changes(Printer(), changes)


_RESTORE = c.CommandWords("[URL] REV|TIME", "sqlite:///robot.db 12")


def restore(
    words: Annotated[
        list[str],
        _RESTORE.argument("a revision's number, a time in ISO 8601, or such as '2 hours ago'."),
    ],
    kb: c.Name = None,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> None:
    """Restore a past state, as a new revision.

    Another restore undoes it.
    """
    url, (when,) = _RESTORE.split(words)
    moment = c.parse_state(when, "REV|TIME")
    with c.open_to_read(url, kb) as (name, knowledge_base):
        restored = knowledge_base.revision
        if moment is not None:
            restored = knowledge_base.at(moment).revision
        made = knowledge_base.restore(restored, reason=reason, actor=actor)
        changes = [] if made is None else knowledge_base.diff(made - 1, made)
        if as_json:
            write_json(knowledge_base=name, restored=restored, revision=made, changes=changes)
            return
        printer = Printer()
        if made is None:
            printer.line(f"knowledge base {name}: nothing is different from revision {restored}")
            return
        printer.line(
            f"knowledge base {name}, revision {made}: the state of revision {restored}", "bold"
        )
        write_changes(printer, changes)


_BRANCH = c.CommandWords("[URL] [NAME]", "sqlite:///robot.db monday")


def branch(
    words: Annotated[
        list[str] | None,
        _BRANCH.argument("the name of the branch; default with --url: the knowledge base's own."),
    ] = None,
    kb: c.Name = None,
    at: c.At = None,
    target: Annotated[
        str | None,
        c.option(
            "The store of the branch; default: the same. A missing SQLite file is created.",
            "--url",
            metavar="URL",
        ),
    ] = None,
    actor: c.Actor = None,
    as_json: c.AsJson = False,
) -> None:
    """Create a knowledge base from a state of another."""
    url, names = _BRANCH.split(words)
    if not names and target is None:
        raise typer.BadParameter("give a name, --url or both", param_hint="NAME")
    moment = c.parse_state(at)
    with (
        c.open_to_read(url, kb, actor) as (name, knowledge_base),
        nullcontext() if target is None else c.leaving_nothing(target),
        knowledge_base.branch(*names, at=moment, url=target) as made,
    ):
        branched = names[0] if names else name
        (first,) = made.store.revisions(limit=1) or (None,)
    source = None if first is None else first.source
    if as_json:
        number = None if first is None else first.number
        write_json(knowledge_base=branched, revision=number, source=source)
    elif first is None:
        Printer().line(f"knowledge base {branched}: nothing was there to begin with")
    else:
        Printer().line(f"knowledge base {branched}, revision {first.number}: {first.reason}")


_GONE = ConnectionLostError, StoreUnreachableError


def watch(
    url: c.Url,
    kb: c.Name = None,
    after: Annotated[
        int | None,
        c.option(
            "Begin with the revision after this one; default: with the next one.",
            metavar="REV",
            min=0,
        ),
    ] = None,
    timeout: Annotated[float | None, c.seconds("Stop after so long; default: at Ctrl-C.")] = None,
    as_json: Annotated[bool, c.json_lines("revision")] = False,
) -> None:
    """Show new revisions: who, when, why, what."""
    deadline = math.inf if timeout is None else time.monotonic() + timeout
    with c.open_to_read(url, kb) as (_, knowledge_base):
        seen = knowledge_base.revision if after is None else after
        news = _news(knowledge_base, seen, deadline)
        write_each(news, as_json, write_entry, is_spaced=True)


def _news(kb: KnowledgeBase, seen: int, deadline: float) -> Iterator[LogEntry]:
    """Yield new revisions until the deadline; an unreachable server may come back."""
    from ..history.follow import watch_until
    from ..knowledge_base import state_of

    is_over = False
    while not is_over:
        with suppress(*_GONE):
            for entry in kb.changes(seen):
                yield entry
                # The reader of a pipe gets each revision at once.
                sys.stdout.flush()
                seen = entry.revision.number
        left = max(deadline - time.monotonic(), 0.0)
        is_over = watch_until(state_of(kb), seen, left, _is_unread) is None


def _is_unread() -> bool:
    """Return whether standard output is a pipe that has no reader any more."""
    if not hasattr(select, "poll"):
        return False
    poll = select.poll()
    try:
        poll.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):
        return False
    return any(event & select.POLLERR for _, event in poll.poll(0))
