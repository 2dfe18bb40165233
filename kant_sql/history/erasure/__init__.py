"""Erasure: what names somebody is destroyed everywhere, and the chain of hashes stays whole."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...later import asked_for

if TYPE_CHECKING:
    from . import erase as erase
    from . import preview as preview
    from . import retention as retention
else:
    __getattr__ = asked_for(__name__)
