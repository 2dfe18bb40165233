"""The report of an incident: one file that opens from disk, without a network or a server."""

from __future__ import annotations

import base64
import errno
import os
import secrets
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from markupsafe import Markup

from ..arguments import expect, flag, items, optional_call
from ..dao.interfaces import Progress
from ..errors import (
    AnchorError,
    ArchivedError,
    InvalidArgumentError,
    KantSqlError,
    PddlError,
    SourceError,
    UnknownNameError,
    UnknownRevisionError,
)
from ..history.anchors import Anchor
from ..history.drawing import draw
from ..history.moments import is_valid_clock
from ..json_values import json_value
from ..knowledge.sayings import COMMITTED
from ..knowledge_base import KnowledgeBase
from ..moment_text import When
from ..reasoning.rules import Rules
from .cause_graph import draw_causes
from .rendering import STATIC, render_text
from .report_sections import ReportEntry, ReportPlan, ReportReader, ReportRows, ReportStays

__all__ = ["report_html", "write_report"]

T = TypeVar("T")

# The caller's errors are refused; errors of the store are reported.
_WRONG = (AnchorError, InvalidArgumentError, UnknownNameError, UnknownRevisionError)


def report_html(
    kb: KnowledgeBase,
    *,
    since: When | None = None,
    until: When | None = None,
    objects: Iterable[str] = (),
    facts: Iterable[str] = (),
    rules: Rules | None = None,
    verify: bool = True,
    anchor: Anchor | None = None,
    progress: Progress | None = None,
    clock: str = COMMITTED,
) -> str:
    """Write the report of a range of revisions.

    Args:
        kb: the knowledge base.
        since: the first revision, or the earliest time of commit; both inclusive.
        until: the last revision, or the latest time of commit; both inclusive.
        objects: the names of objects; the report has all that involved each.
        facts: facts and fluents; the report has the consequences and origins of each.
        rules: constraints and preferences, as for `kb.pddl.check_rules`; None for those of
            the domain and the problem, and the kept rules, each since it was saved.
        verify: whether to verify the whole history.
        anchor: an anchor that you kept elsewhere, to verify the history.
        progress: called during the verification, as by `kb.store.verify`.
        clock: `committed`, or `valid` for timelines on valid time, as known now. All other sections
            use revisions.

    Returns:
        A self-contained HTML page.

    Raises:
        UnknownRevisionError: `since` or `until` lies in the future, or is a time without zone.
        UnknownNameError: there has never been an object of that name.
        PddlError, SourceError: `rules` are not well-formed, or cannot be read.
        InvalidArgumentError: an argument is not of its type, or there is no such clock.

    Examples:
        >>> from kant_sql.web.report import report_html
        >>> "verified" in report_html(kb, objects=["rb1"], verify=False)
        True
    """
    expect(kb, KnowledgeBase, "the knowledge base", InvalidArgumentError)
    flag(verify, "verify", InvalidArgumentError)
    optional_call(progress, "progress")
    names = items(objects, str, "the objects")
    report = ReportReader.of(kb, since, until, clock)
    read = Sections(_WRONG if rules is None else (*_WRONG, PddlError, SourceError))
    # First: refuse an unknown name before the slow work.
    involved = {
        name: read(f"object {name}", partial(_object, report, name))
        for name in dict.fromkeys(names)
    }
    causes = {
        text: read(f"fact {text}", partial(report.causes, text))
        for text in dict.fromkeys(items(facts, str, "the facts"))
    }
    is_valid = is_valid_clock(clock)
    has_parts = is_valid or not report.is_empty
    page: dict[str, Any] = {
        "summary": report.summary(),
        "objects": involved if has_parts else {},
        "facts": {} if report.is_empty else causes,
        "is_verified": verify,
        "is_valid": is_valid,
        "verify_command": report.command("verify"),
    }
    if has_parts:
        page |= _happened(report, read, rules)
    if verify:
        page["verification"] = read("verification", lambda: report.verify(anchor, progress))
    page["anchor"] = read("anchor", report.anchor)
    return _render({**page, "errors": read.errors}, kb.store.factory.name)


