"""What the tests of planning share."""

from tests.planning.conftest import quick_start

__all__ = ["quick_start"]
