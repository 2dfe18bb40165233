"""`kant-sql serve` and `report`: the store in a browser, and a report as one file."""

from __future__ import annotations

import socket
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..errors import InvalidArgumentError, needing, printable
from ..pddl.lexer import read_file
from .asking import rules_source
from .common import AnchorFile, Clock, Name, Since, Until, Url, choose, option, parse_optional
from .documents import STANDARD_INPUT as STANDARD_OUTPUT
from .output import Printer, bar

if TYPE_CHECKING:
    from uvicorn import Config

WEB_MISSING = "this needs FastAPI, uvicorn and Jinja2; run: pip install 'kant-sql[web]'"


def listen(config: Config) -> tuple[socket.socket, str]:
    """Bind the socket of a server, so readers can already connect; return it with its address."""
    listening = config.bind_socket()
    # Connections inherit it; otherwise each answer on a kept connection waits 40 ms for the
    # reader's acknowledgement.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    listening.listen(config.backlog)
    address, number = listening.getsockname()[:2]
    name = f"[{address}]" if ":" in address else address
    return listening, f"http://{name}:{number}"


def serve(
    url: Url,
    host: Annotated[
        str,
        option(
            "The address to listen at; any other than this machine's needs a token.",
            metavar="ADDRESS",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, option("The port; 0 for a free one.", metavar="NUMBER", min=0, max=65535)
    ] = 8765,
    allow_host: Annotated[
        list[str] | None,
        option(
            "Another host name that the server answers to; you can repeat this.",
            metavar="NAME",
        ),
    ] = None,
    write: Annotated[
        bool, option("Programs may write over HTTP, with a token of --tokens.", "--write")
    ] = False,
    tokens: Annotated[
        Path | None,
        option("The file of 'kant-sql tokens', read again when it changes.", metavar="FILE"),
    ] = None,
) -> None:
    """Show the store in a browser, and its data as JSON.

    All pages are read-only; with --write, programs write by POST below /api, with a token of the
    file. Ctrl-C ends it. At an address that other machines can reach, readers need the printed
    token, or the one in KANT_SQL_TOKEN.
    """
    with needing(WEB_MISSING):
        from ..web.application import make_server
    from ..web.tokens import TokenFile

    if write != (tokens is not None):
        lacked = "--tokens FILE, of 'kant-sql tokens add'" if write else "--write"
        raise InvalidArgumentError(f"to write over HTTP needs {lacked}, too")
    known = None if tokens is None else TokenFile(tokens)
    server, token = make_server(url, host=host, port=port, hosts=allow_host or (), tokens=known)
    listening, address = listen(server.config)
    sys.stdout.write(f"{address}/\n")
    if token is not None:
        sys.stdout.write(f"token: {printable(token)}\n")
    sys.stdout.flush()
    server.run(sockets=[listening])


def report(
    url: Url,
    out: Annotated[Path, option("The file to write (- is standard output).", metavar="FILE")],
    kb: Name = None,
    since: Since = None,
    until: Until = None,
    clock: Clock = "committed",
    object: Annotated[
        list[str] | None,
        option("Report everything that involved this object; you can repeat this.", metavar="NAME"),
    ] = None,
    fact: Annotated[
        list[str] | None,
        option(
            "Report the consequences and origins of this fact; you can repeat this.",
            metavar="PDDL",
        ),
    ] = None,
    rules: Annotated[
        str | None,
        option(
            "Judge the range by these rules: a file of constraints (- is standard input), or "
            "PDDL; default: those of the domain, the problem, and the kept ones.",
            metavar="FILE|PDDL",
        ),
    ] = None,
    anchor: AnchorFile = None,
    no_verify: Annotated[
        bool, option("Skip the verification, which reads the whole history.", "--no-verify")
    ] = False,
) -> None:
    """Write the report of an incident as one file.

    Open it in a browser, without a network, or print it: a summary, a timeline, plans and outcomes,
    rules and violations, goals not reached, the log with reasons, and the verdict of verification
    with an anchor. Exits with 0 if it is written, even if it shows violations.
    """
    with needing(WEB_MISSING):
        from ..web.report import report_html, write_report
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
            facts=fact or (),
            rules=None if rules is None else rules_source(rules),
            verify=not no_verify,
            anchor=anchored,
            progress=progress,
            clock=clock,
        )
        made = write()
    if isinstance(made, Path):
        Printer().line(f"{made}")
    else:
        sys.stdout.write(made)
