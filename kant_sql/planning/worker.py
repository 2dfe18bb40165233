"""The process that runs engines of unified-planning: `python -m kant_sql.planning.worker FOLDER`.

It runs under `guard.py`, which ends it with the processes that engines start.
"""

from __future__ import annotations

import importlib.util
import math
import os
import pickle
import re
import sys
import tempfile
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple

from ..dto.formulas import Arithmetic, Assign, ContinuousTime, Node, Number, walk
from ..dto.lexical import fold
from ..errors import KantSqlError, NoPlanError, PlannerMissingError, UnsupportedConstructError
from ..pddl.document import Domain, Problem, formulas
from ..pddl.writer import write
from .commands import INVARIANTS, MISREAD, WAYS_OUT, ask_directly, configured
from .metrics import (
    MOST_EFFECTS,
    Variant,
    hinted,
    missing_compilation,
    refusal,
    variants,
    without_unread,
)
from .plan import OPTIMAL, SATISFICING, Plan, PlanStep
from .processes import PlannerProcess
from .solving import IMPROVING_SECONDS, Task
from .to_up import convert, convert_whole

if TYPE_CHECKING:
    from unified_planning.engines.results import PlanGenerationResult
    from unified_planning.environment import Environment
    from unified_planning.model import Problem as UpProblem
    from unified_planning.plans import ActionInstance
    from unified_planning.plans import Plan as UpPlan

    from .names import UpNames


def engine_parameters(name: str, improving: float | None = None) -> dict[str, object]:
    """Return the parameters of an engine that improves its plan for some seconds."""
    if improving is not None and name == "fast-downward":
        return {"fast_downward_translate_options": [*INVARIANTS]}
    if improving is not None and name == "enhsp-any":
        return {"params": f"-h hadd -s gbfs -timeout {max(1, round(improving))}"}
    if name != "aries":
        return {}
    from up_aries.solver import _find_executable

    found = _find_executable()
    if " " not in found:
        return {}
    link = Path(tempfile.mkdtemp(prefix="aries-"), "aries")
    link.symlink_to(found)
    return {"executable": str(link)}


PREFERRED_GOALS = ("oversubscription[fast-downward]", "oversubscription[enhsp]")
# These engines solve the problem once for each subset of the goals.
MOST_PREFERRED_GOALS = 5
# Features that engines wrongly claim to support. Fast Downward makes axioms of quantifiers, which
# its heuristic LM-cut does not support. Aries wants constants as costs of actions.
OVERSTATED = {
    "fast-downward-opt": {"UNIVERSAL_CONDITIONS", "EXISTENTIAL_CONDITIONS"},
    "aries": {"STATIC_FLUENTS_IN_ACTIONS_COST"},
}
_LOGIC = {"CONDITIONAL_EFFECTS", "NEGATIVE_CONDITIONS", "DISJUNCTIVE_CONDITIONS"}
_QUANTIFIERS = {"UNIVERSAL_CONDITIONS", "EXISTENTIAL_CONDITIONS"}
_NUMBERS = {"NUMERIC_FLUENTS", "REAL_FLUENTS", "INT_FLUENTS", "SIMPLE_NUMERIC_PLANNING"}
_NUMBERS |= {"INCREASE_EFFECTS", "DECREASE_EFFECTS"}
_TIME = {"CONTINUOUS_TIME", "DURATION_INEQUALITIES", "INTERMEDIATE_CONDITIONS_AND_EFFECTS"}
_TIME |= {"TIMED_EFFECTS", "TIMED_GOALS"}
_PROCESSES = {"PROCESSES", "EVENTS", "INCREASE_CONTINUOUS_EFFECTS", "DECREASE_CONTINUOUS_EFFECTS"}
# Features of known engines, which may be absent; an installed engine is asked itself.
KNOWN = {
    "aries": _TIME | _NUMBERS | {"OBJECT_FLUENTS"},
    "enhsp": _LOGIC | _QUANTIFIERS | _NUMBERS | _PROCESSES,
    "fast-downward": _LOGIC | _QUANTIFIERS,
    "fast-downward-opt": {"ACTIONS_COST"},
    "lpg": {"CONTINUOUS_TIME"},
    "tamer": _TIME | _NUMBERS | {"OBJECT_FLUENTS", "GENERAL_NUMERIC_PLANNING"},
}
KNOWN["enhsp"] |= {"GENERAL_NUMERIC_PLANNING", "ACTIONS_COST"}
# The features that compilers remove, in the order of trial.
REMOVALS = {
    "up_trajectory_constraints_remover": {"TRAJECTORY_CONSTRAINTS", "STATE_INVARIANTS"},
    "up_usertype_fluents_remover": {"OBJECT_FLUENTS"},
    "up_quantifiers_remover": _QUANTIFIERS | {"FORALL_EFFECTS"},
    "up_conditional_effects_remover": {"CONDITIONAL_EFFECTS"},
    "up_disjunctive_conditions_remover": {"DISJUNCTIVE_CONDITIONS"},
    "up_negative_conditions_remover": {"NEGATIVE_CONDITIONS"},
    "fast-downward-reachability-grounder": {"STATIC_FLUENTS_IN_ACTIONS_COST"},
    "up_grounder": {"STATIC_FLUENTS_IN_ACTIONS_COST"},
}
# Features that stay after a compilation, though compilers do not list them.
_UNTOUCHED = {"UNDEFINED_INITIAL_NUMERIC"}


