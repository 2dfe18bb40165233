"""The pages, a module for each topic."""

from __future__ import annotations

from . import (
    acts,
    ask,
    elements,
    home,
    merging,
    overview,
    plans,
    revisions,
    rules,
    statistics,
    timeline,
    verify,
)

TOPICS = (
    home.PAGES,
    overview.PAGES,
    rules.PAGES,
    revisions.PAGES,
    merging.PAGES,
    ask.PAGES,
    revisions.STATES,
    timeline.PAGES,
    verify.PAGES,
    elements.PAGES,
    acts.PAGES,
    plans.PAGES,
    statistics.PAGES,
    elements.SEARCH,
)
