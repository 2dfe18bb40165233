"""`kant-sql verify`: whether the history is what was written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..catalog import every_name
from ..errors import InvalidMetadataError
from ..history.anchors import Anchor, parse_anchor
from ..history.verifying import Finding, Verification
from ..knowledge_base import connect
from .errors import FAILED
from .output import Printer, printable, write_json
from .progress import bar
from .stores import Name, Url, choose


def verify(
    url: Url,
    kb: Name = None,
    verify_all: Annotated[bool, typer.Option("--all", help="All knowledge bases.")] = False,
    anchor: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            show_default=False,
            exists=True,
            dir_okay=False,
            readable=True,
            help="What 'kant-sql anchor' wrote: it tells what was cut off or rewritten since.",
        ),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="JSON Lines: one document for each knowledge base.")
    ] = False,
) -> int:
    """Tell whether the history is what was written.

    Recomputes every hash from the tables, and compares what they say twice, indexes with their
    tables, and the structure with what the migrations make. Writes what is wrong, the first
    revision first. Ends with 0 when nothing is, and else with 1.
    """
    if kb is not None and verify_all:
        raise typer.BadParameter("give --kb or --all, not both", param_hint="--all")
    anchored = None if anchor is None else parse_anchor(anchor.read_bytes())
    printer, is_intact = Printer(), True
    for number, name in enumerate(_chosen(url, kb, verify_all, anchored)):
        # What all knowledge bases have in common is checked once.
        verification = _verify(url, name, anchored, structure=number == 0)
        is_intact &= verification.is_intact
        if as_json:
            write_json(_document(verification))
        else:
            _write(printer, verification, anchored is not None)
    return 0 if is_intact else FAILED


def _verify(url: str, name: str, anchor: Anchor | None, structure: bool) -> Verification:
    try:
        with connect(url, knowledge_base=name) as knowledge_base, bar(name) as told:
            return knowledge_base.verify(anchor, progress=told, structure=structure)
    except InvalidMetadataError as error:
        # The library gives none such a name; the others are verified nevertheless.
        return Verification(name, 0, 0, (Finding(None, "knowledge_base", str(error)),))


def _chosen(url: str, name: str | None, verify_all: bool, anchor: Anchor | None) -> list[str]:
    """Choose knowledge bases: what is anchored and gone is among them."""
    names = every_name(url)
    heads = () if anchor is None else anchor.heads
    gone = [head.knowledge_base for head in heads if head.knowledge_base not in names]
    if verify_all:
        return [*names, *gone]
    if gone and (name in gone or (name is None and not names)):
        return gone
    return [choose(name, names), *gone]


def _write(printer: Printer, verification: Verification, has_anchor: bool) -> None:
    name = printable(verification.knowledge_base)
    counts = f"{verification.revisions} revisions, {verification.changes} changes"
    for finding in verification.findings:
        printer.line(f"{name}: {printable(_words(finding))}", "red")
    if verification.is_intact:
        printer.line(f"{name}: intact ({counts})", "green")
    else:
        count = len(verification.findings)
        findings = "1 finding" if count == 1 else f"{count} findings"
        printer.line(f"{name}: {findings} ({counts})", "bold red")
    for archive in verification.archives:
        printer.line(f"{name}: {printable(archive)}")
    if has_anchor and verification.anchored is None:
        printer.line(f"{name}: the anchor says nothing of it", "yellow")


def _words(finding: Finding) -> str:
    place = "" if finding.revision is None else f"revision {finding.revision}: "
    table = "" if finding.table is None else f"{finding.table}: "
    return f"{place}{table}{finding.message}"


def _document(verification: Verification) -> dict[str, object]:
    return {
        **verification._asdict(),
        "is_intact": verification.is_intact,
        "findings": [finding._asdict() for finding in verification.findings],
        "archives": list(verification.archives),
    }
