"""What to do where no engine of unified-planning finds a plan."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Collection, Iterable, Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from unified_planning.environment import Environment

WAYS_OUT = (
    "Plan.read(text) takes the plan of a program outside, and in a branch, kb.branch(), you can "
    "relax the goal or the conditions and plan again"
)
_TEMPORAL, _NUMERIC = ("aries", "tamer", "lpg"), ("enhsp", "tamer", "aries")
_LOGICAL = ("fast-downward", "enhsp")
# Engines that unified-planning lists for features; an engine that is installed is asked itself.
_KNOWN_FOR: Mapping[str, tuple[str, ...]] = {
    "CONTINUOUS_TIME": _TEMPORAL,
    "DURATION_INEQUALITIES": ("aries", "tamer"),
    "INTERMEDIATE_CONDITIONS_AND_EFFECTS": ("aries", "tamer"),
    "TIMED_EFFECTS": ("aries", "tamer"),
    "TIMED_GOALS": ("aries", "tamer"),
    "NUMERIC_FLUENTS": _NUMERIC,
    "REAL_FLUENTS": _NUMERIC,
    "INT_FLUENTS": _NUMERIC,
    "SIMPLE_NUMERIC_PLANNING": _NUMERIC,
    "GENERAL_NUMERIC_PLANNING": ("enhsp", "tamer"),
    "INCREASE_EFFECTS": _NUMERIC,
    "DECREASE_EFFECTS": _NUMERIC,
    "PROCESSES": ("enhsp",),
    "EVENTS": ("enhsp",),
    "INCREASE_CONTINUOUS_EFFECTS": ("enhsp",),
    "DECREASE_CONTINUOUS_EFFECTS": ("enhsp",),
    "OBJECT_FLUENTS": ("aries", "tamer"),
    "ACTIONS_COST": ("fast-downward-opt", "enhsp"),
    "CONDITIONAL_EFFECTS": _LOGICAL,
    "DISJUNCTIVE_CONDITIONS": _LOGICAL,
    "EXISTENTIAL_CONDITIONS": _LOGICAL,
    "UNIVERSAL_CONDITIONS": _LOGICAL,
    "NEGATIVE_CONDITIONS": _LOGICAL,
}


def packages() -> Mapping[str, str]:
    """Return the package of PyPI of each engine that unified-planning knows."""
    from unified_planning.engines.factory import DEFAULT_ENGINES

    modules = {name: module.split(".")[0] for name, (module, _) in DEFAULT_ENGINES.items()}
    return {
        name: module.replace("_", "-")
        for name, module in modules.items()
        if module.startswith("up_")
    }


def import_fault(engine: str) -> str | None:
    """Return why an engine whose package is installed cannot be imported; None without one."""
    from unified_planning.engines.factory import DEFAULT_ENGINES

    module, name = DEFAULT_ENGINES.get(engine, ("", ""))
    if not module or importlib.util.find_spec(module.split(".")[0]) is None:
        return None
    try:
        getattr(importlib.import_module(module), name)
    except Exception as error:  # a package may fail in any way
        return f"{type(error).__name__}: {error}"
    return None


def absent(engine: str, planners: Iterable[str]) -> str:
    """Say why an engine that was asked for is not there."""
    fault = import_fault(engine)
    others = f"or choose one of {', '.join(planners)}"
    package = packages().get(engine)
    if fault is not None:
        return (
            f"engine {engine} is installed, but cannot be imported ({fault}); repair its package "
            f"{package}, {others}"
        )
    how = "install it" if package is None else f"run pip install {package}"
    return f"engine {engine} is not installed; {how}, {others}"


def unsupported(
    missing: Mapping[str, Collection[str]], suitable: Collection[str], environment: Environment
) -> str:
    """Say what the engines that were asked do not know, and which others would know it.

    Args:
        missing: the features that each engine lacks.
        suitable: engines that are installed and support the problem.
        environment: has the engines that are installed.
    """
    said = [
        f"{name} does not know {', '.join(sorted(features)).lower()}"
        for name, features in missing.items()
    ]
    features = {feature for found in missing.values() for feature in found}
    known = dict.fromkeys(
        engine for feature in sorted(features) for engine in _KNOWN_FOR.get(feature, ())
    )
    if suitable:
        said.append(f"{', '.join(suitable)} would do; choose it, or no engine")
    for engine in known:
        if engine in environment.factory.engines or engine in missing:
            continue
        fault = import_fault(engine)
        how = f"pip install {packages().get(engine)}"
        if fault is None:
            own = [one for one in sorted(features) if engine in _KNOWN_FOR.get(one, ())]
            said.append(f"{engine} knows {', '.join(own).lower()}: {how}")
        else:
            said.append(f"{engine} is installed, but cannot be imported ({fault})")
    return "; ".join(said) or "install one"
