"""Erasure: destroys names everywhere, and keeps the chain of hashes verifiable."""

from __future__ import annotations

from . import erase as erase
from . import preview as preview
from . import retention as retention
