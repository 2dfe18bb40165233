"""Planners that are programs: their command lines, what they answer, and Fast Downward's."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import sys
import time
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..arguments import shown
from ..dto import formulas as f
from ..dto.lexical import fold
from ..errors import InvalidArgumentError, KantSqlError, NoPlanError, PlannerMissingError, printable
from ..pddl.document import Domain, Problem, formulas, typed_names
from ..pddl.requirements import used_requirements
from ..pddl.writer import write
from .metrics import unconditional
from .plan import OPTIMAL, SATISFICING, Plan
from .processes import MOST_OUTPUT, Ended, PlannerProcess

WAYS_OUT = (
    "Plan.read(text) takes the plan of a program outside, and in a branch, kb.branch(), you can "
    "relax the goal or the conditions and plan again"
)
ENGINES_VARIABLE = "KANT_SQL_ENGINES"
_COMMAND = re.compile(r"\s*(?P<name>[^\s:{}]+):\s+(?P<line>\S.*)", re.DOTALL)
_FIELDS = ("domain", "problem", "plan")
_NO_PLAN = re.compile(r"unsolvable|no solution|no plan|not solvable", re.IGNORECASE)
_NUMBERED = re.compile(r"(?:sas_)?plan(?:\.(\d+))?|.*\.soln")
# The exit codes of Fast Downward, https://www.fast-downward.org/ExitCodes.
_EXIT_CODES = {
    10: "unsolvable_proven",
    11: "unsolvable_proven",
    12: "unsolvable_incompletely",
    20: "memout",
    21: "timeout",
    22: "memout",
    23: "timeout",
    24: "memout",
    34: "unsupported_problem",
}
# What Fast Downward says where unified-planning may write the problem in a way that it reads.
MISREAD = "internal_error", "unsupported_problem"
FAST_DOWNWARD, OPTIMAL_DOWNWARD = "fast-downward", "fast-downward-opt"
# The seconds that Fast Downward looks for invariants; it would take minutes for what was compiled.
INVARIANTS = ("--invariant-generation-max-time", "5")
_SIMPLE = {":strips", ":typing", ":negative-preconditions", ":equality", ":action-costs"}
_LOGICAL = _SIMPLE | {
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":conditional-effects",
    ":derived-predicates",
}


@dataclass(frozen=True)
class Command:
    """The command line of a planner.

    Attributes:
        name: what it is called.
        words: the program and its arguments, with `{domain}`, `{problem}` and `{plan}` for paths.
        status: the status of its plans.
        exit_codes: what its exit codes mean.
    """

    name: str
    words: tuple[str, ...]
    status: str = SATISFICING
    exit_codes: dict[int, str] = field(default_factory=dict)


def find_command(engine: str) -> Command | None:
    """Return the planner that a text names, or that the file of engines has by this name."""
    if given := _COMMAND.fullmatch(engine):
        return _parsed(given["name"], given["line"], engine)
    if "{domain}" in engine:
        return _parsed(None, engine, engine)
    line = configured().get(engine)
    return None if line is None else _parsed(engine, line, f"{engine}: {line}")


def named(engine: str | None) -> str | None:
    """Return the name of an engine; refuse a command line, which a stranger may not have run.

    Raises:
        InvalidArgumentError: it is one.
    """
    if engine is not None and (":" in engine or "{" in engine):
        raise InvalidArgumentError(
            f"engine {printable(engine)!r} is a command line, which is not run for others; give a "
            "name, of unified-planning or of the file of engines"
        )
    return engine


def _parsed(name: str | None, line: str, given: str) -> Command:
    try:
        words = tuple(shlex.split(line))
    except ValueError as error:
        raise InvalidArgumentError(
            f"engine {printable(given)!r} is not a command line: {error}; quote as in a shell"
        ) from error
    missing = [one for one in _FIELDS[:2] if not any(f"{{{one}}}" in word for word in words)]
    if missing:
        raise InvalidArgumentError(
            f"engine {printable(given)!r} does not say where the planner takes the {missing[0]}; "
            f"write {{{missing[0]}}} in the place of its file, as in "
            "'lama: fast-downward.py --alias lama-first {domain} {problem}'"
        )
    return Command(name or Path(words[0]).name, words)


def engines_file() -> Path:
    """Return the file that names engines; it need not exist."""
    if named := os.environ.get(ENGINES_VARIABLE):
        return Path(named)
    folder = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(folder, "kant_sql", "engines.toml")


def configured() -> dict[str, str]:
    """Read the command lines of the file of engines, by their names."""
    path = engines_file()
    if not path.exists() and ENGINES_VARIABLE not in os.environ:
        return {}
    try:
        given = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidArgumentError(
            f"the engines in {path} cannot be read: {error}; write a table [engines] in TOML with "
            f"a command line for each name, or unset {ENGINES_VARIABLE}"
        ) from error
    found = given.get("engines", None if given else {})
    lines = found.items() if isinstance(found, dict) else ()
    wrong = [name for name, line in lines if not isinstance(line, str)]
    if wrong or not isinstance(found, dict):
        raise InvalidArgumentError(
            f"engines{''.join(f'.{name}' for name in wrong[:1])} in {path} is {shown(found)}; "
            'write a command line: [engines] lama = "fast-downward.py {domain} {problem}"'
        )
    return found


def fast_downward(
    domain: Domain, problem: Problem, engine: str | None, improves: bool = False
) -> Command | None:
    """Return Fast Downward's command line, where it is installed and reads all of the documents.

    Args:
        engine: its name in unified-planning, or None for any.
        improves: whether to look for better plans for as long as it may run.
    """
    if engine not in (None, FAST_DOWNWARD, OPTIMAL_DOWNWARD):
        return None
    spec = importlib.util.find_spec("up_fast_downward")
    is_optimal = engine == OPTIMAL_DOWNWARD
    if spec is None or spec.origin is None or not _fits(domain, problem, is_optimal):
        return None
    driver = Path(spec.origin).parent / "downward" / "fast-downward.py"
    words = [sys.executable, str(driver), "--plan-file", "{plan}"]
    if improves and not is_optimal:
        words += ["--alias", "seq-sat-lama-2011", "{domain}", "{problem}"]
        words += ["--translate-options", *INVARIANTS]
    elif is_optimal:
        words += ["{domain}", "{problem}", "--search", "astar(lmcut())"]
    else:
        words += ["--alias", "lama-first", "{domain}", "{problem}"]
    status = OPTIMAL if is_optimal and problem.metric is not None else SATISFICING
    return Command(engine or FAST_DOWNWARD, tuple(words), status, _EXIT_CODES)


def _fits(domain: Domain, problem: Problem, is_optimal: bool) -> bool:
    """Return whether Fast Downward reads the documents; LM-cut takes no axioms and no `when`."""
    if not {*used_requirements(domain, problem=problem)} <= (_SIMPLE if is_optimal else _LOGICAL):
        return False
    names = (*typed_names(domain, problem), *domain.types)
    if problem.literals or any(len(name.types) > 1 for name in names):
        return False
    values = [value.value for value in problem.values]
    numbers = (node for node in f.walk(*formulas(domain, problem), *values))
    if any(isinstance(n, f.Number) and n.value != n.value.to_integral_value() for n in numbers):
        return False
    # Its translator knows no cost within a condition or a quantifier.
    return not any(
        f.mentions(f.Assign, effect)
        for action in domain.actions
        for effect in unconditional(action.effect)
        if not isinstance(effect, f.Assign)
    )


def ask(
    command: Command,
    domain: Domain,
    problem: Problem,
    process: PlannerProcess,
    folder: str,
    until: float,
    memory: int | None = None,
) -> Iterator[Plan]:
    """Run a planner, and yield what it answers, the best (the last) first.

    Raises:
        NoPlanError: it answers nothing; `status` is the reason.
        PlannerMissingError: the program is not there.
    """
    paths = {name: str(Path(folder, f"{name}.pddl")) for name in _FIELDS[:2]}
    paths["plan"] = str(Path(folder, "plan"))
    Path(paths["domain"]).write_text(write(domain), "utf-8")
    Path(paths["problem"]).write_text(write(problem), "utf-8")
    ended = process.run([*_filled(command, paths)], folder, until, memory)
    found = None
    for text in _answers(ended, folder):
        with suppress(KantSqlError):
            found = Plan.read(f"{text}\n")
            if found.steps or not ended.code:
                status = command.status if found.status == SATISFICING else found.status
                yield _spelled(replace(found, engine=command.name, status=status), domain, problem)
    if found is None:
        raise _without_plan(command, ended)


def ask_fast_downward(
    domain: Domain,
    problem: Problem,
    engine: str | None,
    improving: float,
    process: PlannerProcess,
    folder: str,
    until: float,
    memory: int | None = None,
) -> Iterator[Plan]:
    """Ask Fast Downward as `ask` does; yield nothing where it does not read the documents.

    Args:
        engine: its name in unified-planning, or None for any.
        improving: the seconds in which to look for better plans.
    """
    given = domain, problem, process, folder
    if improving and (command := fast_downward(domain, problem, engine, improves=True)):
        try:
            yield from ask(command, *given, min(until, time.monotonic() + improving), memory)
            return
        except NoPlanError as error:
            if error.status != "timeout":
                raise
    if command := fast_downward(domain, problem, engine):
        yield from ask(command, *given, until, memory)


def _filled(command: Command, paths: dict[str, str]) -> Iterator[str]:
    program, *words = command.words
    place = shutil.which(program)
    if place is None:
        raise PlannerMissingError(
            f"engine {command.name}: there is no program {program!r}; install it, or name it by "
            "its path"
        )
    yield str(Path(place).absolute())
    for word in words:
        yield re.sub(r"\{(domain|problem|plan)\}", lambda match: paths[match[1]], word)


def _answers(ended: Ended, folder: str) -> Iterator[str]:
    """Yield the texts of the plan's files, the last first, then what the planner printed."""
    found = [
        (int(match[1] or 0), path)
        # A planner may delete its folder, or write a pipe, or without end.
        for path in Path(folder).glob("*")
        if (match := _NUMBERED.fullmatch(path.name))
        and path.is_file()
        and path.stat().st_size < MOST_OUTPUT
    ]
    for _, path in sorted(found, reverse=True):
        with suppress(OSError):
            yield path.read_bytes().decode(errors="replace")
    if not found and ended.output.strip():
        yield ended.output


def _without_plan(command: Command, ended: Ended) -> NoPlanError:
    status = ended.status or command.exit_codes.get(ended.code)
    if status is None:
        is_said = not command.exit_codes and _NO_PLAN.search(ended.output[-10_000:])
        status = "unsolvable_incompletely" if is_said else "internal_error"
    said = printable(ended.reason)
    message = f"no plan was found ({command.name}: {status}, {said}); {WAYS_OUT}"
    return NoPlanError(message, status)


def _spelled(plan: Plan, domain: Domain, problem: Problem) -> Plan:
    """Return a plan in the names of the documents: planners write them in lower case."""
    actions = {fold(one.name): one.name for one in domain.actions}
    objects = {fold(one.name): one.name for one in (*problem.objects, *domain.constants)}
    steps = (
        replace(
            step,
            action=actions.get(fold(step.action), step.action),
            arguments=tuple(objects.get(fold(word), word) for word in step.arguments),
        )
        for step in plan.steps
    )
    return replace(plan, steps=tuple(steps))
