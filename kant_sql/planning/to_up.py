"""From documents to unified-planning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..arguments import expect
from ..errors import InvalidArgumentError
from ..pddl.document import Domain, Problem
from .extra import require_unified_planning
from .plan import check_documents

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Problem as UpProblem


def to_unified_planning(
    domain: Domain, *, problem: Problem, environment: Environment | None = None
) -> UpProblem:
    """Make a problem of unified-planning that means what the documents mean.

    Names stay as they are, but where unified-planning takes no two elements of one name: then
    predicates, functions and types have their category appended (`move_predicate`). Predicates
    are false at first unless the problem says else. Some constructs are rewritten, exactly:
    an `either` in a parameter becomes one action for each type, a derived predicate that does not
    rest on itself is replaced by what it follows from, `scale-up` and `scale-down` become
    assignments, `(at end ...)` among the constraints a goal, `?duration` the duration's value
    where that is fixed, and preferences in the goal that the metric counts, and nothing else, an
    oversubscription metric. Preferences that no metric counts are left out, for they change
    neither what is a plan nor how good it is.

    Args:
        domain: the domain.
        problem: the problem.
        environment: unified-planning's environment; by default its global one, as everywhere in
            unified-planning.

    Returns:
        The problem.

    Raises:
        PlannerMissingError: unified-planning is not installed.
        UnsupportedConstructError: something has no exact counterpart; the message names it and
            says where it is.
    """
    check_documents(domain, problem)
    require_unified_planning()
    from unified_planning.environment import Environment, get_environment

    if environment is not None:
        expect(environment, Environment, "the environment", InvalidArgumentError)
    from .up_problem import convert

    return convert(domain, problem, get_environment(environment)).problem
