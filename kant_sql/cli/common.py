"""Shared code of the commands: options, moments as people type them, and opening stores."""

from __future__ import annotations

import math
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, NoReturn, TypeVar

import typer
from typer.core import TyperArgument, TyperGroup

from ..arguments import URL_VARIABLE
from ..errors import InvalidArgumentError, KantSqlError, UnknownNameError, few_of, printable
from ..moment_text import is_now, parse_moment
from ..pddl.cursor import hint
from ..pddl.lexer import tokenize
from ..plugins import Plugins

if TYPE_CHECKING:
    from ..knowledge_base import KnowledgeBase


T = TypeVar("T")
# Finds the function of a command by its name; and the loaded entry point of a plugin.
Functions = Mapping[str, Callable[[], "Callable[..., object] | typer.Typer"]]
Plug = Plugins[Callable[..., object]]
DEFAULT_NAME = "default"
JSON_OPTION = "--json"
# The first bytes of an SQLite file.
_SQLITE_FILE = b"SQLite format 3\0"

_MOMENT = (
    "a revision's number, a time in ISO 8601, 'now', '2 hours ago', 'yesterday' or 'last tuesday "
    "14:30'; UTC unless a zone is given."
)


_URL_HELP = "The database URL, such as sqlite:///robot.db, or the path of an SQLite file"


def option(
    help_: str, *names: str, metavar: str | None = None, **settings: Any
) -> typer.models.OptionInfo:
    """Describe an option whose default needs no mention."""
    made: typer.models.OptionInfo = typer.Option(
        *names, metavar=metavar, show_default=False, help=help_, **settings
    )
    return made


def seconds(help_: str) -> typer.models.OptionInfo:
    """Describe an option in seconds."""

    def check(given: float | None) -> float | None:
        if given is not None and math.isnan(given):
            raise typer.BadParameter(f"{given} is not a number of seconds.")
        return given

    return option(help_, metavar="SECONDS", min=0, callback=check)


def most(help_: str) -> typer.models.OptionInfo:
    """Describe the option that limits the output."""
    return option(help_, "--limit", "-n", metavar="N", min=0)


def json_lines(noun: str) -> typer.models.OptionInfo:
    """Describe the option for one JSON document per line."""
    return option(f"JSON Lines: one document per {noun}.", JSON_OPTION)


class CommandWords(NamedTuple):
    """The words of a command: the URL, which may come from the environment, and the rest."""

    usage: str  # the words after the URL; optional ones in square brackets
    example: str

    def argument(self, help_: str) -> typer.models.ArgumentInfo:
        """Describe the argument that has them."""
        made: typer.models.ArgumentInfo = typer.Argument(
            metavar=self.usage,
            show_default=False,
            help=f"{_URL_HELP}, unless the variable {URL_VARIABLE} has it, and {help_}",
        )
        return made

    def split(self, words: Sequence[str] | None) -> tuple[str, list[str]]:
        """Split them into the URL and the rest."""
        # The first word is the URL if it has `://`, or is the path of an SQLite file; otherwise use
        # the variable.
        words, wanted = words or (), self.usage.split()
        default = os.environ.get(URL_VARIABLE)
        is_given = bool(words) and _names_store(words[0], may_be_empty=not default)
        if default and not is_given:
            words = [default, *words]
        needed = 1 + sum(not word.startswith("[") for word in wanted[1:])
        has_room = len(words) <= len(wanted) or wanted[-1].endswith("...")
        if not (needed <= len(words) and has_room and all(words) and (is_given or default)):
            raise typer.BadParameter(
                f"give a URL or the path of an SQLite file (or set {URL_VARIABLE}) and "
                f"{' '.join(wanted[1:])}, such as: {self.example}",
                param_hint=self.usage,
            )
        return words[0], list(words[1:])


def _names_store(word: str, may_be_empty: bool) -> bool:
    """Return whether a word is a URL or the path of an SQLite file: PDDL files are words, too."""
    # Opening a pipe would wait.
    if "://" in word or not os.path.isfile(word):
        return "://" in word
    with Path(word).open("rb") as file:
        head = file.read(len(_SQLITE_FILE))
    return head == _SQLITE_FILE or (may_be_empty and not head)


