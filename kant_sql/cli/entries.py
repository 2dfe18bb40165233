"""How revisions, changes and versions are written."""

from __future__ import annotations

from collections.abc import Iterable

from ..canonical import time_text
from ..history import LogEntry, Revision, Version
from ..knowledge.changes import Change
from .output import Printer, json_text, printable

_STYLES = {"+": "green", "-": "red"}


def revision_document(revision: Revision) -> dict[str, object]:
    """Give a revision in the form that becomes JSON.

    Args:
        revision: the revision.

    Returns:
        The document.
    """
    seen, step = revision.observed_at, revision.plan_step
    return {
        "number": revision.number,
        "committed_at": time_text(revision.committed_at),
        "observed_at": None if seen is None else time_text(seen),
        "actor": revision.actor,
        "reason": revision.reason,
        "source": revision.source,
        "plan_step": None if step is None else {"plan": step[0], "position": step[1]},
        "hash": revision.hash,
    }


def entry_document(entry: LogEntry) -> dict[str, object]:
    """Give a revision with its changes in the form that becomes JSON.

    Args:
        entry: the revision and its changes.

    Returns:
        The document.
    """
    changes = [change._asdict() for change in entry.changes]
    return {**revision_document(entry.revision), "changes": changes}


def version_document(version: Version) -> dict[str, object]:
    """Give a version in the form that becomes JSON.

    Args:
        version: the version.

    Returns:
        The document.
    """
    until = version.until
    return {
        "kind": version.kind,
        "text": version.text,
        "since": revision_document(version.since),
        "until": None if until is None else revision_document(until),
    }


def write_entry(printer: Printer, entry: LogEntry) -> None:
    """Write a revision for people.

    Args:
        printer: where to.
        entry: the revision and its changes.
    """
    revision = entry.revision
    printer.line(f"revision {revision.number}  {time_text(revision.committed_at)}", "bold")
    for line in _said(revision):
        printer.line(f"  {line}")
    write_changes(printer, entry.changes, "  ")


def write_changes(printer: Printer, changes: Iterable[Change], indent: str = "") -> None:
    """Write changes, a line for each, or more for a text of several lines.

    Args:
        printer: where to.
        changes: the changes.
        indent: what comes before each line.
    """
    for sign, kind, text in changes:
        printer.line(f"{indent}{sign} {kind} {_indented(text, indent)}", _STYLES[sign])


def write_version(printer: Printer, version: Version) -> None:
    """Write a version for people: what held, and which revisions asserted and retracted it.

    Args:
        printer: where to.
        version: the version.
    """
    printer.line(f"{version.kind} {_indented(version.text, '')}", "bold")
    ends = [("asserted", version.since, "+"), ("retracted", version.until, "-")]
    for what, revision, sign in ends:
        if revision is None:
            printer.line("  holds now")
            continue
        moment = time_text(revision.committed_at)
        printer.line(f"  {what} in revision {revision.number}  {moment}", _STYLES[sign])
        for line in _said(revision):
            printer.line(f"    {line}")


def _indented(text: str, indent: str) -> str:
    return text.replace("\n", f"\n{indent}  ")


def _said(revision: Revision) -> Iterable[str]:
    """Give what a revision's writer said of it, a line for each."""
    for name, value in (("actor", revision.actor), ("reason", revision.reason)):
        if value is not None:
            yield f"{name}: {printable(value)}"
    if revision.source is not None:
        yield f"source: {json_text(revision.source)}"
    if revision.observed_at is not None:
        yield f"observed at: {time_text(revision.observed_at)}"
    if revision.plan_step is not None:
        yield "plan {} step {}".format(*revision.plan_step)