class EngineProblem(NamedTuple):
    """A problem as an engine receives it."""

    problem: UpProblem
    # Maps its actions back to the original ones, last compilation first.
    back: tuple[Callable[[ActionInstance], ActionInstance | None], ...] = ()


def candidates(problem: UpProblem, improves: bool = False) -> tuple[str, ...]:
    """Return the names of the engines to try, in order; `improves` asks for better plans."""
    kind = problem.kind
    if kind.has_oversubscription():
        goals = sum(len(metric.goals) for metric in problem.quality_metrics)
        return PREFERRED_GOALS if goals <= MOST_PREFERRED_GOALS else ()
    if kind.has_continuous_time():
        return "aries", "enhsp"
    numeric = "enhsp-any" if improves else "enhsp"
    if kind.has_real_fluents() or kind.has_int_fluents() or kind.has_processes():
        return numeric, "aries"
    return "fast-downward", "pyperplan", numeric, "aries"


class Engines:
    """The engines of unified-planning; each is imported on first use, because all take long."""

    def __init__(self) -> None:
        from unified_planning.engines.factory import DEFAULT_ENGINES, DEFAULT_META_ENGINES
        from unified_planning.environment import get_environment

        self._known, self._metas = {**DEFAULT_ENGINES}, DEFAULT_META_ENGINES
        DEFAULT_ENGINES.clear()
        try:
            self.environment: Environment = get_environment()
        finally:
            DEFAULT_ENGINES.update(self._known)
        self.environment.credits_stream = None
        self._known["up_trajectory_constraints_remover"] = (
            "unified_planning.engines.compilers.trajectory_constraints_remover",
            "TrajectoryConstraintsRemover",
        )
        self._faults: dict[str, str] = {}

    def find(self, name: str) -> Any:
        """Return an engine's class; None if it is missing."""
        factory = self.environment.factory
        meta, _, base = name.removesuffix("]").partition("[")
        if name not in factory.engines:
            if base and meta in self._metas and self.find(base):
                factory.add_meta_engine(meta, *self._metas[meta])
            elif name in self._known and name not in self._faults:
                try:
                    factory.add_engine(name, *self._known[name])
                except Exception as error:  # a package may fail in any way
                    self._faults[name] = f"{type(error).__name__}: {error}"
        return factory.engine(name) if name in factory.engines else None

    def planners(self) -> list[str]:
        """Return the names of the installed planners."""
        for name in self._known:
            self.find(name)
        engines = self.environment.factory.engines
        return [name for name in engines if self.find(name).is_oneshot_planner()]

    def how(self, name: str) -> str:
        """Return how to get a missing engine."""
        self.find(name)
        module = self._known.get(name, ("",))[0].partition(".")[0]
        package = module.replace("_", "-")
        if module and importlib.util.find_spec(module):
            fault = self._faults[name]
            return f"is installed, but cannot be imported ({fault}); repair its package {package}"
        how = f"run pip install {package}" if module.startswith("up_") else "install it"
        return f"is not installed; {how}"

    def lacking(self, missing: Mapping[str, Collection[str]], suitable: Collection[str]) -> str:
        """List the features that the asked engines lack, and other engines that have them."""
        said = [
            f"{name} does not know {', '.join(sorted(features)).lower()}"
            for name, features in missing.items()
        ]
        if {"REAL_TYPE_DURATIONS"} in missing.values():
            said.append("give all durations as whole numbers, for example in tenths of a second")
        if suitable:
            said.append(f"{', '.join(suitable)} would do; choose it, or no engine")
        features = {feature for found in missing.values() for feature in found}
        for engine, known in KNOWN.items():
            own = ", ".join(sorted(features & known)).lower()
            if own and engine not in missing and not self.find(engine):
                said.append(f"{engine} knows {own}: {engine} {self.how(engine)}")
        return "; ".join(said) or "install one"

    def form_for(
        self, form: EngineProblem, engine: str, most_effects: int = MOST_EFFECTS
    ) -> EngineProblem | None:
        """Compile a problem until an engine supports it; None if that is impossible."""
        from unified_planning.engines import CompilationKind
        from unified_planning.exceptions import UPException
        from unified_planning.model import ProblemKind

        for name, features in REMOVALS.items():
            missing = self.missing_features(form.problem, engine)
            if not missing:
                return form
            compiler, kind = missing & features and self.find(name), form.problem.kind
            if not compiler or not compiler.supports(
                ProblemKind(kind.features - _UNTOUCHED, version=kind.version)
            ):
                continue
            effects = conditional_effects(form.problem)
            if "CONDITIONAL_EFFECTS" in features and effects > most_effects:
                return None
            compiles = next(filter(compiler.supports_compilation, CompilationKind))
            made = compiler()
            made.skip_checks = True
            with suppress(UPException):
                done = made.compile(form.problem, compiles)
                form = EngineProblem(done.problem, (done.map_back_action_instance, *form.back))
        return None if self.missing_features(form.problem, engine) else form

    def missing_features(self, problem: UpProblem, engine: str) -> set[str]:
        """Return the features of a problem that an engine does not support."""
        made, kind = self.find(engine), problem.kind
        wrong: set[str] = kind.features & OVERSTATED.get(engine, set())
        if made.supports(kind):
            return wrong
        features: set[str] = kind.features - made.supported_kind().features
        return features | wrong or {"PROBLEM_KIND"}


