"""`kant-sql dump`: the domain and the problem as PDDL, now or at a moment of the past."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from .output import printable_lines
from .stores import Name, Url, open_state
from .times import At


def dump(
    url: Url,
    kb: Name = None,
    at: At = None,
    domain: Annotated[bool, typer.Option("--domain", help="Only the domain.")] = False,
    problem: Annotated[bool, typer.Option("--problem", help="Only the problem.")] = False,
) -> None:
    """Write the domain and then the problem as PDDL.

    'kant-sql load' reads both from one file.
    """
    with open_state(url, kb, at) as (_, state):
        texts = [state.domain_pddl()] if domain or not problem else []
        texts += [state.problem_pddl()] if problem or not domain else []
    text = "\n".join(texts)
    if sys.stdout.isatty():
        text = printable_lines(text)
    # In UTF-8, whatever the terminal's encoding: that is what planners read.
    sys.stdout.buffer.write(text.encode())
