"""The changes of a merge, and the conflicts between the two sides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .. import html
from ..sql.changes import Change
from .revisions import Revision

Decision = Literal["ours", "theirs"]
OURS: Decision = "ours"
THEIRS: Decision = "theirs"
# Conflicts, and users of an element, that a message names.
NAMED = 10


@dataclass(frozen=True)
class MergeSide:
    """One side of a conflict, and the revision that changed it last.

    Attributes:
        text: the element's text; None if it was deleted or never existed. For a rule, this side's
            changes of the facts and values that break it.
        revision: who changed it last since the base, when and why; None if this side only uses it.
        used_by: elements that this side has asserted since the base, and that mention the element
            that the other side has deleted.
    """

    text: str | None
    revision: Revision | None
    used_by: tuple[str, ...] = ()

    def __str__(self) -> str:
        said = self.text or "nothing"
        if self.used_by:
            said += f", used by {', '.join(self.used_by[:NAMED])}"
        if self.revision is None:
            return said
        return f"{said} ({', '.join([f'revision {self.revision.number}', *self.revision.said()])})"


@dataclass(frozen=True)
class MergeConflict:
    """An element that both sides changed differently, or a rule that they break together.

    Attributes:
        element: its kind and its name for `decide`, such as `value (battery rb1)`; for a rule, with
            the violated instance.
        base: its text in the base; None if it did not hold, and for a rule.
        ours: this knowledge base.
        theirs: the branch.
        decided: `ours` or `theirs`; None if it is not decided.
    """

    element: str
    base: str | None
    ours: MergeSide
    theirs: MergeSide
    decided: Decision | None

    def __str__(self) -> str:
        return f"{self.element}: here {self.ours}; in the branch {self.theirs}"

    def _html_row_(self) -> html.Row:
        sides = {"ours": str(self.ours), "theirs": str(self.theirs)}
        return {"element": self.element, "base": self.base, **sides, "decided": self.decided}


@dataclass(frozen=True)
class Merge:
    """The result or the preview of a merge.

    Attributes:
        branch: the name of the branch.
        branch_revision: its last merged revision.
        branch_hash: the hash of that revision.
        base: the revision of this knowledge base from which the branch began, or its last merge.
        head: the revision of this knowledge base that it was compared with.
        changes: the changes here; undecided conflicts count as `ours`.
        conflicts: the conflicts, decided or not.
        refused: why the result would be refused with these decisions, for example by a kept rule.
            None also if a conflict is undecided.
        revision: the revision that was written; None for a preview, or if nothing is new.
    """

    branch: str
    branch_revision: int
    branch_hash: str
    base: int
    head: int
    changes: tuple[Change, ...]
    conflicts: tuple[MergeConflict, ...]
    refused: str | None = None
    revision: int | None = None

    @property
    def undecided(self) -> list[MergeConflict]:
        """The conflicts that are not decided."""
        return [each for each in self.conflicts if each.decided is None]

    def _repr_html_(self) -> str:
        lists = {"changes": len(self.changes), "conflicts": len(self.conflicts)}
        listed = html.listing(self.conflicts, "conflict") if self.conflicts else ""
        return html.fields({**self.__dict__, **lists}) + listed