def conditional_effects(problem: UpProblem) -> int:
    """Return the largest number of conditional effects of an action."""
    found = [getattr(action, "conditional_effects", ()) for action in problem.actions]
    counts = (sum(map(len, one.values())) if isinstance(one, dict) else len(one) for one in found)
    return max(counts, default=0)


def numbers_are_integers(domain: Domain, problem: Problem) -> bool:
    """Return whether all numbers stay integers in any plan."""
    values = [value.value for value in problem.values]
    nodes: list[Node] = [*formulas(domain, problem), *problem.timed, *values]
    for node in walk(*nodes):
        match node:
            case Number(value) if value != value.to_integral_value():
                return False
            case Arithmetic("/") | Assign("scale-down") | ContinuousTime():
                return False
    return True


class _Spared(ModuleType):
    """Replaces a module until an engine uses more of it than classes in annotations."""

    def __init__(self, name: str, path: Iterable[str], *annotate: str) -> None:
        super().__init__(name)
        self.__path__ = [*path]
        for one in annotate:

            def make(_: type, *given: object, _name: str = one, **options: object) -> object:
                return self.__getattr__(_name)(*given, **options)

            setattr(self, one, type(one, (), {"__new__": make}))

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules[self.__name__] is self:
            del sys.modules[self.__name__]
        return getattr(importlib.import_module(self.__name__), name)


