"""Plans found from our text are valid for the originals, and the reverse, as VAL judges.

Fast Downward, pyperplan, ENHSP and Aries plan for pairs of different features, each of which they
solve in a moment. The profile `long` has them plan for `MORE`, too, which they solve in
seconds.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.meaning import val
from tests.meaning.material import ALL, Pair, Workshop, corpus_pairs, own_pairs
from tests.meaning.planners import PLANNERS
from tests.support.corpus import WITHOUT_CORPUS

PAIRS = {pair.name: pair for pair in [*own_pairs(), *corpus_pairs()]}

# The planner, the pair, and what the pair stands for.
SOLVED = [
    ("fast_downward", "conditional", "conditional effects, costs, a hierarchy of types"),
    ("fast_downward", "derived", "derived predicates: recursive, negated, quantified"),
    ("fast_downward", "untyped", "no types, upper case, sections out of order"),
    ("pyperplan", "strips", "STRIPS with types"),
    ("enhsp", "numbers", "numeric fluents, a metric"),
    ("aries", "temporal", "durative actions, durations from the state"),
    ("fast_downward", "ipc1998-assembly-round-1-adl.instance-1", "disjunction, quantifiers"),
    ("pyperplan", "ipc1998-grid-round-2-strips.instance-1", "types as predicates"),
    ("fast_downward", "ipc1998-gripper-round-1-adl.instance-1", "constants"),
    ("pyperplan", "ipc1998-gripper-round-1-strips.instance-1", "no requirements"),
    ("fast_downward", "ipc1998-mystery-prime-round-1-strips.instance-25", "negation"),
    ("pyperplan", "ipc2000-blocks-strips-typed.instance-2", "upper case"),
    ("fast_downward", "ipc2000-elevator-adl-full-typed.instance-1", "implication"),
    ("fast_downward", "ipc2000-elevator-adl-simple-typed.instance-1", "universal effects"),
    ("fast_downward", "ipc2000-freecell-strips-typed.instance-3", "a type named as a predicate"),
    ("pyperplan", "ipc2000-logistics-strips-untyped.instance-1", "parameters of one name"),
    ("fast_downward", "ipc2000-schedule-adl-typed.instance-1", "typed constants, when"),
    ("fast_downward", "ipc2000-schedule-adl-untyped.instance-1", "untyped constants, when"),
    ("enhsp", "ipc2002-driverlog-numeric-automatic.instance-1", "a metric of total-time"),
    ("enhsp", "ipc2002-satellite-numeric-hard-automatic.instance-1", "no goal but a metric"),
    ("fast_downward", "ipc2002-zenotravel-strips-automatic.instance-1", "either"),
    ("fast_downward", "ipc2004-psr-middle-derived-predicates-adl.instance-2",
     "recursive derived predicates"),
    ("fast_downward", "ipc2004-psr-small-strips.instance-1", "no objects"),
    ("enhsp", "ipc2006-openstacks-preferences-simple.instance-1", "preferences, quantified"),
    ("enhsp", "ipc2006-pathways-preferences-simple.instance-1", "preferences, disjunctive"),
    ("enhsp", "ipc2006-rovers-metric-preferences-simple.instance-1", "preferences with numbers"),
    ("enhsp", "ipc2006-tpp-metric.instance-1", "arithmetic in effects"),
    ("fast_downward", "ipc2006-openstacks-propositional.instance-1", "quantified disjunction"),
    ("fast_downward", "ipc2006-trucks-propositional.instance-1", "quantified preconditions"),
    ("fast_downward", "ipc2008-openstacks-sequential-satisficing-adl.instance-3",
     "costs with quantifiers"),
    ("fast_downward", "ipc2008-openstacks-sequential-satisficing-strips.instance-3",
     "costs with constants"),
    ("fast_downward", "ipc2008-scanalyzer-3d-sequential-optimal-strips.instance-22", "costs"),
    ("fast_downward", "ipc2008-woodworking-sequential-satisficing-strips.instance-11",
     "costs from functions"),
    ("fast_downward", "ipc2011-barman-sequential-optimal.instance-1", "a hierarchy of types"),
    ("aries", "ipc2011-match-cellar-temporal-satisficing.instance-1", "required concurrency"),
    ("fast_downward", "ipc2011-visit-all-sequential-optimal.instance-2", "a single action"),
    ("fast_downward", "ipc2014-child-snack-sequential-optimal.instance-2", "text beyond ASCII"),
    ("fast_downward", "ipc2014-city-car-sequential-optimal.instance-1",
     "costs with conditional effects"),
    ("fast_downward", "ipc2014-genome-edit-distances-sequential-optimal.instance-3",
     "costs without types"),
    ("fast_downward", "ipc2014-hiking-sequential-optimal.instance-1", "inequality"),
]  # fmt: skip
MORE = [
    ("fast_downward", "ipc2004-promela-dining-philosophers-derived-predicates-strips.instance-1",
     "derived predicates in STRIPS"),
    ("fast_downward", "ipc2011-tidybot-sequential-optimal.instance-1", "an object named as a type"),
    ("fast_downward", "ipc2004-psr-middle-derived-predicates-simple-adl.instance-2",
     "derived predicates, conditional effects"),
    ("aries", "ipc2002-driverlog-time-automatic.instance-1", "durations from functions"),
    ("aries", "ipc2008-openstacks-temporal-satisficing-strips.instance-1",
     "durative actions with constants"),
    ("aries", "ipc2002-depots-time-simple-automatic.instance-1", "durative actions"),
    ("fast_downward", "ipc2000-logistics-strips-untyped.instance-46", "a long plan"),
    ("fast_downward", "ipc2004-psr-middle-compiled-adl.instance-2", "large disjunctions"),
    ("fast_downward", "ipc2008-cyber-security-sequential-satisficing-strips.instance-10", "size"),
    ("fast_downward", "ipc2011-floor-tile-sequential-multi-core.instance-1",
     "an action and a predicate of one name"),
    ("fast_downward", "ipc2014-openstacks-sequential-optimal.instance-1", "constants, costs"),
    ("fast_downward", "ipc2014-tetris-sequential-optimal.instance-4", "many parameters"),
    ("aries", "ipc2002-satellite-time-simple-automatic.instance-1", "durative, negation"),
    ("aries", "ipc2008-elevator-temporal-satisficing-numeric-fluents.instance-1",
     "numbers in durative actions"),
    ("aries", "ipc2008-elevator-temporal-satisficing-strips.instance-1", "durations by floor"),
    ("aries", "ipc2008-openstacks-temporal-satisficing-numeric-fluents.instance-1",
     "numbers in durative actions, constants"),
    ("aries", "ipc2008-transport-temporal-satisficing-numeric-fluents.instance-1",
     "numeric capacities"),
]  # fmt: skip
CHOSEN = [*SOLVED, *MORE] if ALL else SOLVED


@pytest.mark.parametrize(
    ("planner", "name"), [(planner, name) for planner, name, _ in CHOSEN], ids=str
)
def test_plans_are_valid_both_ways(
    planner: str, name: str, workshop: Workshop, tmp_path: Path
) -> None:
    if name not in PAIRS:
        pytest.skip(WITHOUT_CORPUS)
    original = PAIRS[name]
    ours = workshop.ours(original)
    _check(planner, ours, original, tmp_path)
    _check(planner, original, ours, tmp_path)


def _check(planner: str, read: Pair, judged: Pair, folder: Path) -> None:
    """Have a planner read one pair, and VAL judge its plan by the other."""
    plan = folder / "found.plan"
    verdict = val.carried_out(judged, PLANNERS[planner](read, folder), plan)
    assert verdict.value == val.validate(read, plan).value
