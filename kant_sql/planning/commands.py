"""Planners as programs: their command lines, including those of engines, and their answers."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
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
_NO_PLAN = re.compile(r"unsolvable|no solution|no plan|not solvable", re.IGNORECASE)
_NUMBERED = re.compile(r"(?:sas_)?plan(?:\.(\d+))?|.*\.soln")
# The exit codes of Fast Downward, https://www.fast-downward.org/ExitCodes.
_EXIT_CODES = {
    **dict.fromkeys((10, 11), "unsolvable_proven"),
    12: "unsolvable_incompletely",
    **dict.fromkeys((20, 22, 24), "memout"),
    **dict.fromkeys((21, 23), "timeout"),
    34: "unsupported_problem",
}
# With these statuses, unified-planning may still write the problem in a way that engines read.
MISREAD = "internal_error", "unsupported_problem"
INVALID = "invalid_plan"
FAST_DOWNWARD, OPTIMAL_DOWNWARD = "fast-downward", "fast-downward-opt"
PYPERPLAN, ENHSP = "pyperplan", "enhsp"
# Limits Fast Downward's search for invariants, which would take minutes for compiled problems.
INVARIANTS = ("--invariant-generation-max-time", "5")
_STRIPS = {":strips", ":typing"}
_SIMPLE = _STRIPS | {":negative-preconditions", ":equality", ":action-costs"}
_LOGICAL = _SIMPLE | {
    ":disjunctive-preconditions",
    ":existential-preconditions",
    ":universal-preconditions",
    ":conditional-effects",
}
# Engines of unified-planning: the requirements of documents that they read directly, their
# packages, and their options.
_ANYTIME = "fast-downward while there is time"
_READS = {
    FAST_DOWNWARD: _LOGICAL | {":derived-predicates"},
    PYPERPLAN: _STRIPS,
    ENHSP: (_LOGICAL | {":numeric-fluents"}) - {":equality"},
    OPTIMAL_DOWNWARD: _SIMPLE,  # LM-cut takes no axioms and no `when`.
}
_PACKAGES = {PYPERPLAN: "pyperplan", ENHSP: "up_enhsp"}
_OPTIONS = {
    FAST_DOWNWARD: "--alias lama-first {domain} {problem}",
    _ANYTIME: "--alias seq-sat-lama-2011 {domain} {problem} --translate-options "
    + " ".join(INVARIANTS),
    OPTIMAL_DOWNWARD: "{domain} {problem} --search astar(lmcut())",
    PYPERPLAN: "-s wastar -H hadd {domain} {problem}",
    ENHSP: "-o {domain} -f {problem} -sp {plan} -npm -h hadd -s gbfs",
}


@dataclass(frozen=True)
class Command:
    """The command line of a planner."""

    name: str  # its name
    # The program and its arguments, with `{domain}`, `{problem}` and `{plan}` for paths.
    words: tuple[str, ...]
    status: str = SATISFICING  # the status of its plans
    exit_codes: dict[int, str] = field(default_factory=dict)  # the meanings of its exit codes


def find_command(engine: str) -> Command | None:
    """Return the planner of a command line, or of a name in the file of engines."""
    if given := _COMMAND.fullmatch(engine):
        return _parsed(given["name"], given["line"], engine)
    if "{domain}" in engine:
        return _parsed(None, engine, engine)
    line = configured(engines_file()).get(engine)
    return None if line is None else _parsed(engine, line, f"{engine}: {line}")


def named(engine: str | None) -> str | None:
    """Return the name of an engine; refuse a command line, which a stranger must not run."""
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
    missing = [
        one for one in ("domain", "problem") if not any(f"{{{one}}}" in word for word in words)
    ]
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


def configured(path: Path) -> dict[str, str]:
    """Read the command lines of the file of engines, by their names."""
    if not path.exists() and not os.environ.get(ENGINES_VARIABLE):
        return {}
    import tomllib

    try:
        given = tomllib.loads(path.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidArgumentError(
            f"the engines in {path} cannot be read: {error}; write a table [engines] in TOML with "
            f"a command line for each name, or unset {ENGINES_VARIABLE}"
        ) from error
    found = given.get("engines", None if given else {})
    named = {f".{name}": line for name, line in found.items()} if isinstance(found, dict) else {}
    wrong = [one for one in named.items() if not isinstance(one[1], str)]
    if wrong or not isinstance(found, dict):
        name, line = (*wrong, ("", found))[0]
        raise InvalidArgumentError(
            f"engines{name} in {path} is {shown(line)}; "
            'write a command line: [engines] lama = "fast-downward.py {domain} {problem}"'
        )
    return found


def _direct(
    domain: Domain, problem: Problem, engines: Sequence[str], improves: bool
) -> Command | None:
    """Return the command line of the first installed engine that reads the documents."""
    needed = {*used_requirements(domain, problem=problem)}
    for name in engines:
        if needed <= _READS.get(name, set()) and _fits(domain, problem, name):
            command = _installed(name, problem, improves)
            if command is not None:
                return command
    return None


def _installed(name: str, problem: Problem, improves: bool) -> Command | None:
    """Return the command line of an engine of unified-planning, if it is installed."""
    package = _PACKAGES.get(name, "up_fast_downward")
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None or (name == ENHSP and not shutil.which("java")):
        return None
    home, status, codes = Path(spec.origin).parent, SATISFICING, _EXIT_CODES
    if name == PYPERPLAN:
        program, codes = [sys.executable, "-m", package], {0: "unsolvable_proven"}
    elif name == ENHSP:
        program, codes = ["java", "-jar", str(home / "ENHSP" / "enhsp.jar")], {}
    else:
        driver = str(home / "downward" / "fast-downward.py")
        program = [sys.executable, driver, "--plan-file", "{plan}"]
    if name == OPTIMAL_DOWNWARD and problem.metric is not None:
        status = OPTIMAL
    options = _OPTIONS[_ANYTIME if improves and name == FAST_DOWNWARD else name]
    return Command(name, (*program, *options.split()), status, codes)


def _fits(domain: Domain, problem: Problem, engine: str) -> bool:
    """Return whether an engine reads documents whose requirements it knows."""
    names = (*typed_names(domain, problem), *domain.types)
    if problem.literals or any(len(name.types) > 1 for name in names):
        return False
    if engine not in {FAST_DOWNWARD, OPTIMAL_DOWNWARD}:
        return engine == ENHSP or problem.metric is None
    values = [value.value for value in problem.values]
    numbers = (node for node in f.walk(*formulas(domain, problem), *values))
    if any(isinstance(n, f.Number) and n.value != n.value.to_integral_value() for n in numbers):
        return False
    # Its translator does not support costs within a condition or a quantifier.
    return not any(
        f.mentions(f.Assign, effect)
        for action in domain.actions
        for effect in unconditional(action.effect)
        if not isinstance(effect, f.Assign)
    )


def ask(
    command: Command, domain: Domain, problem: Problem, process: PlannerProcess, until: float
) -> Iterator[Plan]:
    """Run a planner, and yield its answers, the best (the last) first."""
    paths = {"plan": str(Path(process.folder, "plan"))}
    for name, document in (("domain", domain), ("problem", problem)):
        path = Path(process.folder, f"{name}.pddl")
        path.write_text(write(document), "utf-8")
        paths[name] = str(path)
    ended = process.run([*_filled(command, paths)], until)
    found = None
    for text in _answers(ended, process.folder):
        with suppress(KantSqlError):
            found = Plan.read(f"{text}\n")
            if found.steps or not ended.code:
                status = command.status if found.status == SATISFICING else found.status
                yield _spelled(replace(found, engine=command.name, status=status), domain, problem)
    if found is None:
        raise _without_plan(command, ended)


def ask_directly(
    domain: Domain,
    problem: Problem,
    engine: str | None,
    improving: float,  # seconds to look for better plans
    failures: dict[str, str],  # the statuses of engines, to which this function adds
    process: PlannerProcess,
    until: float,
) -> Iterator[Plan]:
    """Ask an engine, as `ask`; yield nothing if none reads the documents directly."""
    engines = [engine or FAST_DOWNWARD]
    anytime = improving and engine in {None, FAST_DOWNWARD, OPTIMAL_DOWNWARD}
    if not (engine or improving):
        engines += PYPERPLAN, ENHSP
    for improves in [True, False] if anytime else [False]:
        command = _direct(domain, problem, engines, improves)
        if command is None or failures.get(command.name) == INVALID:
            return
        end = min(until, time.monotonic() + improving) if improves else until
        try:
            yield from ask(command, domain, problem, process, end)
            return
        except NoPlanError as error:
            if not improves or error.status != "timeout":
                failures[command.name] = error.status
                raise


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
    """Yield the texts of the plan's files, the last first, then the output of the planner."""
    found = [
        (int(match[1] or 0), path)
        # A planner may delete its folder, create a pipe, or write without end.
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
    """Return a plan with the names of the documents: planners write them in lower case."""
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
