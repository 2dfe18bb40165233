"""`kant-sql push` and `promote`: replicas in other stores."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated

import typer

from ..arguments import URL_VARIABLE
from ..errors import (
    AuthenticationError,
    InvalidUrlError,
    KantSqlError,
    ReadOnlyStoreError,
    SchemaError,
    printable,
)
from ..knowledge.canonical import time_text
from . import common as c
from .output import FAILED, Document, Printer, bar, complain, plural, write_json

if TYPE_CHECKING:
    from ..history.replication.push import Pushed
    from ..history.replication.service import PushEvent, PushService

# As in sysexits.h: a service manager decides by these whether to start it again.
REFUSED, TRY_AGAIN, NO_PERMISSION, WRONG_CONFIGURATION = 65, 75, 77, 78
# In seconds: the default, and a day.
_INTERVAL, _LONGEST_INTERVAL = 1.0, 86_400.0
# Other users of the machine can read arguments, and a password in them.
_TARGET_VARIABLE = "KANT_SQL_TARGET"
_PLAIN = re.compile(r"[^\s\"=]+")


def _code(error: KantSqlError) -> int:
    from ..history.replication.service import MAY_PASS
    from ..history.replication.service import REFUSED as REFUSALS

    if isinstance(error, MAY_PASS):
        return TRY_AGAIN
    if isinstance(error, (AuthenticationError, ReadOnlyStoreError)):
        return NO_PERMISSION
    if isinstance(error, (SchemaError, InvalidUrlError)):
        return WRONG_CONFIGURATION
    return REFUSED if isinstance(error, REFUSALS) else FAILED


def push(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            envvar=URL_VARIABLE,
            show_default=False,
            help="The URL of the store to read.",
        ),
    ],
    target: Annotated[
        str,
        typer.Argument(
            metavar="TARGET",
            envvar=_TARGET_VARIABLE,
            show_default=False,
            help="The URL of the other store; a missing SQLite file is created.",
        ),
    ],
    kb: Annotated[
        str | None, c.option("Push only this knowledge base; default: all.", metavar="NAME")
    ] = None,
    follow: Annotated[
        bool,
        c.option("Keep running, and push each new revision until SIGTERM or Ctrl-C.", "--follow"),
    ] = False,
    interval: Annotated[
        float,
        c.option(
            f"With --follow: wait at least this long between two pushes; default: {_INTERVAL:g}.",
            metavar="SECONDS",
        ),
    ] = _INTERVAL,
    archive: Annotated[
        str | None,
        c.option(
            "The archive with the rest of SOURCE's history; default: the one that SOURCE names.",
            metavar="URL",
        ),
    ] = None,
    adopt: Annotated[
        bool,
        c.option(
            "Turn a knowledge base in TARGET that is not a replica into one, if its history fits.",
            "--adopt",
        ),
    ] = False,
    as_json: Annotated[bool, c.json_lines("push")] = False,
) -> int:
    """Send the revisions that another store lacks.

    The target becomes a replica: the same history, without local writes. Exits with 1 if bytes of
    an erased text may remain there, 65 if a history is refused, 75 if a store cannot be reached,
    77 without permission, and 78 if a URL or the tables' version is wrong.
    """
    from ..history.replication.push import Terms
    from ..history.replication.service import PushService

    # NaN is not within them, either.
    if not 0 <= interval <= _LONGEST_INTERVAL:
        raise typer.BadParameter(
            f"expected 0 to {_LONGEST_INTERVAL:g} seconds", param_hint="--interval"
        )
    terms = Terms(archive, adopt, is_patient=not follow)
    stop = c.Stop()
    remaining: list[str] = []
    report = _reporter(as_json, follow, remaining)
    service = PushService(
        source, target, name=kb, terms=terms, report=report, is_stopped=lambda: stop.number != 0
    )
    try:
        if follow:
            with stop.on_signals():
                errors = service.follow(interval)
            if errors:
                raise c.ServiceError(errors[0], _code(errors[0]))
        else:
            _once(service, source, target, kb, is_said=not as_json)
    except c.ServiceError as error:
        if not error.is_said:
            raise
        return error.code
    except KantSqlError as error:
        raise c.ServiceError(error, _code(error)) from error
    return 1 if remaining and not follow else stop.code


def _once(service: PushService, source: str, target: str, name: str | None, is_said: bool) -> None:
    from ..history.replication.service import MAY_PASS
    from ..sql.catalog import written_names

    names = written_names(source)
    if name is not None or not names:
        c.choose(name, names)
    with c.leaving_nothing(target):
        errors = service.once(bar)
        if errors:
            # Another attempt is worthwhile as long as one of these may pass.
            passing = (error for error in errors if isinstance(error, MAY_PASS))
            error = next(passing, errors[0])
            raise c.ServiceError(error, _code(error), is_said)


def _reporter(as_json: bool, follow: bool, remaining: list[str]) -> Callable[[PushEvent], None]:
    printer = Printer()

    def report(event: PushEvent) -> None:
        if as_json:
            write_json(_document(event))
        elif follow:
            # Few lines have `remaining`.
            told = ((key, value) for key, value in _document(event).items() if value != ())
            pairs = (f"{key}={_value(value)}" for key, value in told)
            sys.stdout.write(f"{' '.join(pairs)}\n")
        elif event.pushed is not None:
            printer.line(f"{printable(event.knowledge_base or '')}: {_pushed_text(event.pushed)}")
        elif event.error is not None:
            complain(_reason(event.knowledge_base or "", event.error))
        # The log on standard error has the details.
        remaining.extend(() if event.pushed is None else event.pushed.remaining)
        # Readers of a log get each line at once.
        sys.stdout.flush()

    return report


def _reason(name: str, error: KantSqlError) -> str:
    """Return why a knowledge base was not sent, with its name."""
    text = str(error)
    return text if repr(name) in text else f"{name}: {text}"


def _document(event: PushEvent) -> Document:
    document: Document = {"time": time_text(datetime.now(UTC)), "event": event.event}
    if event.knowledge_base is not None:
        document["knowledge_base"] = event.knowledge_base
    if event.pushed is not None:
        document |= {**event.pushed._asdict(), "revisions": event.pushed.revisions}
    if event.seconds is not None:
        document["seconds"] = round(event.seconds, 3)
    if event.error is not None:
        document |= {"type": type(event.error).__name__, "error": str(event.error)}
    if event.retry_in is not None:
        document["retry_in"] = round(event.retry_in, 3)
    return document


def _value(value: object) -> str:
    text = "; ".join(value) if isinstance(value, tuple) else str(value)
    return text if _PLAIN.fullmatch(text) else printable(json.dumps(text, ensure_ascii=False))


def _pushed_text(pushed: Pushed) -> str:
    target = printable(pushed.target)
    if pushed.revision > pushed.source_revision:
        return (
            f"nothing new; {target} is ahead, at revision {pushed.revision}, and the source is "
            f"at {pushed.source_revision}"
        )
    if not pushed.revisions:
        return f"nothing new, at revision {pushed.revision}"
    first, last = pushed.before + 1, pushed.revision
    sent = f"revision {last}" if first == last else f"revisions {first} to {last}"
    return f"{sent} sent to {target} ({plural(pushed.versions, 'version')})"


def promote(
    url: c.Url,
    kb: c.Name = None,
    actor: c.Actor = None,
    reason: c.Reason = None,
    as_json: c.AsJson = False,
) -> None:
    """Turn a replica into a knowledge base that you can write to.

    From then on, it refuses new revisions of its origin.
    """
    with c.open_to_read(url, kb) as (name, knowledge_base):
        made = knowledge_base.store.promote(reason=reason, actor=actor)
    if as_json:
        write_json(knowledge_base=name, revision=made)
    elif made is None:
        Printer().line(f"knowledge base {printable(name)} is not a replica; nothing was changed")
    else:
        Printer().line(
            f"knowledge base {printable(name)}, revision {made}: no longer a replica", "bold"
        )
