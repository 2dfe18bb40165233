"""Plans: their steps, reading and writing them, and the hash of the planner's input."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from hashlib import sha256
from typing import NamedTuple, NoReturn

from .. import html
from ..arguments import expect, expect_tuple, optional_text, refusal, whole_number
from ..dto.lexical import MAX_DIGITS, check_number, is_word
from ..errors import InvalidArgumentError, InvalidKnowledgeError, PddlError, printable
from ..pddl.lexer import STRING, read_file

SATISFICING, OPTIMAL = "solved_satisficing", "solved_optimally"


@dataclass(frozen=True, slots=True)
class PlanStep:
    """A step of a plan.

    Attributes:
        start: its start time; None in a plan without times.
        action: the action's name in the domain.
        arguments: the objects' names, in the order of the action's parameters.
        duration: its duration; None for an instantaneous step.
    """

    start: Decimal | None
    action: str
    arguments: tuple[str, ...] = ()
    duration: Decimal | None = None

    def __post_init__(self) -> None:
        expect(self.action, str, "the action of a PlanStep")
        arguments = expect_tuple(self.arguments, str, "the arguments of a PlanStep")
        object.__setattr__(self, "arguments", arguments)
        for role, number in (("start", self.start), ("duration", self.duration)):
            if number is not None:
                exact = check_number(number, f"the {role} of a PlanStep")
                object.__setattr__(self, role, exact)

    def _html_row_(self) -> html.Row:
        text = f"({' '.join((self.action, *self.arguments))})"
        return {"start": self.start, "step": text, "duration": self.duration}

    def __str__(self) -> str:
        text = f"({' '.join((self.action, *self.arguments))})"
        if self.start is not None:
            text = f"{self.start:f}: {text}"
        return text if self.duration is None else f"{text} [{self.duration:f}]"


@dataclass(frozen=True, slots=True)
class EngineRun:
    """The run of an engine.

    Attributes:
        engine: its name.
        seconds: its run time.
        status: `solved_satisficing`, `solved_optimally`, `invalid_plan`, `stopped` because another
            engine had a plan, `missing`, or a status of `NoPlanError`.
        said: its message, why its plan is not valid, or its last line of output.
    """

    engine: str
    seconds: float
    status: str
    said: str

    def __str__(self) -> str:
        return f"{self.engine}: {self.status} in {self.seconds:.2f} s, {self.said}"


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan; its text is in the format of the validator VAL.

    Attributes:
        steps: its steps, in order.
        engine: the engine that found it.
        status: the engine's verdict: `solved_satisficing` or `solved_optimally`.
        revision: the revision of the initial state.
        problem_hash: the `problem_hash` of the planner's input; None if unknown.
        ignored: the parts of the metric and the preferences that the planner did not get, as text.
        domain_pddl: the planner's domain, if it is not the state's.
        problem_pddl: the planner's problem, if it is not the state's.
        value: the value of the metric, if the plan was read from a text that states it.
        runs: the run of each engine.
    """

    steps: tuple[PlanStep, ...]
    engine: str
    status: str
    revision: int | None = None
    problem_hash: str | None = field(default=None, compare=False)
    ignored: tuple[str, ...] = ()
    domain_pddl: str | None = field(default=None, compare=False, repr=False)
    problem_pddl: str | None = field(default=None, compare=False, repr=False)
    value: Decimal | None = field(default=None, compare=False)
    runs: tuple[EngineRun, ...] = field(default=(), compare=False, repr=False)

    def __post_init__(self) -> None:
        for name, kind in (("steps", PlanStep), ("ignored", str)):
            found = expect_tuple(getattr(self, name), kind, f"the {name} of a Plan")
            object.__setattr__(self, name, found)
        expect(self.engine, str, "the engine of a Plan")
        expect(self.status, str, "the status of a Plan")
        for name in ("problem_hash", "domain_pddl", "problem_pddl"):
            optional_text(getattr(self, name), f"the {name} of a Plan", InvalidKnowledgeError)
        if self.revision is not None:
            whole_number(self.revision, "the revision of a Plan", error=InvalidKnowledgeError)
        if self.value is not None:
            check_number(self.value, "the value of a Plan")

    @classmethod
    def read(cls, source: str | os.PathLike[str]) -> Plan:
        """Read a plan of another program.

        It reads these formats, ignoring case, with comments (`;`) and any line ends: that of VAL;
        the plan files and the log of Fast Downward; the logs of POPF, OPTIC, Temporal Fast Downward
        and ENHSP; plans of unified-planning's `PDDLWriter`, and the `str` of its plans; the `str`
        of a `Plan`, and the output of `kant-sql plan`. If a log has several plans, it reads the
        last one, which is the best.

        Args:
            source: a path, or the text: a string with a line break, or one that begins with `(`,
                `;`, or a time and a colon.

        Returns:
            The plan. `engine` is the planner, if the text names it (`kant-sql plan`) or its format
            is unique (Fast Downward); otherwise it is empty. `status` is `solved_satisficing`,
            unless the text says `solved_optimally`. `value` is the stated metric or cost.
            `revision` is None: recording the plan uses the head.

        Raises:
            PddlError: a line is not a step; the error has the line, what was found and expected.
            SourceMissingError: the file does not exist; this is a `FileNotFoundError`, too.
            SourceError: the file cannot be read.

        Examples:
            >>> from kant_sql import Plan
            >>> plan = Plan.read("(move rb1 wp1 wp2)")
            >>> plan.steps
            (PlanStep(start=None, action='move', arguments=('rb1', 'wp1', 'wp2'), duration=None),)
            >>> print(Plan.read("0.5: (move rb1 wp1 wp2)  [2.500]"), end="")
            0.5: (move rb1 wp1 wp2) [2.500]
        """
        expected = "a path, or a plan's text"
        expect(source, (str, os.PathLike), "a plan", InvalidArgumentError, expected)
        if isinstance(source, str) and re.match(_TEXT, source):
            return _Reader(STRING, source).read()
        try:
            name = os.fsdecode(source)
        except Exception as error:
            raise refusal("a plan", expected, source, InvalidArgumentError) from error
        return _Reader(name, read_file(source).decode("utf-8", "surrogateescape")).read()

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)

    def _repr_html_(self) -> str:
        return html.listing(self.steps, "step")