Url = Annotated[
    str,
    typer.Argument(
        metavar="URL",
        envvar=URL_VARIABLE,
        show_default=False,
        help=_URL_HELP,
    ),
]
Name = Annotated[
    str | None,
    option(
        f"The knowledge base; default: the only one, or '{DEFAULT_NAME}'.", "--kb", metavar="NAME"
    ),
]
Target = Annotated[
    str, typer.Option("--kb", metavar="NAME", help="The knowledge base to write to.")
]
At = Annotated[str | None, option(f"The state at {_MOMENT}", metavar="REV|TIME")]
Valid = Annotated[
    str | None,
    option(
        "The state that was true at a time (with --at: as known then).",
        metavar="TIME",
    ),
]
Since = Annotated[str | None, option(f"Only from {_MOMENT}", metavar="REV|TIME")]
Until = Annotated[str | None, option(f"Only up to {_MOMENT}", metavar="REV|TIME")]
Clock = Annotated[
    str,
    option(
        "The clock: 'committed' (default), or 'valid' for the times when it was true.",
        metavar="CLOCK",
    ),
]
Actor = Annotated[str | None, option("The actor of the revision.", metavar="NAME")]
Reason = Annotated[str | None, option("The reason for the revision.", metavar="TEXT")]
AsJson = Annotated[bool, option("One JSON document.", JSON_OPTION)]
AnchorFile = Annotated[
    Path | None,
    option(
        "Output of 'kant-sql anchor': detects removed and rewritten revisions.",
        metavar="FILE",
        exists=True,
        dir_okay=False,
        readable=True,
    ),
]
Fixed = Annotated[
    list[str] | None,
    option(
        "Bind a variable to an object, such as r=rb1; you can repeat this.",
        "--fix",
        metavar="VARIABLE=OBJECT",
    ),
]
# Names of arguments that are not variables.
_RESERVED = frozenset({"clock", "limit", "name", "parameters", "since", "until"})


def parse_fixed(pairs: Sequence[str] | None) -> dict[str, str]:
    """Parse the objects of variables into keywords."""
    found: dict[str, str] = {}
    for pair in pairs or ():
        variable, equals, object_ = (part.strip() for part in pair.partition("="))
        name = variable.removeprefix("?")
        if not (name and equals and object_):
            raise typer.BadParameter(
                f"{pair!r}: expected a variable and an object, such as r=rb1", param_hint="--fix"
            )
        # Variables ignore case, keywords do not.
        key = name.upper() if name.lower() in _RESERVED else name
        if key in found:
            raise typer.BadParameter(f"?{name} is given twice", param_hint="--fix")
        found[key] = object_
    return found


def parse_when(text: str, hint: str = "--at") -> int | datetime:
    """Parse a revision's number or a time."""
    try:
        return parse_moment(text)
    except InvalidArgumentError as error:
        raise typer.BadParameter(str(error), param_hint=hint) from None


def parse_optional(text: str | None, hint: str) -> int | datetime | None:
    """Parse a revision's number or a time; None if not given."""
    return None if text is None else parse_when(text, hint)


def parse_state(text: str | None, hint: str = "--at") -> int | datetime | None:
    """Parse a revision's number or a time; None for the present."""
    return None if text is None or is_now(text) else parse_when(text, hint)


def parse_range(
    since: str | None, until: str | None
) -> tuple[int | datetime | None, int | datetime | None]:
    """Parse the first and the last moment of a range; None for an open end."""
    return parse_optional(since, "--since"), parse_state(until, "--until")


def require_word(given: str, words: Sequence[str], hint: str) -> None:
    """Refuse a word that is not one of the given."""
    if given not in words:
        expected = f"{given!r}: expected one of {', '.join(words)}"
        raise typer.BadParameter(expected, param_hint=hint)


