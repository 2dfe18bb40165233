"""The texts of plans, as validators and planners write them.

- VAL: `0.001: (move a b) [5]` in each line, or `(move a b)`, and comments.
- Fast Downward: plan files, `(move a b)` with `; cost = 5 (general cost)`; and its log, which has
  `move a b (2)` between `Solution found!` and `Plan length: 1 step(s).`
- POPF and OPTIC: `; Plan found with metric 5.001` or `;;;; Solution Found`, more comments, and
  `0.000: (move a b)  [5.000]`.
- Temporal Fast Downward: `Found new plan:`, `Rescheduled Plan:`, and steps as those of VAL.
- ENHSP: `Found Plan:`, and steps as those of VAL.
- unified-planning: what its `PDDLWriter` writes, and the `str` of a plan, `SequentialPlan:` or
  `TimeTriggeredPlan:` with `move(a, b)` in each line.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from decimal import Decimal
from typing import NamedTuple, NoReturn

from ..arguments import expect
from ..dto.lexical import MAX_DIGITS, check_number, is_word
from ..errors import InvalidArgumentError, InvalidKnowledgeError, PddlError, printable
from ..pddl.lexer import STRING, read_file

SATISFICING, OPTIMAL = "solved_satisficing", "solved_optimally"


class StepText(NamedTuple):
    """A step, as `PlanStep` has it."""

    start: Decimal | None
    action: str
    arguments: tuple[str, ...]
    duration: Decimal | None


class PlanText(NamedTuple):
    """What a text says of a plan.

    Attributes:
        engine: the planner's name; empty when it is not stated.
        status: `solved_optimally` if that is stated, else `solved_satisficing`.
        value: the value of the metric or the cost, if it is stated.
    """

    steps: tuple[StepText, ...]
    engine: str
    status: str
    value: Decimal | None


_NUMBER = r"(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_TIME = rf"(?:(?P<start>{_NUMBER})\s*:\s*)?"
_DURATION = rf"(?:\[\s*(?P<duration>{_NUMBER})\s*\]\s*)?"
_STEP = re.compile(rf"{_TIME}\(\s*(?P<words>[^()]*?)\s*\)\s*{_DURATION}")
_CALL = re.compile(rf"{_TIME}(?P<name>[^\s()\[\],]+)(?:\((?P<arguments>[^()]*)\))?\s*{_DURATION}")
# A line that is meant to be a step, however it goes on.
_BEGINS_STEP = re.compile(rf"\(|{_NUMBER}\s*:")
_FD_STEP = re.compile(r"(?P<words>[^()]+?)\s*\(\d+\)")
_FD_TIME = re.compile(r"^\[t=[^\]]*\]\s*")
_COST = re.compile(rf";\s*cost\s*=\s*(?P<value>{_NUMBER})\s*\((?P<kind>\w+) cost\)", re.IGNORECASE)
_FD_COST = re.compile(rf"Plan cost: (?P<value>{_NUMBER})$")
_METRIC = re.compile(
    rf"(?:;\s*(?:Plan found with metric|Cost:)|Metric \(Search\):)\s*(?P<value>{_NUMBER})$",
    re.IGNORECASE,
)
_OURS = re.compile(r";\s*(?P<status>solved_[a-z]+)(?: by (?P<engine>\S.*))?$")
# The lines after which a log has the steps of a plan; those of POPF may follow its progress.
_HEADS = re.compile(
    r";\s*Plan found with metric|;;;;\s*Solution Found|(?:Found new|Rescheduled|Found|new) plan:$",
    re.IGNORECASE,
)
# ENHSP passes the time of processes so.
_WAITING = "-----waiting----"
_UP_HEADS = ("SequentialPlan:", "TimeTriggeredPlan:")
_FAST_DOWNWARD = "fast-downward"
_TEXT = re.compile(rf"\ufeff?\s*(?:[(;]|{_NUMBER}\s*:|\Z)|[^\r\n\0]*[\r\n\0]|{'|'.join(_UP_HEADS)}")


def read_plan(source: str | os.PathLike[str]) -> PlanText:
    """Read a plan."""
    expect(source, (str, os.PathLike), "a plan", InvalidArgumentError, "a path, or a plan's text")
    if isinstance(source, str) and _TEXT.match(source):
        return _Reader(STRING, source).read()
    name = os.fsdecode(source)
    return _Reader(name, read_file(source).decode("utf-8", "surrogateescape")).read()


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

    def read(self) -> PlanText:
        lines = [line for line in self._lines if line.text]
        if lines and lines[0].text in _UP_HEADS:
            steps = [self._call(line) for line in lines[1:] if line.code]
        elif any("Solution found!" in line.text for line in lines):
            steps = list(self._of_fast_downward())
        elif any(_HEADS.search(line.text) for line in lines):
            steps = list(self._of_log())
        else:
            steps = list(self._of_file(lines))
        return PlanText(tuple(steps), self._engine, self._status, self._value)

    def _of_file(self, lines: list[_Line]) -> Iterator[StepText]:
        """Read lines that are steps and comments, and nothing else."""
        for line in lines:
            self._comment(line.text)
            if line.code:
                yield self._step(line)

    def _of_log(self) -> Iterator[StepText]:
        """Read the last plan of a log: planners that go on find better ones."""
        heads = [at for at, line in enumerate(self._lines) if _HEADS.search(line.text)]
        for line in self._lines[heads[-1] :]:
            self._comment(line.text)
        found = False
        for line in self._lines[heads[-1] + 1 :]:
            if _WAITING in line.code:
                continue
            if line.code and _BEGINS_STEP.match(line.code):
                found = True
                yield self._step(line)
            elif found and not line.text.startswith(";"):
                return

    def _of_fast_downward(self) -> Iterator[StepText]:
        """Read the last plan of a log of Fast Downward."""
        heads = [at for at, line in enumerate(self._lines) if "Solution found!" in line.text]
        self._engine = _FAST_DOWNWARD
        rest = iter(self._lines[heads[-1] + 1 :])
        for line in rest:
            text = _FD_TIME.sub("", line.text)
            if text.startswith("Plan length:"):
                break
            if text and not text.startswith("Actual search time:"):
                match = _FD_STEP.fullmatch(text)
                if match is None:
                    self._refuse(line, 0, "a step as 'move a b (1)'")
                yield self._made(line, None, match["words"].split(), None)
        else:
            at = self._lines[-1]
            self._refuse(at, 0, "the line 'Plan length:' of Fast Downward", "the end of the text")
        for line in rest:
            if cost := _FD_COST.fullmatch(_FD_TIME.sub("", line.text)):
                self._value = Decimal(cost["value"])
                return

    def _comment(self, text: str) -> None:
        if ours := _OURS.fullmatch(text):
            self._engine = ours["engine"] or ""
            self._status = OPTIMAL if ours["status"] == OPTIMAL else SATISFICING
        elif cost := _COST.fullmatch(text):
            self._engine = _FAST_DOWNWARD
            if cost["kind"].lower() == "general":
                # A unit cost is the number of steps, whatever the metric.
                self._value = Decimal(cost["value"])
        elif metric := _METRIC.search(text):
            self._value = Decimal(metric["value"])

    def _step(self, line: _Line) -> StepText:
        match = _STEP.match(line.code)
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

    def _call(self, line: _Line) -> StepText:
        match = _CALL.fullmatch(line.code)
        if match is None:
            self._refuse(line, 0, "a step as 'move(a, b)' or '0.0: move(a, b) [5.0]'")
        arguments = match["arguments"]
        words = [match["name"]]
        if arguments is not None and arguments.strip():
            words += [word.strip() for word in arguments.split(",")]
        return self._made(line, match["start"], words, match["duration"])

    def _made(
        self, line: _Line, start: str | None, words: list[str], duration: str | None
    ) -> StepText:
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
        return StepText(times[0], words[0], tuple(words[1:]), times[1])

    def _refuse(
        self, line: _Line, column: int, expected: str, found: str | None = None
    ) -> NoReturn:
        if found is None:
            rest = line.code[column:] or "the end of the line"
            found = repr(printable(rest if len(rest) <= 60 else rest[:57] + "..."))
        column += line.indent + 1
        raise PddlError(self._name, line.number, column, found, expected, "the plan")
