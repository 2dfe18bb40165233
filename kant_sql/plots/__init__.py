"""Figures of a knowledge base's past, for notebooks and programs (the extra `web`).

`timeline` and `values` return figures of Plotly. `timeline_spec` gives the same figure as plain
data, as the web pages and the report draw it; it needs no package.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..errors import ExtraMissingError
from ..history.timeline import Timeline
from ..knowledge_base import KnowledgeBase
from ..moment_text import When
from .figure import FigureSpec, timeline_spec

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

__all__ = ["FigureSpec", "timeline", "timeline_figure", "timeline_spec", "values"]


def timeline(
    kb: KnowledgeBase,
    *,
    since: When | None = None,
    until: When | None = None,
    predicate: str | None = None,
    object: str | None = None,
    text: str | None = None,
    kinds: Iterable[str] = ("fact", "goal", "value", "plan"),
    lanes: int = 50,
    after: str | None = None,
    dark: bool = False,
) -> Figure:
    """Draw what held when: facts, goals, values and plans.

    Args:
        kb: the knowledge base.
        since: the beginning, given as for `kb.at`; None for the first revision.
        until: the end; None for the last revision.
        predicate: show lanes of this predicate or function.
        object: show lanes with this object among the arguments, and steps of plans likewise.
        text: show lanes whose text has this part, in any case, and steps of plans likewise.
        kinds: what to show: some of `fact`, `goal`, `value` and `plan`.
        lanes: the maximum number of lanes.
        after: `next` of the timeline before, to go on with the lanes that follow.
        dark: whether the figure is for a dark background.

    Returns:
        A figure. The custom data of a bar is the address of its page in `kant-sql serve`.

    Raises:
        ExtraMissingError: Plotly is not installed.
        KantSqlError: as `KnowledgeBase.timeline` raises.

    Examples:
        >>> from kant_sql import plots
        >>> figure = plots.timeline(kb, object="rb1")
        >>> [trace.name for trace in figure.data]
        ['perception']
    """
    shown = kb.timeline(
        since,
        until=until,
        predicate=predicate,
        object=object,
        text=text,
        kinds=kinds,
        lanes=lanes,
        after=after,
    )
    return timeline_figure(shown, dark=dark)


def values(
    kb: KnowledgeBase,
    *,
    since: When | None = None,
    until: When | None = None,
    function: str | None = None,
    object: str | None = None,
    text: str | None = None,
    lanes: int = 20,
    dark: bool = False,
) -> Figure:
    """Draw the values of fluents as steps.

    Args:
        kb: the knowledge base.
        since: the beginning, given as for `kb.at`; None for the first revision.
        until: the end; None for the last revision.
        function: show fluents of this function.
        object: show fluents with this object among the arguments.
        text: show fluents whose text has this part, in any case.
        lanes: the maximum number of fluents.
        dark: whether the figure is for a dark background.

    Returns:
        A figure.

    Raises:
        ExtraMissingError: Plotly is not installed.
        KantSqlError: as `KnowledgeBase.timeline` raises.

    Examples:
        >>> from kant_sql import plots
        >>> len(plots.values(kb).data)
        0
    """
    shown = kb.timeline(
        since,
        until=until,
        predicate=function,
        object=object,
        text=text,
        kinds=("value",),
        lanes=lanes,
    )
    return timeline_figure(shown, dark=dark)


def timeline_figure(timeline: Timeline, *, dark: bool = False) -> Figure:
    """Draw a timeline.

    Args:
        timeline: what `KnowledgeBase.timeline` returned.
        dark: whether the figure is for a dark background.

    Returns:
        A figure.

    Raises:
        ExtraMissingError: Plotly is not installed.
    """
    try:
        from plotly.graph_objects import Figure
    except ImportError as error:
        raise ExtraMissingError(
            "figures need Plotly; install it with: pip install 'kant-sql[web]'"
        ) from error
    return Figure(timeline_spec(timeline, dark=dark))
