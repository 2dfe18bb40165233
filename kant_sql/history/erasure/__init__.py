"""Erasure: what names somebody is destroyed everywhere, and the chain of hashes stays whole."""

from __future__ import annotations

from . import erase as erase
from . import preview as preview
from . import retention as retention
