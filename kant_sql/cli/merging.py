"""`kant-sql merge`: merges the changes of a branch."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import printable
from . import common as c
from .history import write_changes
from .output import Printer, plural, write_json

if TYPE_CHECKING:
    from ..history.merged import Decision, Merge

_WORDS = c.CommandWords("[URL] [BRANCH]", "sqlite:///robot.db trial")


def merge(
    words: Annotated[
        list[str] | None,
        _WORDS.argument("the name of the branch; default with --url: the knowledge base's own."),
    ] = None,
    kb: c.Name = None,
    target: Annotated[
        str | None, c.option("The store of the branch; default: the same.", "--url", metavar="URL")
    ] = None,
    at: c.At = None,
    ours: Annotated[
        list[str] | None,
        c.option("Keep this side of this conflict; repeatable.", metavar="ELEMENT"),
    ] = None,
    theirs: Annotated[
        list[str] | None,
        c.option("Take the branch's side of this conflict; repeatable.", metavar="ELEMENT"),
    ] = None,
    yes: Annotated[bool, c.option("Merge; without it, this is a dry run.", "--yes")] = False,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> int:
    """Merge the changes of a branch, as one revision.

    Without --yes it writes nothing: it lists the changes, and the conflicts, with who, when and why
    on both sides. Exits with 1 if a merge would be refused. --at is a state of the branch.
    """
    url, names = _WORDS.split(words)
    if not names and target is None:
        raise typer.BadParameter("give a name, --url or both", param_hint="BRANCH")
    both = sorted({*(ours or ())} & {*(theirs or ())})
    if both:
        raise typer.BadParameter(f"{both[0]!r} is given twice", param_hint="--ours, --theirs")
    decide: dict[str, Decision] = dict.fromkeys(ours or (), "ours")
    decide |= dict.fromkeys(theirs or (), "theirs")
    with (
        c.open_to_read(url, kb, actor) as (name, knowledge_base),
        c.open_state(target or url, names[0] if names else name, at) as (_, branch),
    ):
        if yes:
            made = knowledge_base.merge(branch, decide=decide, reason=reason)
        else:
            made = knowledge_base.merge_preview(branch, decide=decide)
    if as_json:
        write_json(knowledge_base=name, **vars(made))
    else:
        _write(made, name, yes)
    return 1 if made.undecided or made.refused is not None else 0


def _write(made: Merge, name: str, is_done: bool) -> None:
    printer = Printer()
    of = f"{made.branch} at revision {made.branch_revision}"
    if made.revision is not None:
        printer.line(f"knowledge base {name}, revision {made.revision}: merged {of}", "bold")
    elif not made.changes and not made.conflicts:
        printer.line(f"knowledge base {name}: nothing is new in {of} since revision {made.base}")
    else:
        printer.line(
            f"knowledge base {name}: {plural(len(made.changes), 'change')} of {of} since "
            f"revision {made.base}",
            "bold",
        )
    write_changes(printer, made.changes)
    for each in made.conflicts:
        printer.line(
            f"conflict: {each.element}{'' if each.decided is None else f': {each.decided}'}"
        )
        printer.line(f"  ours: {printable(str(each.ours))}")
        printer.line(f"  theirs: {printable(str(each.theirs))}")
    if made.refused is not None:
        printer.line(f"refused: {made.refused}")
    if not is_done and (made.changes or made.conflicts):
        decide = ", and --ours or --theirs for each conflict" if made.undecided else ""
        add = f"; add --yes{decide}" if made.refused is None else ""
        printer.line(f"Nothing was changed{add}.")
