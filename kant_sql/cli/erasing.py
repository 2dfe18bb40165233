"""`kant-sql erase` and `retention`: destroy names and texts."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import UnknownNameError, printable
from ..knowledge.canonical import SAID
from . import common as c
from .output import Printer, complain, plural, write_json

if TYPE_CHECKING:
    from .. import KnowledgeBase
    from ..history.erasure.preview import ErasurePreview
    from ..history.erasure.retention import RetentionRule

Archive = Annotated[
    str | None,
    c.option("The archive with a part of the history, to erase there, too.", metavar="URL"),
]
_PARTS = "reason,source"
Parts = Annotated[
    str | None,
    c.option(
        f"What to erase: {', '.join(SAID)}, separated by commas; default: {_PARTS}.",
        metavar="PARTS",
    ),
]
_ERASE = c.CommandWords("[URL] [OBJECT]", "sqlite:///robot.db maria")


def erase(
    words: Annotated[
        list[str] | None,
        _ERASE.argument("the name of an object, unless --revision is given."),
    ] = None,
    revision: Annotated[
        list[int] | None,
        c.option("Erase only --parts of this revision; repeatable.", metavar="NUMBER"),
    ] = None,
    parts: Parts = None,
    kb: c.Name = None,
    actor: c.Actor = None,
    reason: c.Reason = None,
    also: Annotated[
        list[str] | None,
        c.option(
            f"Also erase these parts of revisions with the name: {', '.join(SAID)}; use commas.",
            metavar="PARTS",
        ),
    ] = None,
    form_1: Annotated[
        bool,
        c.option(
            "Also erase in revisions of form 1 of the hash, from which the name can be guessed.",
            "--form-1",
        ),
    ] = False,
    archive: Archive = None,
    yes: Annotated[bool, c.option("Erase; without it, this is a dry run.", "--yes")] = False,
    dry_run: Annotated[
        bool, c.option("Change nothing, whatever else is given.", "--dry-run")
    ] = False,
    as_json: c.AsJson = False,
) -> int:
    """Erase the name of an object, or texts of single revisions.

    Without --yes it changes nothing: it counts the texts to erase, and lists others that may name
    the same person. Exits with 1 if bytes of the name may remain in the database.
    """
    url, objects = _ERASE.split(words)
    if bool(objects) == bool(revision):
        raise typer.BadParameter("give an object, or --revision", param_hint=_ERASE.usage)
    _goes_with(revision, "--revision; of an object, --also", "--parts", parts)
    _goes_with(objects, "an object; of revisions, --parts", "--also", also or None)
    chosen = _PARTS if parts is None else parts
    element, said = next(iter(objects), None), chosen.split(",") if revision else []
    with c.open_to_read(url, kb) as (name, knowledge_base):
        if dry_run or not yes:
            if element is None:
                _write_said(name, knowledge_base, revision or [], said, as_json)
            else:
                _write_preview(
                    knowledge_base.erasure_preview(element, archive=archive), name, as_json
                )
            if not as_json:
                wanted = ("--reason", reason), ("--yes", yes)
                lacking = " and ".join(option for option, given in wanted if not given)
                Printer().line(f"Nothing was changed{lacking and '; add '}{lacking}.")
            return 0
        if reason is None:
            raise typer.BadParameter("say why, without the name", param_hint="--reason")
        done = knowledge_base.erase(
            element,
            reason=reason,
            actor=actor,
            also=[part for each in also or () for part in each.split(",")],
            revisions=revision or (),
            parts=said,
            form_1=form_1,
            archive=archive,
        )
        if as_json:
            write_json(knowledge_base=name, **done._asdict())
        elif done.revision is None:
            Printer().line(f"knowledge base {name}: there is nothing to erase")
        else:
            texts, of = plural(done.parts, "text"), plural(done.revisions, "revision")
            now = "they are" if element is None else "the object is"
            line = f"knowledge base {name}, revision {done.revision}: erased {texts} of {of}; "
            Printer().line(f"{line}{now} called {done.pseudonym}", "bold")
        for remaining in done.remaining:
            complain(f"bytes of it may remain in {remaining}")
        return 1 if done.remaining else 0


def _goes_with(other: object, what: str, option: str, given: str | list[str] | None) -> None:
    """Refuse an option that would be ignored."""
    if given is not None and not other:
        raise typer.BadParameter(f"needs {what}", param_hint=option)


def _write_preview(found: ErasurePreview, name: str, as_json: bool) -> None:
    if as_json:
        write_json(knowledge_base=name, **found._asdict())
        return
    printer = Printer()
    texts, of = plural(found.parts, "text"), plural(found.revisions, "revision")
    printer.line(f"knowledge base {name}: this would erase {texts} of {of}", "bold")
    printer.line(f"the object would be called {found.pseudonym}")
    if found.form_1:
        several = plural(found.form_1, "revision")
        printer.line(f"{several} of form 1: the name can be guessed from a hash; add --form-1")
    for mention in found.mentions:
        at = "" if mention.revision is None else f" of revision {mention.revision}"
        printer.line(f"stays: {mention.place}{at}: {' '.join(mention.text.split()):.200}")
    for other in found.similar:
        printer.line(f"similar: {other}")


def _write_said(
    name: str, kb: KnowledgeBase, numbers: list[int], parts: list[str], as_json: bool
) -> None:
    """Show the texts of revisions that would be erased."""
    from ..history.erasure.erase import make_wanted
    from ..history.revisions import refuse_unknown

    found = []
    for number, labels in make_wanted(None, (), numbers, parts).said.items():
        refuse_unknown(name, number, kb.revision)
        (own,) = kb.store.revisions(number - 1, limit=1)
        found += [{"revision": number, "part": each, "text": getattr(own, each)} for each in labels]
    if as_json:
        write_json(knowledge_base=name, said=found)
        return
    for one in found:
        of = "would erase: {part} of revision {revision}: {text}".format(**one)
        Printer().line(printable(of))


def retention(
    url: c.Url,
    after: Annotated[
        str | None,
        c.option("Erase in revisions older than this, such as 30d, 12h or 90m.", metavar="AGE"),
    ] = None,
    parts: Parts = None,
    of_actor: Annotated[
        str | None, c.option("Only in revisions of this actor.", "--of", metavar="ACTOR")
    ] = None,
    rules: Annotated[
        str | None,
        c.option(
            "A file with a rule per line, such as 'camera 30d reason,source'; * is any actor.",
            metavar="FILE",
        ),
    ] = None,
    every: Annotated[
        float | None,
        c.option("Keep running, with a run every N seconds.", metavar="SECONDS", min=1),
    ] = None,
    archive: Archive = None,
    kb: c.Name = None,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> int:
    """Erase actors, reasons or sources of old revisions.

    Each run makes one revision, or none if nothing is old enough.
    """
    if after is None and rules is None:
        raise typer.BadParameter("give an age, or a file with --rules", param_hint="--after")
    for option, given in (("--of", of_actor), ("--parts", parts)):
        _goes_with(after, "--after; --rules has its own", option, given)
    from ..history.erasure.retention import read_rules

    of = "*" if of_actor is None else f'"{of_actor}"'
    lines = [] if after is None else [f"{of} {after} {_PARTS if parts is None else parts}"]
    if rules is not None:
        # Bytes that are not text are refused as a rule. Editors may begin a file with a mark.
        with open(rules, encoding="utf-8-sig", errors="surrogateescape") as file:
            lines += file.read().splitlines()
    wanted = read_rules(lines)
    if every is None:
        return _retain(url, kb, wanted, archive, actor, reason, as_json)
    stop = c.Stop()
    with stop.on_signals():
        while not stop.number:
            _retain(url, kb, wanted, archive, actor, reason, as_json)
            sys.stdout.flush()
            stop.wait(every)
    return stop.code


def _retain(
    url: str,
    kb: str | None,
    rules: list[RetentionRule],
    archive: str | None,
    actor: str | None,
    reason: str | None,
    as_json: bool,
) -> int:
    """Erase once, by rules."""
    from ..dao.text import refuse_unknown_actor
    from ..knowledge_base import state_of

    with c.open_to_read(url, kb) as (name, knowledge_base):
        for named in sorted({rule.actor for rule in rules if rule.actor is not None}):
            # The actor may be misspelt, or have written nothing yet.
            try:
                refuse_unknown_actor(state_of(knowledge_base).store, named)
            except UnknownNameError as error:
                complain(str(error))
        done = knowledge_base.store.retain(rules, reason=reason, archive=archive, actor=actor)
    if as_json:
        write_json(knowledge_base=name, revision=done.revision, parts=done.parts)
    elif done.revision is None:
        Printer().line(f"knowledge base {name}: nothing is old enough")
    else:
        texts = plural(done.parts, "text")
        Printer().line(f"knowledge base {name}, revision {done.revision}: erased {texts}")
    for remaining in done.remaining:
        complain(f"bytes of it may remain in {remaining}")
    return 1 if done.remaining else 0
