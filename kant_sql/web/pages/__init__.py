"""The pages, a module for each topic."""

from __future__ import annotations

from . import ask, home, revisions

TOPICS = (home.PAGES, revisions.PAGES, ask.PAGES)
