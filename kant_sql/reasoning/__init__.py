"""Reasoning on the store: conditions, actions, plans, and rules about the past."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for

if TYPE_CHECKING:
    from . import act as act
    from . import ask as ask
    from . import because as because
    from . import complete as complete
    from . import durative as durative
    from . import execute as execute
    from . import explain as explain
    from . import kept_rules as kept_rules
    from . import links as links
    from . import memory as memory
    from . import replan as replan
    from . import rule_watch as rule_watch
    from . import rules as rules
    from . import search as search
    from . import stale as stale
    from . import validate as validate
    from . import when as when
    from .ask import Answers, Binding
    from .because import CauseLink, CauseLinks
    from .kept_rules import KeptRule
    from .steps import Step, UpActionInstance
else:
    homes = {
        ".ask": ("Answers", "Binding"),
        ".because": ("CauseLink", "CauseLinks"),
        ".kept_rules": ("KeptRule",),
        ".steps": ("Step", "UpActionInstance"),
    }
    __getattr__ = asked_for(__name__, homes)

__all__ = ["Answers", "Binding", "CauseLink", "CauseLinks", "KeptRule", "Step", "UpActionInstance"]
