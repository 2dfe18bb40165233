"""The stores of other folders that the tests of plugins read, too."""

from tests.audit.conftest import scratch, scratch_url, story_url
from tests.cli.conftest import own_store

__all__ = ["own_store", "scratch", "scratch_url", "story_url"]
