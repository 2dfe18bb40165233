"""Plans: their steps, how they are read and written, and the hash of what they solve."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from decimal import Decimal
from hashlib import sha256

from .. import html
from ..arguments import expect, expect_tuple, optional_text, whole_number
from ..dto.lexical import check_number
from ..errors import (
    InvalidArgumentError,
    InvalidKnowledgeError,
)
from .plan_text import read_plan


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
        if arguments is not self.arguments:
            object.__setattr__(self, "arguments", arguments)
        for number, role in ((self.start, "start"), (self.duration, "duration")):
            if number is not None:
                check_number(number, f"the {role} of a PlanStep")

    def _html_row_(self) -> html.Row:
        text = f"({' '.join((self.action, *self.arguments))})"
        return {"start": self.start, "step": text, "duration": self.duration}

    def __str__(self) -> str:
        text = f"({' '.join((self.action, *self.arguments))})"
        if self.start is not None:
            text = f"{self.start:f}: {text}"
        return text if self.duration is None else f"{text} [{self.duration:f}]"


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan; its text is in the format of the validator VAL.

    Attributes:
        steps: its steps, in order.
        engine: the engine of unified-planning that found it.
        status: the engine's verdict: `solved_satisficing` or `solved_optimally`.
        revision: the revision of the knowledge base that was planned from.
        problem_hash: the `problem_hash` of the planner's input; None when unknown.
        ignored: what of the metric and the preferences the planner was not given, as readable text.
        domain_pddl: the domain that the planner was given, if it is not the state's.
        problem_pddl: the problem that the planner was given, if it is not the state's.
        value: the value of the metric, if the planner stated it in a text that was read.
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

    def __post_init__(self) -> None:
        steps = expect_tuple(self.steps, PlanStep, "the steps of a Plan")
        if steps is not self.steps:
            object.__setattr__(self, "steps", steps)
        expect(self.engine, str, "the engine of a Plan")
        expect(self.status, str, "the status of a Plan")
        for name in ("problem_hash", "domain_pddl", "problem_pddl"):
            optional_text(getattr(self, name), f"the {name} of a Plan", InvalidKnowledgeError)
        ignored = expect_tuple(self.ignored, str, "the ignored of a Plan")
        if ignored is not self.ignored:
            object.__setattr__(self, "ignored", ignored)
        if self.revision is not None:
            whole_number(self.revision, "the revision of a Plan", error=InvalidKnowledgeError)
        if self.value is not None:
            check_number(self.value, "the value of a Plan")

    @classmethod
    def read(cls, source: str | os.PathLike[str]) -> Plan:
        """Read a plan that another program wrote.

        These formats are known, in any case, with comments (`;`) and line ends of any system: of
        VAL; the plan files and the log of Fast Downward; the logs of POPF, OPTIC, Temporal Fast
        Downward and ENHSP; what unified-planning's `PDDLWriter` writes, and the `str` of its plans;
        `str` of a `Plan`, and what `kant-sql plan` prints. Of several plans in a log, the last is
        read: it is the best.

        Args:
            source: a path, or the text: a string with a line break, or one that begins with `(`,
                `;`, or a time and a colon.

        Returns:
            The plan. `engine` is the planner, if the text names it (`kant-sql plan`) or only one
            writes such a text (Fast Downward); else it is empty. `status` is `solved_satisficing`,
            unless the text says `solved_optimally`. `value` is the metric or cost that is stated.
            `revision` is None: a plan is recorded as one of the head.

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
        text = read_plan(source)
        steps = tuple(PlanStep(*step) for step in text.steps)
        return cls(steps, text.engine, text.status, value=text.value)

    def __str__(self) -> str:
        return "".join(f"{step}\n" for step in self.steps)

    def _repr_html_(self) -> str:
        return html.listing(self.steps, "step")


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
    # A lone surrogate has no UTF-8; such a text is not PDDL.
    return sha256((domain + problem).encode(errors="surrogatepass")).hexdigest()
