"""The stores of other folders that the tests of plugins read, too."""

from tests.audit.conftest import (
    citus_scratch,
    postgresql_scratch,
    postgresql_story,
    scratch_url,
    sqlite_scratch,
    sqlite_story,
    story_url,
)
from tests.cli.conftest import own_store

__all__ = [
    "citus_scratch",
    "own_store",
    "postgresql_scratch",
    "postgresql_story",
    "scratch_url",
    "sqlite_scratch",
    "sqlite_story",
    "story_url",
]
