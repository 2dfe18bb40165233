"""How long property tests look: quickly by default, longer with KANT_SQL_TEST_EXAMPLES."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, Phase, settings

HUNT = int(os.environ.get("KANT_SQL_TEST_EXAMPLES", "0"))
# Shrinking a document takes minutes: that is for those who hunt.
_PHASES = tuple(Phase) if HUNT else (Phase.explicit, Phase.generate)


def hunting(examples: int) -> settings:
    """The settings of a property test that looks at so many examples, unless it hunts."""
    return settings(
        max_examples=HUNT or examples,
        derandomize=not HUNT,
        database=None,
        deadline=None,
        phases=_PHASES,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