def _spare_imports() -> None:
    """Save seconds: unified-planning imports networkx, and scipy by ConfigSpace, but uses none."""
    # Only its own readers and some engines need pyparsing.
    import unified_planning

    for name, *annotate in (
        ("ConfigSpace", "ConfigurationSpace"),
        ("networkx", "DiGraph"),
        ("unified_planning.io", "PDDLWriter", "PDDLReader"),
    ):
        found = None if name in sys.modules else importlib.util.find_spec(name)
        if found is not None:
            places = found.submodule_search_locations or ()
            sys.modules[name] = _Spared(name, places, *annotate)
    unified_planning.io = sys.modules["unified_planning.io"]


def _mend_grounder() -> None:
    """Apply static conditions one by one: unified-planning 1.3 fails if two exclude one object."""
    from unified_planning.engines.compilers.grounder import GrounderHelper

    purge = GrounderHelper._purge_items_list

    def mended(self: GrounderHelper, items_list: Any, params: Any, conds: Any) -> Any:
        for condition in conds:
            items_list = purge(self, items_list, params, [condition])
        return items_list

    GrounderHelper._purge_items_list = mended


def _end_with_error(planner: Any, name: str) -> None:
    """Make a planner return its errors, because nothing else would end its thread's results."""
    from unified_planning.engines import PlanGenerationResult, PlanGenerationResultStatus

    solve = getattr(planner, "_solve", None)
    if solve is None:
        return

    def guarded(*arguments: object, **options: object) -> PlanGenerationResult:
        try:
            return solve(*arguments, **options)
        except Exception:
            return PlanGenerationResult(PlanGenerationResultStatus.INTERNAL_ERROR, None, name)

    planner._solve = guarded


