"""The numbers of examples and samples in a test run.

`KANT_SQL_TEST_PROFILE` is `quick`, `default` or `long`. `KANT_SQL_TEST_EXAMPLES=5000` sets the
examples of each property test, seeds them at random and shrinks what fails.
"""

from __future__ import annotations

import os
from typing import NamedTuple

from hypothesis import HealthCheck, Phase, settings


class Profile(NamedTuple):
    """Counts of one run.

    Attributes:
        names: examples of cheap properties: names, DTOs, texts.
        texts: domains and problems read and written, without a store.
        documents: domains and problems that go through a store on each backend.
        histories: sequences of these, whose earlier states are read again.
        episodes: domains with states and questions about them, on each backend.
        tasks: programs of concurrent tasks.
        programs: programs of DAO calls, each on three backends beside the model.
        restored: programs whose states are restored, on each backend.
        archived: programs whose past is archived.
        mutants: pairs of files with randomly changed words.
        junk: junk calls on each backend; None for all.
        damages: damaged cells of a store.
        rows_step: PostgreSQL runs every n-th of the row changes that verification must find.
        forged: examples of each way to forge what an erasure left.
        is_whole: run all DAO tests through `kant_sql.aio` on all backends, and judge, convert and
            store all files of the competitions.
    """

    names: int
    texts: int
    documents: int
    histories: int
    episodes: int
    tasks: int
    programs: int
    restored: int
    archived: int
    mutants: int
    junk: int | None
    damages: int
    rows_step: int
    forged: int
    is_whole: bool


PROFILES = {
    "quick": Profile(20, 10, 3, 1, 2, 3, 8, 3, 24, 20, 40, 40, 50, 1, False),
    "default": Profile(100, 30, 8, 3, 3, 8, 20, 6, 24, 40, 100, 60, 10, 2, False),
    "long": Profile(500, 500, 100, 20, 600, 50, 500, 60, 100, 500, None, 1_000, 1, 25, True),
}
NAME = os.environ.get("KANT_SQL_TEST_PROFILE", "default")
PROFILE = PROFILES[NAME]
HUNT = int(os.environ.get("KANT_SQL_TEST_EXAMPLES", "0"))
# A busy machine must not fail a slow test.
_COMMON = settings(
    derandomize=not HUNT,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
# Shrinking a document takes minutes.
_PHASES = tuple(Phase) if HUNT else (Phase.explicit, Phase.generate)


def load() -> None:
    """Make the profile the default of all property tests, and drop timeouts from long ones."""
    if HUNT or PROFILE.is_whole:
        os.environ.setdefault("PYTEST_TIMEOUT", "0")
    settings.register_profile(NAME, _COMMON, max_examples=HUNT or PROFILE.names)
    settings.load_profile(NAME)


def hunting(examples: int) -> settings:
    """Settings of a costly property test."""
    return settings(_COMMON, max_examples=HUNT or examples, phases=_PHASES)
