"""Which engines of unified-planning may solve a problem, and in what form they are given it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from ..dto.formula import Arithmetic, Assign, ContinuousTime, Node, Number
from ..dto.node import walk
from ..errors import UnsupportedConstructError
from ..pddl.document import Domain, Problem

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Problem as UpProblem
    from unified_planning.plans import ActionInstance

TEMPORAL = ("aries", "enhsp")
NUMERIC = ("enhsp", "aries")
CLASSICAL = ("fast-downward", "pyperplan", "enhsp", "aries")
PREFERRED_GOALS = ("oversubscription[fast-downward]", "oversubscription[enhsp]")
# They ask for a plan for each subset of the goals.
MOST_PREFERRED_GOALS = 5
# What compiles a feature away, in the order in which that is done.
COMPILATIONS = (
    ("TRAJECTORY_CONSTRAINTS_REMOVING", {"TRAJECTORY_CONSTRAINTS", "STATE_INVARIANTS"}),
    ("USERTYPE_FLUENTS_REMOVING", {"OBJECT_FLUENTS"}),
    (
        "QUANTIFIERS_REMOVING",
        {"UNIVERSAL_CONDITIONS", "EXISTENTIAL_CONDITIONS", "FORALL_EFFECTS"},
    ),
    ("CONDITIONAL_EFFECTS_REMOVING", {"CONDITIONAL_EFFECTS"}),
    ("DISJUNCTIVE_CONDITIONS_REMOVING", {"DISJUNCTIVE_CONDITIONS"}),
    ("NEGATIVE_CONDITIONS_REMOVING", {"NEGATIVE_CONDITIONS"}),
)


@dataclass(frozen=True)
class Form:
    """A problem in the form that an engine is given it.

    Attributes:
        problem: the problem.
        back: what leads from its actions back to those it was made of, last first.
    """

    problem: UpProblem
    back: tuple[Callable[[ActionInstance], ActionInstance | None], ...] = field(default=())


def candidates(problem: UpProblem) -> tuple[str, ...]:
    """Name the engines to ask, in order.

    Args:
        problem: the problem.

    Returns:
        Their names in unified-planning, installed or not.
    """
    kind = problem.kind
    if kind.has_oversubscription():
        goals = sum(len(metric.goals) for metric in problem.quality_metrics)
        return PREFERRED_GOALS if goals <= MOST_PREFERRED_GOALS else ()
    if kind.has_continuous_time():
        return TEMPORAL
    if kind.has_real_fluents() or kind.has_int_fluents() or kind.has_processes():
        return NUMERIC
    return CLASSICAL


def form_for(form: Form, engine: str, environment: Environment) -> Form | None:
    """Bring a problem into a form that an engine supports.

    Args:
        form: the problem.
        engine: the engine's name in unified-planning.
        environment: unified-planning's environment.

    Returns:
        The problem, with what the engine does not know compiled away; None when that cannot be.
    """
    from unified_planning.engines import CompilationKind
    from unified_planning.exceptions import UPException

    for name, features in COMPILATIONS:
        missing = missing_features(form.problem, engine, environment)
        if not missing:
            return form
        if not missing & features:
            continue
        try:
            with environment.factory.Compiler(
                problem_kind=form.problem.kind, compilation_kind=CompilationKind[name]
            ) as compiler:
                made = compiler.compile(form.problem, CompilationKind[name])
        except UPException:
            return None
        form = replace(form, problem=made.problem, back=(made.map_back_action_instance, *form.back))
    return None if missing_features(form.problem, engine, environment) else form


def missing_features(problem: UpProblem, engine: str, environment: Environment) -> set[str]:
    """Find what a problem has and an engine does not know.

    Args:
        problem: the problem.
        engine: the engine's name in unified-planning.
        environment: unified-planning's environment.

    Returns:
        The features, by their names in unified-planning.
    """
    made = environment.factory.engine(engine)
    kind = problem.kind
    if made.supports(kind):
        return set()
    features: set[str] = kind.features - made.supported_kind().features
    return features or {"PROBLEM_KIND"}


def numbers_are_integers(domain: Domain, problem: Problem) -> bool:
    """Tell whether all numbers stay integers throughout any plan.

    Args:
        domain: the domain.
        problem: the problem.

    Returns:
        Whether all are written as integers, and nothing divides them.
    """
    nodes: list[Node] = [*problem.goal, *problem.constraints, *domain.constraints, *problem.timed]
    for action in domain.actions:
        nodes.extend((*action.duration, *action.condition, *action.effect))
    nodes.extend(rule.formula for rule in domain.derived)
    nodes.extend(value.value for value in problem.values)
    for node in walk(*nodes):
        match node:
            case Number(value) if value != value.to_integral_value():
                return False
            case Arithmetic("/") | Assign("scale-down") | ContinuousTime():
                return False
    return True


def forms(
    domain: Domain, problem: Problem, convert: Callable[[Problem, bool], UpProblem]
) -> Iterator[Form]:
    """Give the forms that a problem can be solved in, the most faithful first.

    Args:
        domain: the domain.
        problem: the problem.
        convert: what makes a problem of unified-planning; told whether numbers are integers.

    Yields:
        The problem; with integers, where all numbers are some; and the same without its metric.

    Raises:
        UnsupportedConstructError: something besides the metric has no exact counterpart.
    """
    measured = problem.metric is not None
    try:
        yield from _numbered(domain, problem, convert)
    except UnsupportedConstructError:
        if not measured:
            raise
    if measured:
        yield from _numbered(domain, replace(problem, metric=None), convert)


def _numbered(
    domain: Domain, problem: Problem, convert: Callable[[Problem, bool], UpProblem]
) -> Iterator[Form]:
    yield Form(convert(problem, False))
    if numbers_are_integers(domain, problem):
        yield Form(convert(problem, True))