class Search:
    """The search for a plan, engine by engine."""

    def __init__(self, task: Task) -> None:
        # Engines refuse, or are chosen for, numbers even if no action needs them.
        domain, problem = without_unread(task.domain, task.problem)
        self._task = task._replace(domain=domain, problem=problem)
        self._started = time.monotonic()
        self._engines = Engines()
        self._environment = self._engines.environment
        _mend_grounder()
        self._names: UpNames | None = None
        self._failures = {**task.failures}
        self._missing: dict[str, set[str]] = {}
        # Deviations from the request, which the caller logs.
        self.fallbacks: list[str] = []

    def run(self) -> Plan | NoPlanError:
        """Try the engines in turn."""
        engine = self._task.engine
        if engine is not None and not self._engines.find(engine):
            how = self._engines.how(engine)
            others = ", ".join((*self._engines.planners(), *configured(self._task.engines)))
            raise PlannerMissingError(f"engine {engine} {how}, or choose one of {others}")
        domain, problem = self._task.domain, self._task.problem
        if self._task.strict:
            # It refuses here as a conversion does, in the same words.
            convert_whole(domain, problem, self._environment)
        error: UnsupportedConstructError | None = None
        asked = False
        for variant in variants(domain, problem, self._task.is_costed):
            if variant.ignored and self._task.strict:
                if self._failures or not any(self._suitable(variant, self._task.engine)):
                    return self._failed()
                raise refusal(variant.ignored)
            try:
                plan = self._solve(variant)
            except UnsupportedConstructError as refused:
                error = refused
                continue
            asked = True
            if plan is not None:
                return plan
            if "unsolvable_proven" in self._failures.values():
                break
        if error is not None and not asked:
            raise hinted(error, problem)
        return self._failed()

    def _solve(self, variant: Variant) -> Plan | None:
        try:
            plan = self._ask_directly(variant)
        except NoPlanError as error:
            plan = None
            if error.status == "unsolvable_proven":
                return None
        if plan is not None:
            return plan
        failures = self._failures
        tried = {name for name, why in failures.items() if why.partition(" ")[0] not in MISREAD}
        for form, name in self._choices(variant, self._task.engine):
            if name in tried:
                continue
            plan = self._ask(name, form, variant)
            if plan is not None:
                failures.pop(name, None)
                if why := ", ".join(map(": ".join, failures.items())):
                    said = f"{name} was asked because others found no plan ({why})"
                    self.fallbacks.append(said)
                return plan
            if name in self._failures:
                tried.add(name)
            if self._failures.get(name) == "unsolvable_proven":
                return None
        return None

    def _ask_directly(self, variant: Variant) -> Plan | None:
        """Give an engine a variant directly, if it reads it."""
        if variant.problem is self._task.problem:  # It was asked before this process.
            return None
        left = self._remaining()
        improving = min(IMPROVING_SECONDS, left / 2) if variant.improves else 0
        if improving and not self._task.strict:
            # The other half is for a plan without soft goals.
            left /= 2
        plans = ask_directly(
            variant.domain,
            variant.problem,
            self._task.engine,
            improving,
            self._failures,
            PlannerProcess(tempfile.mkdtemp()),
            time.monotonic() + left,
        )
        for plan in plans:
            return self._given(replace(plan, value=None), variant)
        return None

    def _choices(self, variant: Variant, engine: str | None) -> Iterator[tuple[EngineProblem, str]]:
        """Yield the forms of a variant, each with the installed engines to ask."""
        # First real numbers, then integers if they suffice: most cost planners want integers.
        forms = [False]
        if numbers_are_integers(variant.domain, variant.problem):
            forms = [True, False] if variant.improves else [False, True]
        for is_whole in forms:
            made = convert(variant.domain, variant.problem, self._environment, is_whole)
            self._names, form = made.names, EngineProblem(made.problem)
            names = (engine,) if engine else candidates(form.problem, variant.improves)
            yield from ((form, name) for name in names if self._engines.find(name))

    def _suitable(self, variant: Variant, engine: str | None) -> Iterator[str]:
        """Yield engines that support a variant."""
        with suppress(UnsupportedConstructError):
            for form, name in self._choices(variant, engine):
                with suppress(Exception):
                    if self._engines.form_for(form, name) is not None:
                        yield name

    def _failed(self) -> NoPlanError:
        if self._failures:
            tried = ", ".join(f"{name}: {why}" for name, why in self._failures.items())
            status = list(self._failures.values())[-1].split(" ")[0]
            return NoPlanError(f"no plan was found ({tried}); {WAYS_OUT}", status)
        whose, others = "installed engine", dict[str, None]()
        if self._task.engine is not None:
            whole = next(iter(variants(self._task.domain, self._task.problem)))
            whose, others = "engine that was asked", dict.fromkeys(self._suitable(whole, None))
        reasons = self._engines.lacking(self._missing, others)
        hint = missing_compilation(self._task.problem)
        message = f"no {whose} supports the problem: {reasons}{hint}; {WAYS_OUT}"
        return NoPlanError(message, "unsupported_problem")

    def _ask(self, name: str, form: EngineProblem, variant: Variant) -> Plan | None:
        try:
            made = self._engines.form_for(form, name, variant.most_effects)
            result = made and self._result(name, made.problem, variant.improves)
        except Exception as error:  # compilers and engines may fail in any way; the next is tried
            self._failures[name] = f"internal_error ({type(error).__name__}: {error})"
            return None
        if made is None or result is None:
            missing = self._engines.missing_features(form.problem, name)
            # The remaining features after all compilations, for the form that lacks the fewest.
            missing = missing.difference(*REMOVALS.values()) or missing
            self._missing[name] = min(self._missing.get(name, missing), missing, key=len)
            return None
        if result.plan is None:
            self._failures[name] = _failure(name, result)
            return None
        plan = result.plan
        for back in made.back:
            plan = plan.replace_action_instances(back)
        # Also the status of a search that was interrupted while it improved its plan.
        status = OPTIMAL if result.status.name.lower() == OPTIMAL else SATISFICING
        return self._given(Plan(tuple(self._steps(plan, form.problem)), name, status), variant)

    def _given(self, plan: Plan, variant: Variant) -> Plan:
        """Return a plan of the original problem, with the planner's input."""
        named = ((step, variant.steps.get(fold(step.action), step.action)) for step in plan.steps)
        steps = tuple(replace(step, action=name) for step, name in named if name is not None)
        found = replace(plan, steps=steps, ignored=self._ignored(variant))
        if variant.problem is self._task.problem:
            return found
        given = write(variant.domain), write(variant.problem)
        return replace(found, domain_pddl=given[0], problem_pddl=given[1])

    def _result(self, name: str, problem: UpProblem, improves: bool) -> PlanGenerationResult:
        factory = self._environment.factory
        improving = min(IMPROVING_SECONDS, self._remaining() / 2) if improves else None
        if improves and factory.engine(name).is_anytime_planner():
            parameters, best = engine_parameters(name, improving), None
            # ENHSP watches the time itself, so it can print its last plan.
            timeout = None if name == "enhsp-any" else improving
            with factory.AnytimePlanner(name=name, params=parameters) as planner:
                _end_with_error(planner, name)
                for result in planner.get_solutions(problem, timeout=timeout):
                    best = result if result.plan is not None else best
            if best is not None:
                return best
        parameters = engine_parameters(name, None if name == "enhsp-any" else improving)
        timeout = None
        if improves and math.isfinite(self._task.timeout) and not self._task.strict:
            # The other half is for a plan without soft goals.
            timeout = self._remaining() / 2
        with factory.OneshotPlanner(name=name, params=parameters) as planner:
            return planner.solve(problem, timeout=timeout)

    def _remaining(self) -> float:
        """Return the seconds until the timeout."""
        return max(self._task.timeout - (time.monotonic() - self._started), 1.0)

    def _ignored(self, variant: Variant) -> tuple[str, ...]:
        """Return the parts that a variant leaves out, with the reason."""
        if variant.problem.metric is not None or not self._failures:
            return variant.ignored
        reason = "no plan was found with it"
        return tuple(f"{text.rpartition(': ')[0]}: {reason}" for text in variant.ignored)

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
                self._names.action_of[instance.action.name],
                tuple(argument.object().name for argument in instance.actual_parameters),
                _decimal(duration),
            )
            for start, instance, duration in timed
        ]


