"""`kant-sql report`: what happened, as one file to hand over."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import Annotated

from ..errors import ExtraMissingError
from ..pddl.lexer import read_file
from .asking import rules_source
from .check import STANDARD_INPUT as STANDARD_OUTPUT
from .common import AnchorFile, Name, Since, Until, Url, choose, option, parse_optional
from .output import Printer, bar
from .serve import WEB_MISSING


def report(
    url: Url,
    out: Annotated[
        Path,
        option("The file to write (- is standard output).", "--out", metavar="FILE"),
    ],
    kb: Name = None,
    since: Since = None,
    until: Until = None,
    object: Annotated[
        list[str] | None,
        option(
            "Report what involved this object; you can repeat this.", "--object", metavar="NAME"
        ),
    ] = None,
    rules: Annotated[
        str | None,
        option(
            "Judge the range by these rules: a file of constraints (- is standard input), or "
            "PDDL; default: those of the domain and the problem.",
            "--rules",
            metavar="FILE|PDDL",
        ),
    ] = None,
    anchor: AnchorFile = None,
    no_verify: Annotated[
        bool, option("Skip the verification, which reads the whole history.", "--no-verify")
    ] = False,
) -> None:
    """Write what happened as one file: the report of an incident.

    It opens in a browser from disk, without a network, and can be printed: a summary, a timeline,
    plans and outcomes, rules and violations, goals not reached, the log with reasons, and the
    verdict of verification with an anchor. Exits with 0 when it is written, whatever it says.
    """
    try:
        from ..web.report import report_html, write_report
    except ImportError as error:
        raise ExtraMissingError(WEB_MISSING) from error
    from ..history.anchors import parse_anchor
    from ..knowledge_base import connect
    from ..sql.catalog import written_names

    earliest, latest = parse_optional(since, "--since"), parse_optional(until, "--until")
    anchored = None if anchor is None else parse_anchor(read_file(anchor))
    name = choose(kb, written_names(url))
    with (
        connect(url, knowledge_base=name, read_only=True) as knowledge_base,
        bar(name) as progress,
    ):
        write = partial(
            report_html if str(out) == STANDARD_OUTPUT else partial(write_report, path=out),
            knowledge_base,
            since=earliest,
            until=latest,
            objects=object or (),
            rules=None if rules is None else rules_source(rules),
            verify=not no_verify,
            anchor=anchored,
            progress=progress,
        )
        made = write()
    if isinstance(made, Path):
        Printer().line(f"{made}")
    else:
        sys.stdout.write(made)
