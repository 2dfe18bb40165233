"""The command line `kant-sql`, one module for each command."""

from __future__ import annotations
