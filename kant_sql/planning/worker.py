"""The process in which a planner is asked: `python -m kant_sql.planning.worker DIRECTORY`.

All that an engine starts stays in this process's group, which ends as a whole: when the plan is
there, when time is up, and when the process that asked is gone.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import threading
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import KantSqlError, PlannerMissingError
from ..pddl.document import Domain, Problem
from .aries import engine_parameters
from .engines import Form, candidates, form_for, forms, missing_features
from .plan import Plan, PlanStep

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Problem as UpProblem
    from unified_planning.plans import Plan as UpPlan

    from .names import Names

_PLACES = 6


class GroupedProcess(subprocess.Popen[bytes]):
    """A process that stays in the group: engines start theirs in sessions of their own."""

    def __init__(self, *arguments: object, **options: object) -> None:
        options.pop("start_new_session", None)
        super().__init__(*arguments, **options)  # type: ignore[call-overload]


class Search:
    """The search for a plan, engine by engine."""

    def __init__(self, domain: Domain, problem: Problem, engine: str | None) -> None:
        """Prepare the search.

        Args:
            domain: the domain.
            problem: the problem.
            engine: the engine to ask; None for all that suit.
        """
        from unified_planning.environment import get_environment

        self._domain, self._problem, self._engine = domain, problem, engine
        self._environment: Environment = get_environment()
        self._environment.credits_stream = None
        self._environment.factory.add_engine(
            "trajectory-constraints-remover",
            "unified_planning.engines.compilers.trajectory_constraints_remover",
            "TrajectoryConstraintsRemover",
        )
        self._names: Names | None = None
        self._failures: dict[str, str] = {}
        self._missing: dict[str, set[str]] = {}
        # What the caller did not ask for, and is to hear of.
        self.fallbacks: list[str] = []

    def run(self) -> Plan | tuple[str, str, str]:
        """Ask the engines in turn.

        Returns:
            The first plan; else the kind of error, its message and the status.
        """
        installed = self._environment.factory.engines
        if self._engine is not None and self._engine not in installed:
            planners = ", ".join(_planners(installed, self._environment))
            raise PlannerMissingError(
                f"engine {self._engine} is not installed; install it, or choose one of {planners}"
            )
        for form in forms(self._domain, self._problem, self._convert):
            names = (self._engine,) if self._engine else candidates(form.problem)
            for name in names:
                if name not in installed or name in self._failures:
                    continue
                plan = self._ask(name, form)
                if plan is not None:
                    self._note_fallbacks(name, form)
                    return plan
                if self._failures.get(name) == "unsolvable_proven":
                    return self._failed()
        return self._failed()

    def _note_fallbacks(self, name: str, form: Form) -> None:
        if self._failures:
            failed = ", ".join(f"{engine}: {why}" for engine, why in self._failures.items())
            self.fallbacks.append(f"{name} was asked because others found no plan ({failed})")
        if self._problem.metric is not None and not form.problem.quality_metrics:
            self.fallbacks.append(f"{name} was asked without the metric: the plan is not measured")

    def _failed(self) -> tuple[str, str, str]:
        if self._failures:
            tried = ", ".join(f"{name}: {why}" for name, why in self._failures.items())
            status = list(self._failures.values())[-1].split(" ")[0]
            return "NoPlanError", f"no plan was found ({tried})", status
        reasons = "; ".join(
            f"{name} does not know {', '.join(sorted(features)).lower()}"
            for name, features in self._missing.items()
        )
        message = f"no installed engine supports the problem: {reasons or 'install one'}"
        return "NoPlanError", message, "unsupported_problem"

    def _convert(self, problem: Problem, integers: bool) -> UpProblem:
        from .up_problem import convert

        context = convert(self._domain, problem, self._environment, integers)
        self._names = context.names
        return context.problem

    def _ask(self, name: str, form: Form) -> Plan | None:
        made = form_for(form, name, self._environment)
        if made is None:
            missing = missing_features(form.problem, name, self._environment)
            self._missing.setdefault(name, missing)
            return None
        try:
            factory, parameters = self._environment.factory, engine_parameters(name)
            with factory.OneshotPlanner(name=name, params=parameters) as planner:
                result = planner.solve(made.problem)
        except Exception as error:  # an engine may fail in any way; the next one is asked
            self._failures[name] = f"internal_error ({type(error).__name__}: {error})"
            return None
        if result.plan is None:
            self._failures[name] = _status(name, result.status.name.lower())
            return None
        plan = result.plan
        for back in made.back:
            plan = plan.replace_action_instances(back)
        return Plan(tuple(self._steps(plan, form.problem)), name, result.status.name.lower())

    def _steps(self, plan: UpPlan, problem: UpProblem) -> list[PlanStep]:
        from unified_planning.plans import PlanKind

        if plan.kind == PlanKind.TIME_TRIGGERED_PLAN:
            timed = sorted(plan.timed_actions, key=lambda step: step[0])
        else:
            sequential = plan.convert_to(PlanKind.SEQUENTIAL_PLAN, problem)
            timed = [(None, instance, None) for instance in sequential.actions]
        assert self._names is not None
        return [
            PlanStep(
                _decimal(start),
                self._names.action_of(instance.action.name),
                tuple(argument.object().name for argument in instance.actual_parameters),
                _decimal(duration),
            )
            for start, instance, duration in timed
        ]


def _planners(installed: list[str], environment: Environment) -> list[str]:
    return [name for name in installed if environment.factory.engine(name).is_oneshot_planner()]


def _status(engine: str, status: str) -> str:
    # ENHSP has nothing else to say when it gives up, or cannot read the problem.
    if engine == "enhsp" and status == "unsolvable_proven":
        return "unsolvable_incompletely"
    return status


def _decimal(value: Fraction | None) -> Decimal | None:
    if value is None:
        return None
    number = Decimal(value.numerator) / Decimal(value.denominator)
    return Decimal(format(round(number, _PLACES).normalize(), "f"))


def _end_with_parent() -> None:
    sys.stdin.buffer.read()
    _end_group()


def _end_group() -> None:
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(0)


def main(directory: str) -> None:
    """Solve the task in a directory, and put the outcome there.

    Args:
        directory: where the task is.
    """
    threading.Thread(target=_end_with_parent, daemon=True).start()
    subprocess.Popen = GroupedProcess  # type: ignore[misc,assignment]
    domain, problem, engine = pickle.loads(Path(directory, "task").read_bytes())
    outcome: Plan | tuple[str, str, str]
    fallbacks: list[str] = []
    try:
        search = Search(domain, problem, engine)
        outcome, fallbacks = search.run(), search.fallbacks
    except KantSqlError as error:
        outcome = (type(error).__name__, str(error), "unsupported_problem")
    made = Path(directory, "result.part")
    made.write_bytes(pickle.dumps((outcome, fallbacks)))
    made.rename(Path(directory, "result"))
    _end_group()


if __name__ == "__main__":
    main(sys.argv[1])