_NAMES_SHOWN = 20
_TERMINATING = "SIGTERM", "SIGHUP"
_INTERRUPTED = 130
# Seconds between a service's checks whether to stop.
_SLICE = 0.2


@contextmanager
def leaving_nothing(url: str) -> Iterator[None]:
    """Remove the SQLite file that the block creates if the block fails or is terminated."""
    from ..sql.catalog import removed_on_failure

    with removed_on_failure(url), signals_raise():
        yield


@contextmanager
def signals_raise() -> Iterator[None]:
    """Turn signals that terminate the process into `SystemExit`, for cleanup."""

    def stop(number: int, frame: object) -> NoReturn:
        raise SystemExit(128 + number)

    is_main = threading.current_thread() is threading.main_thread()
    numbers = [getattr(signal, name) for name in _TERMINATING if is_main and hasattr(signal, name)]
    before = {one: signal.SIG_DFL for one in numbers if signal.getsignal(one) is signal.SIG_DFL}
    with _handled(before, stop):
        yield


@contextmanager
def _handled(before: Mapping[signal.Signals, Any], stop: Callable[..., None]) -> Iterator[None]:
    """Handle signals in the block; restore the handlers after it."""
    for number in before:
        signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class Stop:
    """The signal that asks a service to end after its batch."""

    def __init__(self) -> None:
        self.number = 0

    @property
    def code(self) -> int:
        """The exit code of the service."""
        return _INTERRUPTED if self.number == signal.SIGINT else 0

    def wait(self, seconds: float) -> None:
        """Sleep until a signal: a plain sleep continues after a handled one."""
        end = time.monotonic() + seconds
        while not self.number and (left := end - time.monotonic()) > 0:
            time.sleep(min(left, _SLICE))

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Note the first signal; a second one ends the process."""

        def stop(number: int, frame: object) -> None:
            self.number = number
            signal.signal(number, before[signal.Signals(number)])

        numbers = signal.SIGTERM, signal.SIGINT
        # A handler is None if it is not a Python function.
        before: dict[signal.Signals, Any] = {
            number: signal.getsignal(number) or signal.SIG_DFL for number in numbers
        }
        # Ignored signals stay ignored, as under nohup.
        before = {number: then for number, then in before.items() if then is not signal.SIG_IGN}
        with _handled(before, stop):
            yield


@contextmanager
def open_to_read(
    url: str, name: str | None, actor: str | None = None
) -> Iterator[tuple[str, KnowledgeBase]]:
    """Open an existing knowledge base; nothing is created."""
    from ..knowledge_base import connect
    from ..sql.catalog import written_names

    chosen = choose(name, written_names(url))
    with connect(url, knowledge_base=chosen, actor=actor) as kb:
        yield chosen, kb


@contextmanager
def open_state(
    url: str, name: str | None, at: str | None, valid: str | None = None
) -> Iterator[tuple[str, KnowledgeBase]]:
    """Open one state of an existing knowledge base; nothing is created."""
    when, moment = parse_state(at), parse_optional(valid, "--valid")
    with open_to_read(url, name) as (chosen, knowledge_base):
        known = knowledge_base.revision if when is None else when
        yield chosen, knowledge_base.at(known=known, valid=moment)


def ask_state(
    url: str,
    name: str | None,
    at: str | None,
    valid: str | None,
    question: Callable[[KnowledgeBase], T],
) -> tuple[str, int, T]:
    """Ask one state of a knowledge base; return its name, the revision and the answer."""
    # Query the present as such: its facts have indexes that past ones lack. If somebody writes
    # meanwhile, query the state before again.
    when, moment = parse_state(at), parse_optional(valid, "--valid")
    with open_to_read(url, name) as (chosen, knowledge_base):
        if when is None and moment is None:
            when = knowledge_base.revision
            answer = question(knowledge_base)
            if knowledge_base.revision == when:
                return chosen, when, answer
        known = knowledge_base.revision if when is None else when
        state = knowledge_base.at(known=known, valid=moment)
        return chosen, state.revision, question(state)


def choose(name: str | None, names: Sequence[str]) -> str:
    """Choose a knowledge base of a store."""
    if name is None and len(names) == 1:
        return names[0]
    wanted = DEFAULT_NAME if name is None else name
    if wanted in names:
        return wanted
    if not names:
        raise UnknownNameError(
            "this store is empty: it has no knowledge base yet; name another store, or fill this "
            "one with: kant-sql load"
        )
    raise UnknownNameError(
        f"there is no knowledge base {wanted!r} in this store; choose one with --kb: "
        f"{few_of([*map(repr, names)], _NAMES_SHOWN, ', ')}"
    )


def unknown_element(kb: KnowledgeBase, name: str, element: str, what: str) -> UnknownNameError:
    """Make the error for an unknown element, with a similar name if there is one."""
    daos = (
        kb.types,
        kb.objects,
        kb.predicates,
        kb.functions,
        kb.actions,
        kb.pddl.processes,
        kb.pddl.events,
    )
    names = [dto.name for dao in daos for dto in dao.get_all()]
    known = {one.lower() for one in names}
    words = (word for word in tokenize(element) if word not in "()-" and word.lower() not in known)
    hints = (found for word in words if (found := hint(word, names)))
    return UnknownNameError(
        f"{printable(element)!r} in knowledge base {name!r}: it {what}{next(hints, '')}"
    )


class Argument(TyperArgument):
    """An argument shown in the help by its metavar alone: no braces, dots or Python types."""

    def get_usage_pieces(self, ctx: Any) -> list[str]:
        """Return the argument for the usage line."""
        return [self.metavar or str(self.name)]

    def get_help_record(self, ctx: Any) -> tuple[str, str] | None:
        """Return the argument for the list of arguments."""
        record = super().get_help_record(ctx)
        return record and (self.metavar or str(self.name), record[1])


class CommandGroup(TyperGroup):
    """Commands of the library and of plugins: functions with annotations for Typer."""

    # Finds the function of a command, or an app of several, by name.
    functions: ClassVar[Functions] = MappingProxyType({})
    plugins: ClassVar[Plug]  # the group of entry points with the names of others

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        for command in (self, *self.commands.values()):
            _name_arguments(command)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, those of plugins last."""
        return [*dict.fromkeys((*self.functions, *self.commands, *self.plugins.names()))]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, made on first use; None if there is none."""
        made: dict[str, Any] = {**self.commands}
        if made.get(cmd_name) is None:
            find = self.functions.get(cmd_name)
            function = self.plugins.get(cmd_name) if find is None else find()
            if function is None:
                # Typer suggests similar names from these.
                made = {**dict.fromkeys(self.list_commands(ctx)), **made}
            else:
                made[cmd_name] = _make(cmd_name, function)
            self.commands = made
        return made.get(cmd_name)


def command_group(plugins: str, help_: str) -> typer.Typer:
    """Make a command with subcommands, including those of a group of entry points."""
    group = type("_Group", (CommandGroup,), {"plugins": Plugins(plugins)})
    return typer.Typer(cls=group, help=help_, rich_markup_mode=None, add_completion=False)


def _make(name: str, function: Callable[..., object] | typer.Typer) -> Any:
    """Make the command of a function."""
    app = function
    if not isinstance(app, typer.Typer):
        app = typer.Typer(rich_markup_mode=None, add_completion=False)
        app.command(name)(function)
    made = typer.main.get_command(app)
    made.name = name
    _name_arguments(made)
    return made


def _name_arguments(command: Any) -> None:
    """Replace the arguments of a command by ours; Typer has no setting for it."""
    for parameter in command.params:
        if type(parameter) is TyperArgument:
            parameter.__class__ = Argument


class ServiceError(Exception):
    """An error with an exit code for a service manager."""

    def __init__(self, error: KantSqlError, code: int, is_said: bool = False) -> None:
        super().__init__(str(error))
        self.error = error
        self.code = code
        self.is_said = is_said  # whether it was already written to standard error
