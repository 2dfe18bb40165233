"""Documents that stand for others: plugins compile what planners do not know of a metric."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from ..errors import UnsupportedConstructError
from ..pddl.document import Domain, Problem
from ..plugins import Plugins

# Conditional effects of an action that are compiled away: each doubles its copies.
MOST_EFFECTS = 10


@dataclass(frozen=True)
class Variant:
    """Documents that stand for others, with fewer or other constructs.

    Attributes:
        steps: the name of the original action of each action that was added, by folded name; None
            for a step that is left out of plans.
        ignored: what of the metric and the preferences is not in them, as readable text.
        most_effects: how many conditional effects of an action may be compiled away for an engine.
    """

    domain: Domain
    problem: Problem
    steps: Mapping[str, str | None] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    most_effects: int = MOST_EFFECTS


class Compilation(Protocol):
    """A plugin of the group `kant_sql.compilations`."""

    def __call__(self, domain: Domain, problem: Problem) -> Iterator[Variant]:
        """Yield stand-ins for documents with a metric, the most faithful first."""


COMPILATIONS: Plugins[Compilation] = Plugins("kant_sql.compilations")


def variants(domain: Domain, problem: Problem) -> Iterator[Variant]:
    """Yield the documents, then stand-ins for a metric that planners do not know.

    `to_unified_planning` and `solve` try these in turn.
    """
    yield Variant(domain, problem)
    if problem.metric is not None:
        for name in COMPILATIONS.names():
            compilation = COMPILATIONS.get(name)
            if compilation is not None:
                yield from compilation(domain, problem)


def missing_compilation(problem: Problem) -> str:
    """Say what may help where planners do not take a metric as it is; empty where nothing may."""
    if problem.metric is None or COMPILATIONS.names():
        return ""
    return (
        f"; no plugin of the group {COMPILATIONS.group} is installed, which could compile the "
        "metric and the preferences"
    )


def hinted(error: UnsupportedConstructError, problem: Problem) -> UnsupportedConstructError:
    """Add to an error what may help."""
    return UnsupportedConstructError(f"{error}{missing_compilation(problem)}")


def refusal(ignored: Sequence[str]) -> UnsupportedConstructError:
    """Make the error for what cannot be given to a planner."""
    return UnsupportedConstructError(
        f"planners cannot be given all soft goals: {'; '.join(ignored)}; leave these out"
    )
