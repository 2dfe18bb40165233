"""The pages, a module for each topic."""

from __future__ import annotations

from . import home, revisions

TOPICS = (home.PAGES, revisions.PAGES)