_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TIME = rf"(?:(?P<start>{_NUMBER})\s*:\s*)?"
_DURATION = rf"(?:\[\s*(?P<duration>{_NUMBER})\s*\]\s*)?"
# Texts: reading a plan compiles them, and planners' processes read none.
_STEP = rf"{_TIME}\(\s*(?P<words>[^()]*?)\s*\)\s*{_DURATION}"
_CALL = rf"{_TIME}(?P<name>[^\s()\[\],]+)(?:\((?P<arguments>[^()]*)\))?\s*{_DURATION}"
# The beginning of a line that is meant to be a step.
_BEGINS_STEP = rf"\(|{_NUMBER}\s*:"
_FD_STEP = r"(?P<words>[^()]+?)\s*\(\d+\)"
_FD_TIME = r"^\[t=[^\]]*\]\s*"
_COST = rf"(?i);\s*cost\s*=\s*(?P<value>{_NUMBER})\s*\((?P<kind>\w+) cost\)"
_FD_COST = rf"Plan cost: (?P<value>{_NUMBER})$"
_METRIC = (
    r"(?i)(?:;\s*(?:Plan found with metric|Cost:|MetricValue)|Metric \(Search\):)"
    rf"\s*(?P<value>-?{_NUMBER})$"
)
_OURS = r";\s*(?P<status>solved_[a-z]+)(?: by (?P<engine>\S.*))?$"
# In a log, the steps of a plan follow these lines; those of POPF may follow its progress.
_HEADS = (
    r"(?i);\s*Plan found with metric|;;;;\s*Solution Found"
    r"|(?:Found new|Rescheduled|Found|new) plan:$"
)
# ENHSP writes this while processes run.
_WAITING = "-----waiting----"
_UP_HEADS = ("SequentialPlan:", "TimeTriggeredPlan:")
_FAST_DOWNWARD = "fast-downward"
_TEXT = rf"\ufeff?\s*(?:[(;]|{_NUMBER}\s*:|\Z)|[^\r\n\0]*[\r\n\0]|{'|'.join(_UP_HEADS)}"


class _Line(NamedTuple):
    number: int
    indent: int
    text: str
    # The text without its comment.
    code: str


