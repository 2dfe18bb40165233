"""The pages, a module for each topic."""

from __future__ import annotations

from . import ask, elements, home, plans, revisions, search, state, timeline, verify

TOPICS = (
    home.PAGES,
    revisions.PAGES,
    ask.PAGES,
    state.PAGES,
    timeline.PAGES,
    verify.PAGES,
    elements.PAGES,
    plans.PAGES,
    search.PAGES,
)