def _happened(report: ReportReader, read: Sections, rules: Rules | None) -> dict[str, Any]:
    """Read the sections of a range; without revisions, only those on valid time."""
    page: dict[str, Any] = dict.fromkeys(("timeline", "drawing", "corrections"))
    timeline = read("timeline", report.timeline)
    if timeline is not None:
        page["timeline"] = report.stays(timeline)
        page["drawing"] = draw(timeline.timeline)
        page["corrections"] = read("corrections", partial(report.corrections, timeline))
    if report.is_empty:
        return page
    page["plans"] = timeline and read("plans", partial(report.plans, timeline))
    page["acts"] = read("acts", report.acts)
    page["rules"] = read("rules", lambda: report.rules(rules))
    page["goals"] = read("goals", report.goals)
    page["effects"] = read("effects", report.effects)
    page["log"] = read("log", report.log)
    return page


def _object(report: ReportReader, name: str) -> ReportStays:
    return report.stays(report.timeline(name), name)


class Sections:
    """Reads sections; a section that cannot be read says why, and the others are complete."""

    def __init__(self, refused: tuple[type[KantSqlError], ...]) -> None:
        self.errors: dict[str, str] = {}  # why, by the names of the sections
        self._refused = refused

    def __call__(self, name: str, read: Callable[[], T]) -> T | None:
        try:
            return read()
        except KantSqlError as error:
            if isinstance(error, self._refused) and not isinstance(error, ArchivedError):
                raise
            self.errors[name] = str(error)
            return None


def _render(page: Mapping[str, Any], name: str) -> str:
    """Write the self-contained page."""
    log: ReportRows[ReportEntry] | None = page.get("log")
    plans: ReportRows[ReportPlan] | None = page.get("plans")
    listed = {
        "/revision": {str(each.entry.revision.number) for each in log.rows} if log else set(),
        "/plan": {str(each.plan.id) for each in plans.rows} if plans else set(),
    }

    def link(path: str, /, **query: object) -> str:
        """Return the anchor of a target in this page; nothing if it is not in it."""
        place = str(query.get("number", query.get("id")))
        return f"#{path[1:]}-{place}" if place in listed.get(path, ()) else ""

    graphs = {
        text: "" if found is None else draw_causes(found.origins, found.consequences, link)
        for text, found in page["facts"].items()
    }
    style = _static("style.css") + _static("report.css")
    alone = f"style-src {_digest(style)}; base-uri 'none'; form-action 'none'"
    return render_text(
        "report.html",
        {
            "page": json_value({**page, "graphs": graphs}),
            "kb": name,
            "link": link,
            "policy": f"default-src 'none'; {alone}",
            "style": Markup(style),
        },
    )


@cache
def _static(name: str) -> str:
    return (STATIC / name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """Return what a policy calls a style sheet."""
    return f"'sha256-{base64.b64encode(sha256(text.encode()).digest()).decode()}'"


def write_report(
    kb: KnowledgeBase,
    path: str | os.PathLike[str],
    *,
    since: When | None = None,
    until: When | None = None,
    objects: Iterable[str] = (),
    facts: Iterable[str] = (),
    rules: Rules | None = None,
    verify: bool = True,
    anchor: Anchor | None = None,
    progress: Progress | None = None,
    clock: str = COMMITTED,
) -> Path:
    """Write the report of a range of revisions to a file, atomically.

    Args:
        kb: the knowledge base.
        path: the file; an existing one is replaced.
        since: as for `report_html`.
        until: as for `report_html`.
        objects: as for `report_html`.
        facts: as for `report_html`.
        rules: as for `report_html`.
        verify: as for `report_html`.
        anchor: as for `report_html`.
        progress: as for `report_html`.
        clock: as for `report_html`.

    Returns:
        The path.

    Raises:
        OSError: the file cannot be written; `IsADirectoryError` if the path is a folder's.
        KantSqlError: as `report_html`.

    Examples:
        >>> from kant_sql.web.report import write_report
        >>> print(write_report(kb, "day.html", until=1))
        day.html
    """
    expect(path, (str, os.PathLike), "the path", InvalidArgumentError)
    target = Path(path)
    with replacing(target) as draft:
        made = report_html(
            kb,
            since=since,
            until=until,
            objects=objects,
            facts=facts,
            rules=rules,
            verify=verify,
            anchor=anchor,
            progress=progress,
            clock=clock,
        )
        draft.write_text(made, encoding="utf-8")
    return target


@contextmanager
def replacing(target: Path) -> Iterator[Path]:
    """Yield a new file beside another one, which it replaces at the end of the block."""
    # Made at once: an unwritable folder fails before the work.
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    draft = target.with_name(f".{target.name[:200]}.{secrets.token_hex(4)}")
    try:
        draft.open("x").close()
    except OSError as error:
        # The name that the caller knows.
        raise OSError(error.errno, error.strerror, str(target)) from error
    try:
        yield draft
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)
