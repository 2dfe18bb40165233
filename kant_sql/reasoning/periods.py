"""The periods during which a condition held."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, overload

from typing_extensions import override

from .. import html
from ..arguments import expect_tuple
from ..history.revisions import Revision

# Periods whose revisions are read together.
PAGE = 200


class Span(NamedTuple):
    """A period by its numbers.

    Attributes:
        since: the first revision; the one before the range if it held there, too.
        objects: the ids of the objects of the free variables.
        until: the first revision after it; None if it held to the end of the range.
    """

    since: int
    objects: tuple[int, ...]
    until: int | None


def span_order(span: Span) -> tuple[int, tuple[int, ...]]:
    """Return what periods are sorted by; those of one binding begin apart."""
    return span.since, span.objects


@dataclass(frozen=True)
class Held:
    """A period during which a condition held.

    Attributes:
        binding: the objects of the free variables, by the names of the variables.
        since: the revision that made it hold; None if it held before the range, too.
        until: the revision that ended it; None if it still held at the end of the range.
    """

    binding: Mapping[str, str]
    since: Revision | None
    until: Revision | None

    def _html_row_(self) -> html.Row:
        since, until = self.since, self.until
        return {
            **{f"?{name}": object_ for name, object_ in self.binding.items()},
            "since": "before the range" if since is None else since.number,
            "begun at": None if since is None else since.committed_at,
            "begun by": None if since is None else since.actor,
            "reason": None if since is None else since.reason,
            "source": None if since is None else since.source_text,
            "until": "the end of the range" if until is None else until.number,
            "ended at": None if until is None else until.committed_at,
            "ended by": None if until is None else until.actor,
            "reason of the end": None if until is None else until.reason,
            "source of the end": None if until is None else until.source_text,
        }

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_())

    def __str__(self) -> str:
        names = " ".join(self.binding.values())
        begin = "before" if self.since is None else _end(self.since)
        end = "the end" if self.until is None else _end(self.until)
        return f"{names}: {begin} until {end}" if names else f"{begin} until {end}"


def _end(revision: Revision) -> str:
    when = revision.committed_at.isoformat(timespec="seconds")
    who = revision.said()
    return f"{revision.number} ({', '.join([when, *who])})"


class HeldPeriods(Sequence[Held]):
    """The periods during which a condition held, in the order of their beginnings.

    Those that begin together are in the order in which the objects were declared. The periods are
    found; who began and ended them is read a page at a time.

    Attributes:
        columns: the names of the free variables, without question mark.
    """

    def __init__(
        self,
        columns: Sequence[str],
        *,
        spans: Sequence[Span],
        first: int,
        names: Mapping[int, str],
        read: Callable[[Collection[int]], Mapping[int, Revision]],
    ) -> None:
        """Wrap what was found.

        Args:
            columns: the names of the free variables.
            spans: the periods, in order.
            first: the first revision of the range.
            names: the names of the objects, by id.
            read: reads revisions by number.
        """
        self.columns = expect_tuple(columns, str, "the columns of HeldPeriods")
        self._spans = spans
        self._first = first
        self._names = names
        self._read = read
        self._pages: dict[int, list[Held]] = {}

    @override
    def __len__(self) -> int:
        return len(self._spans)

    @overload
    def __getitem__(self, index: int) -> Held: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Held]: ...
    @override
    def __getitem__(self, index: int | slice) -> Held | Sequence[Held]:
        if isinstance(index, slice):
            return [self[at] for at in range(*index.indices(len(self)))]
        at = index + len(self) if index < 0 else index
        if not 0 <= at < len(self):
            raise IndexError(f"there are {len(self)} periods, and none has the index {index}")
        page, place = divmod(at, PAGE)
        return self._page(page)[place]

    @override
    def __iter__(self) -> Iterator[Held]:
        for page in range((len(self) + PAGE - 1) // PAGE):
            yield from self._page(page)

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the periods as dictionaries, for tables and JSON.

        Returns:
            For each period the objects by their variables (with `?`), and `since`, `since_time`,
            `since_actor`, `since_reason`, `since_source`, and likewise `until` ...;
            None where a period has no such end.
        """
        return [
            {
                **{f"?{name}": object_ for name, object_ in held.binding.items()},
                **_columns("since", held.since),
                **_columns("until", held.until),
            }
            for held in self
        ]

    def __str__(self) -> str:
        return "\n".join(map(str, self)) or "at no time"

    def __repr__(self) -> str:
        return f"<{len(self)} periods>"

    def _repr_html_(self) -> str:
        return html.guarded(lambda: html.listing(self, "period"))

    def _page(self, page: int) -> list[Held]:
        found = self._pages.get(page)
        if found is None:
            # One page: whoever goes through millions keeps none.
            found = self._load(self._spans[page * PAGE : (page + 1) * PAGE])
            self._pages = {page: found}
        return found

    def _load(self, spans: Sequence[Span]) -> list[Held]:
        numbers = {span.since for span in spans if span.since >= self._first}
        revisions = self._read(numbers.union(span.until for span in spans if span.until))
        names = self._names
        return [
            Held(
                dict(zip(self.columns, (names[id_] for id_ in span.objects), strict=True)),
                revisions.get(span.since),
                None if span.until is None else revisions.get(span.until),
            )
            for span in spans
        ]


def _columns(end: str, revision: Revision | None) -> dict[str, Any]:
    if revision is None:
        columns = f"{end}_time", f"{end}_actor", f"{end}_reason", f"{end}_source"
        return dict.fromkeys((end, *columns))
    return {
        end: revision.number,
        f"{end}_time": revision.committed_at,
        f"{end}_actor": revision.actor,
        f"{end}_reason": revision.reason,
        f"{end}_source": revision.source,
    }
