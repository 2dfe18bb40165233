"""The interface of reasoning: ask, explain, act, validate, and hold rules against the past."""

# What a family implements has no body here, and is not abstract to a type checker.
# mypy: disable-error-code="empty-body"

from __future__ import annotations

from ..dao.interfaces import Interface


class Reasoning(Interface):
    """Asks whether conditions hold, explains, acts, validates plans, and asks the past."""

    # Ask.

    # Explain.

    # Act.

    # Plans.

    # The past.

    # What if.
