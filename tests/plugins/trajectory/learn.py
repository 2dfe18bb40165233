"""Learns the effects of actions from a folder of trajectories: `python learn.py FOLDER`.

It runs where the package n-sam is, with what it needs: pddl-plus-parser, numpy, pandas, scipy,
scikit-learn, sympy, anytree, networkx and matplotlib.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any


def learn(folder: Path) -> dict[str, list[str]]:
    """Return the effects of each action that was seen, as PDDL."""
    parsers: Any = import_module("pddl_plus_parser.lisp_parsers")
    learners: Any = import_module("sam_learning.learners")
    domain = parsers.DomainParser(folder / "domain.pddl", partial_parsing=True).parse_domain()
    problem = parsers.ProblemParser(folder / "problem.pddl", domain).parse_problem()
    reader = parsers.TrajectoryParser(domain, problem)
    seen = [reader.parse_trajectory(path) for path in sorted(folder.glob("*.trajectory"))]
    model, report = learners.SAMLearner(domain).learn_action_model(seen)
    return {
        action.name: [
            effect.untyped_representation.replace(" )", ")") for effect in action.discrete_effects
        ]
        for action in model.actions.values()
        if report[action.name] != "UNOBSERVED"
    }


if __name__ == "__main__":
    print(json.dumps(learn(Path(sys.argv[1]))))