_JAVA_ERROR = re.compile(r"(?:\w+\.)+(\w*(?:Exception|Error)\b.*)")


def _failure(engine: str, result: PlanGenerationResult) -> str:
    """Return the status of a result without a plan."""
    status: str = result.status.name.lower()
    said = "\n".join(message.message for message in result.log_messages or ())
    if engine.startswith("enhsp"):
        if error := _JAVA_ERROR.search(said):
            status = "memout" if error[1].startswith("OutOfMemory") else "internal_error"
            return f"{status} ({error[1]})"
        # It also reports this when it gives up or cannot read the problem.
        status = "unsolvable_incompletely" if status == "unsolvable_proven" else status
    # Indented lines are the context, of Python or of aries.
    lines = [line for line in said.splitlines() if line.strip() and not line[0].isspace()]
    return f"{status} ({lines[-1][:200]})" if status == "internal_error" and lines else status


def _decimal(value: Fraction | None) -> Decimal | None:
    if value is None:
        return None
    number = Decimal(value.numerator) / Decimal(value.denominator)
    return Decimal(format(round(number, 6).normalize(), "f"))


def main(directory: str) -> None:
    """Solve the task in a directory, and write the result there."""
    task: Task = pickle.loads(Path(directory, "task").read_bytes())
    outcome: Plan | KantSqlError
    fallbacks: list[str] = []
    _spare_imports()
    try:
        search = Search(task)
        outcome, fallbacks = search.run(), search.fallbacks
    except (PlannerMissingError, UnsupportedConstructError) as error:
        outcome = error
    except KantSqlError as error:
        outcome = NoPlanError(str(error), "unsupported_problem")
    made = Path(directory, "result.part")
    made.write_bytes(pickle.dumps((outcome, fallbacks)))
    made.rename(Path(directory, "result"))
    # A thread of an engine that is still running would keep the process.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1])
