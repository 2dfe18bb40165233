"""Generated views: for each predicate of a knowledge base, one of its facts and one of its goals.

`fact_robot_at (robot, wp, since, since_at, until, until_at, asserted_by, asserted_reason,
retracted_by, retracted_reason)` has a row for each time that a fact of `robot_at` held. The column
of an argument is called like the parameter, or like its type where the parameter was given no name.
All facts that there ever were are there: when the predicate had more parameters at another time,
there are as many columns, and NULL where a fact has fewer arguments. A derived predicate has views
as any other, of what was stated of it.

Names depend on which knowledge bases and predicates there are, and which of them are older, not on
when the views are made. What others have made is never replaced.
"""

from __future__ import annotations

from .updating import PredicateView, drop_views, update_views

__all__ = ["PredicateView", "drop_views", "update_views"]