class _Reader:
    def __init__(self, name: str, text: str) -> None:
        self._name = name
        self._engine, self._status = "", SATISFICING
        self._value: Decimal | None = None
        text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n")
        self._lines = [
            _Line(
                number,
                len(line) - len(line.lstrip()),
                line.strip(),
                line.partition(";")[0].strip(),
            )
            for number, line in enumerate(text.split("\n"), 1)
        ]

    def read(self) -> Plan:
        lines = [line for line in self._lines if line.text]
        if lines and lines[0].text in _UP_HEADS:
            steps = [self._call(line) for line in lines[1:] if line.code]
        elif any("Solution found!" in line.text for line in lines):
            steps = list(self._of_fast_downward())
        elif any(re.search(_HEADS, line.text) for line in lines):
            steps = list(self._of_log())
        else:
            steps = list(self._of_file(lines))
        return Plan(tuple(steps), self._engine, self._status, value=self._value)

    def _of_file(self, lines: list[_Line]) -> Iterator[PlanStep]:
        """Read lines that are steps or comments; refuse others."""
        for line in lines:
            self._comment(line.text)
            if line.code:
                yield self._step(line)

    def _of_log(self) -> Iterator[PlanStep]:
        """Read the last plan of a log: anytime planners find better ones later."""
        heads = [at for at, line in enumerate(self._lines) if re.search(_HEADS, line.text)]
        for line in self._lines[heads[-1] :]:
            self._comment(line.text)
        found = False
        for line in self._lines[heads[-1] + 1 :]:
            if _WAITING in line.code:
                continue
            if line.code and re.match(_BEGINS_STEP, line.code):
                found = True
                yield self._step(line)
            elif found and not line.text.startswith(";"):
                return

    def _of_fast_downward(self) -> Iterator[PlanStep]:
        """Read the last plan of a log of Fast Downward."""
        heads = [at for at, line in enumerate(self._lines) if "Solution found!" in line.text]
        self._engine = _FAST_DOWNWARD
        rest = iter(self._lines[heads[-1] + 1 :])
        for line in rest:
            text = re.sub(_FD_TIME, "", line.text)
            if text.startswith("Plan length:"):
                break
            if text and not text.startswith("Actual search time:"):
                match = re.fullmatch(_FD_STEP, text)
                if match is None:
                    self._refuse(line, 0, "a step as 'move a b (1)'")
                yield self._made(line, None, match["words"].split(), None)
        else:
            at = self._lines[-1]
            self._refuse(at, 0, "the line 'Plan length:' of Fast Downward", "the end of the text")
        for line in rest:
            if cost := re.fullmatch(_FD_COST, re.sub(_FD_TIME, "", line.text)):
                self._value = Decimal(cost["value"])
                return

    def _comment(self, text: str) -> None:
        if ours := re.fullmatch(_OURS, text):
            self._engine = ours["engine"] or ""
            self._status = OPTIMAL if ours["status"] == OPTIMAL else SATISFICING
        elif cost := re.fullmatch(_COST, text):
            self._engine = _FAST_DOWNWARD
            if cost["kind"].lower() == "general":
                # A unit cost is the number of steps, in any metric.
                self._value = Decimal(cost["value"])
        elif metric := re.search(_METRIC, text):
            self._value = Decimal(metric["value"])

    def _step(self, line: _Line) -> PlanStep:
        match = re.match(_STEP, line.code)
        expected = "a step as '(move a b)' or '0.001: (move a b) [5]'"
        if match is None:
            self._refuse(line, 0, expected)
        if match.end() < len(line.code):
            end = "the end of the line"
            expected = end if match["duration"] else f"a duration as '[5]', or {end}"
            self._refuse(line, match.end(), expected)
        words = match["words"].split()
        if not words:
            self._refuse(line, match.start("words"), "the name of an action", "an empty step")
        return self._made(line, match["start"], words, match["duration"])

    def _call(self, line: _Line) -> PlanStep:
        match = re.fullmatch(_CALL, line.code)
        if match is None:
            self._refuse(line, 0, "a step as 'move(a, b)' or '0.0: move(a, b) [5.0]'")
        arguments = match["arguments"]
        words = [match["name"]]
        if arguments is not None and arguments.strip():
            words += [word.strip() for word in arguments.split(",")]
        return self._made(line, match["start"], words, match["duration"])

    def _made(
        self, line: _Line, start: str | None, words: list[str], duration: str | None
    ) -> PlanStep:
        for word in words:
            if not is_word(word):
                at = max(line.text.find(word), 0)
                self._refuse(line, at, "the name of an action or an object", repr(word))
        times: list[Decimal | None] = []
        for text in (start, duration):
            try:
                times.append(None if text is None else check_number(Decimal(text), "a time"))
            except (ArithmeticError, InvalidKnowledgeError):
                self._refuse(line, 0, f"a number of at most {MAX_DIGITS} digits", repr(text))
        return PlanStep(times[0], words[0], tuple(words[1:]), times[1])

    def _refuse(
        self, line: _Line, column: int, expected: str, found: str | None = None
    ) -> NoReturn:
        if found is None:
            rest = line.code[column:] or "the end of the line"
            found = repr(printable(rest if len(rest) <= 60 else rest[:57] + "..."))
        column += line.indent + 1
        raise PddlError(self._name, line.number, column, found, expected, "the plan")


def problem_hash(domain: str, *, problem: str) -> str:
    """Hash the input of a planner.

    Args:
        domain: the domain's PDDL text.
        problem: the problem's PDDL text.

    Returns:
        The SHA-256 of both texts in UTF-8, the domain first, as 64 hexadecimal digits.
    """
    for text, role in ((domain, "domain"), (problem, "problem")):
        expect(text, str, role, InvalidArgumentError)
    # A lone surrogate has no UTF-8 form; such a text is not PDDL.
    return sha256((domain + problem).encode(errors="surrogatepass")).hexdigest()
