"""`kant-sql dump`: the domain and the problem as PDDL, now or at a moment of the past."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from .output import AsJson, is_terminal, printable_lines, write_json
from .stores import Name, Url, open_state
from .times import At


def dump(
    url: Url,
    kb: Name = None,
    at: At = None,
    domain: Annotated[bool, typer.Option("--domain", help="Only the domain.")] = False,
    problem: Annotated[bool, typer.Option("--problem", help="Only the problem.")] = False,
    as_json: AsJson = False,
) -> None:
    """Write the domain and then the problem as PDDL.

    'kant-sql load' reads both from one file.
    """
    with open_state(url, kb, at) as (name, state):
        texts = {"domain": state.domain_pddl()} if domain or not problem else {}
        if problem or not domain:
            texts["problem"] = state.problem_pddl()
        revision = state.revision
    if as_json:
        nothing = {"domain": None, "problem": None}
        write_json({"knowledge_base": name, "revision": revision, **nothing, **texts})
        return
    text = "\n".join(texts.values())
    if is_terminal():
        text = printable_lines(text)
    # In UTF-8, whatever the terminal's encoding: that is what planners read.
    sys.stdout.buffer.write(text.encode())
