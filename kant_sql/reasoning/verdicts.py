"""What was recorded, judged by rules."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any, overload

from typing_extensions import override

from .. import html
from ..history.revisions import Revision


@dataclass(frozen=True)
class Verdict:
    """Whether what was recorded keeps a rule.

    Attributes:
        rule: the rule as PDDL text, with objects for the variables of quantifiers around it.
        is_satisfied: whether it was judged, and is kept.
        is_preference: whether it is a preference.
        preference: the name of the preference; None for another rule, or without a name.
        revision: the first revision that violates it, with who made it, when and why; None if none
            does.
        time: its time in seconds from the first revision of the range; None without one.
        is_judged: whether its names had a meaning in some state of the range.
    """

    _json_ = "rule", "verdict", "is_satisfied", "is_preference", "preference", "revision", "time"

    rule: str
    is_satisfied: bool
    is_preference: bool = False
    preference: str | None = None
    revision: Revision | None = None
    time: Decimal | None = None
    is_judged: bool = True

    @property
    def verdict(self) -> str:
        """The verdict in words: `kept`, `violated` or `not judged`."""
        if not self.is_judged:
            return "not judged"
        return "kept" if self.is_satisfied else "violated"

    def _html_row_(self) -> html.Row:
        revision = self.revision
        return {
            "rule": self.rule,
            "verdict": self.verdict,
            "preference": self.preference or ("without a name" if self.is_preference else None),
            "revision": None if revision is None else revision.number,
            "committed at": None if revision is None else revision.committed_at,
            "actor": None if revision is None else revision.actor,
            "reason": None if revision is None else revision.reason,
            "source": None if revision is None else revision.source_text,
        }

    def _repr_html_(self) -> str:
        return html.fields(self._html_row_())

    def __str__(self) -> str:
        if not self.is_judged:
            return f"{self.rule} is not judged: no state of the range has all its names"
        if self.revision is None:
            return f"{self.rule} is kept"
        revision = self.revision
        said = [revision.committed_at.isoformat(timespec="seconds")]
        said += revision.said()
        return f"{self.rule} is violated in revision {revision.number} ({', '.join(said)})"


class Verdicts(Sequence[Verdict]):
    """The verdicts of rules, in the order of the rules.

    Attributes:
        first: the first revision of the range; 0 in an empty range.
        last: the last one.
    """

    def __init__(self, verdicts: Sequence[Verdict], *, first: int, last: int) -> None:
        """Wrap verdicts.

        Args:
            verdicts: the verdicts.
            first: the first revision of the range.
            last: the last one.
        """
        self._verdicts = tuple(verdicts)
        self.first = first
        self.last = last

    @property
    def is_satisfied(self) -> bool:
        """Whether all rules were judged and are kept; preferences do not count."""
        return all(one.is_satisfied or one.is_preference for one in self)

    @property
    def violated(self) -> list[Verdict]:
        """The rules and preferences that are violated."""
        return [one for one in self if one.is_judged and not one.is_satisfied]

    @property
    def not_judged(self) -> list[Verdict]:
        """The rules and preferences whose names had no meaning in the range."""
        return [one for one in self if not one.is_judged]

    @property
    def worst_first(self) -> list[Verdict]:
        """All of them: first those that are violated, then those that were not judged."""
        return [*self.violated, *self.not_judged, *(one for one in self if one.is_satisfied)]

    @property
    def violated_preferences(self) -> Mapping[str, int]:
        """How often each preference is violated; those without a name count as `anonymous`."""
        counts: dict[str, int] = {}
        for one in self.violated:
            if one.is_preference:
                name = one.preference or "anonymous"
                counts[name] = counts.get(name, 0) + 1
        return counts

    @override
    def __len__(self) -> int:
        return len(self._verdicts)

    @overload
    def __getitem__(self, index: int) -> Verdict: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Verdict]: ...
    @override
    def __getitem__(self, index: int | slice) -> Verdict | Sequence[Verdict]:
        return self._verdicts[index]

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return the verdicts as dictionaries, for tables and JSON.

        Returns:
            For each one `rule`, `verdict`, `is_satisfied`, `is_preference`, `preference`, and of
            the first violation `revision`, `committed_at`, `observed_at`, `actor`, `reason`,
            `source` and `time`; None without one.
        """
        ends = "committed_at", "observed_at", "actor", "reason", "source"
        return [
            {
                "rule": one.rule,
                "verdict": one.verdict,
                "is_satisfied": one.is_satisfied,
                "is_preference": one.is_preference,
                "preference": one.preference,
                "revision": None if one.revision is None else one.revision.number,
                **{name: getattr(one.revision, name, None) for name in ends},
                "time": one.time,
            }
            for one in self
        ]

    def __str__(self) -> str:
        return "\n".join(map(str, self)) or "there are no rules"

    def __repr__(self) -> str:
        return f"<{len(self)} verdicts, {len(self.violated)} of violations>"

    def _repr_html_(self) -> str:
        return html.listing(self.worst_first, "verdict")
