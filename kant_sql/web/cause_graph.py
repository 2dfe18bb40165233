"""The drawing of causes: the origins of a fact on the left, its consequences on the right.

Each column is one link further from the fact. A box has an act, its actor and its effects; a line
leads from the maker of a literal to its user.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape

from ..html import visible
from ..reasoning import CauseLink, CauseLinks
from .rendering import one_line

# In pixels: a box and a line of its text, and the gaps beside and below a box.
WIDTH, LINE, GAP, SPACE = 224, 16, 48, 12
# The characters and literals that fit into a box.
FITTING, LITERALS = 31, 2
_INK, _OTHER = "currentColor", "#68717a"
# With a contrast of 3:1 with the light and the dark page.
_COLOURS = {
    "execution": "#0072b2",
    "plan": "#7a5fd0",
    "derived fact": "#007f5f",
    "observation": "#b84f00",
}

Link = Callable[..., str]


@dataclass(eq=False)
class _Box:
    """A box of a column: a link, or the element itself."""

    link: CauseLink | None
    # Its text, with the link of each line.
    lines: list[tuple[str, str]] = field(default_factory=list)
    # The literals that connect it to the next columns, which come first.
    shown: list[str] = field(default_factory=list)
    # The connected boxes nearer to the element.
    inner: list[_Box] = field(default_factory=list)
    x: int = 0
    y: float = 0.0

    @property
    def number(self) -> float:
        """The number of its revision; for a derived fact, one after all."""
        revision = None if self.link is None else self.link.revision
        return float("inf") if revision is None else revision.number

    @property
    def height(self) -> int:
        """Its height in pixels."""
        return LINE * len(self.lines) + 10

    @property
    def middle(self) -> float:
        """Where its middle is."""
        return self.y + self.height / 2


# The maker, the user, and the literals.
_Line = tuple[_Box, _Box, Sequence[str]]


def draw_causes(origins: CauseLinks, consequences: CauseLinks, link: Link) -> str:
    """Draw the origins and consequences of an element; nothing if there are no links."""
    # `link` makes the address of a page from its path and parameters; an empty one is no link.
    fact = _Box(None, [("this", ""), (consequences.element, "")])
    columns = {0: [fact]}
    for side, found in ((-1, origins), (1, consequences)):
        for one in found:
            columns.setdefault(side * one.depth, []).append(_Box(one))
    if len(columns) == 1:
        return ""
    lines = [line for column in columns if column for line in _joined(columns, column)]
    for boxes in columns.values():
        for box in boxes:
            box.lines += [] if box.link is None else _lines(box.link, box.shown, link)
    height = _place(columns)
    width = len(columns) * (WIDTH + GAP) - GAP + 2
    drawn = "".join(map(_drawn, (box for one in sorted(columns) for box in columns[one])))
    name = _said(f"What {fact.lines[1][0]} goes back to, and what it led to", 200)
    return (
        f'<svg class="causes" width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        f' font-size="12" role="group" aria-label="{name}">'
        f'<g fill="none" stroke="{_INK}">{"".join(map(_curve, lines))}</g>{drawn}</svg>'
    )


def _joined(columns: Mapping[int, Sequence[_Box]], column: int) -> Iterator[_Line]:
    """Join the boxes of a column to those of the next one that is nearer to the element."""
    own, nearer = columns[column], columns[column - 1 if column > 0 else column + 1]
    makers, users = (nearer, own) if column > 0 else (own, nearer)
    for user in users:
        found: dict[_Box, list[str]] = {}
        if user.link is None:
            found = {maker: [] for maker in makers}
        elif makers[0].link is None:
            found = {makers[0]: []}
        else:
            for text in user.link.used:
                for maker in _makers(text, makers, user.number):
                    found.setdefault(maker, []).append(text)
        for maker, texts in found.items():
            maker.shown += texts
            outer, inner = (user, maker) if column > 0 else (maker, user)
            outer.inner.append(inner)
            yield maker, user, texts


def _makers(text: str, among: Sequence[_Box], before: float) -> list[_Box]:
    """Return the makers of a literal: the last one before a revision, or all if there is none."""
    found = [one for one in among if one.link is not None and text in one.link.made]
    earlier = [one for one in found if one.number < before]
    return [max(earlier, key=lambda one: one.number)] if earlier else found


def _lines(one: CauseLink, shown: Sequence[str], link: Link) -> Iterator[tuple[str, str]]:
    """Yield the lines of a box."""
    who = "" if one.revision is None or one.revision.actor is None else one.revision.actor
    number = None if one.revision is None else one.revision.number
    if one.id is not None:
        address = link("/plan" if one.kind == "plan" else "/act", id=one.id)
    else:
        address = "" if number is None else link("/revision", number=number)
    named = f"{one.kind} {one.id or ''}".rstrip() + (f" by {who}" if who else "")
    yield named, address
    if one.id is not None or one.kind in ("document", "branch"):
        yield one.text, ""
    literals = [*dict.fromkeys([*shown, *one.made])]
    for text in literals[:LITERALS]:
        fact = text[5:-1] if text.startswith("(not ") else text
        yield f"→ {text}", link("/fact", text=fact)
    if len(literals) > LITERALS:
        yield f"and {len(literals) - LITERALS:,} more", ""


def _place(columns: Mapping[int, list[_Box]]) -> int:
    """Place the boxes; return the height of all."""
    heights = {one: sum(box.height + SPACE for box in columns[one]) - SPACE for one in columns}
    height = max(heights.values()) + 2
    for number in sorted(columns, key=abs):
        y = (height - heights[number]) / 2
        # Few lines cross if a box is beside its connected boxes.
        for box in sorted(columns[number], key=_beside):
            box.x, box.y = (number - min(columns)) * (WIDTH + GAP) + 1, y
            y += box.height + SPACE
    return height


def _beside(box: _Box) -> float:
    return sum(one.middle for one in box.inner) / len(box.inner) if box.inner else 0.0


def _curve(line: _Line) -> str:
    maker, user, texts = line
    x, y, end, to = maker.x + WIDTH, maker.middle, user.x, user.middle
    path = f"M{x} {y:g}C{x + GAP / 2:g} {y:g} {end - GAP / 2:g} {to:g} {end - 2} {to:g}"
    head = f"M{end - 7} {to - 4:g}L{end - 1} {to:g}L{end - 7} {to + 4:g}"
    about = f"<title>{_said(' '.join(texts), 200)}</title>" if texts else ""
    return f'<path d="{path}{head}">{about}</path>'


def _drawn(box: _Box) -> str:
    """Write a box; cut off text that does not fit."""
    colour = _INK if box.link is None else _COLOURS.get(box.link.kind, _OTHER)
    written = "".join(_text(17 + LINE * n, *line) for n, line in enumerate(box.lines))
    edge = f'y="0.5" height="{box.height - 1}" rx="3" fill="{colour}"'
    return (
        f'<svg x="{box.x}" y="{box.y:g}" width="{WIDTH}" height="{box.height}">'
        f'<rect x="0.5" width="{WIDTH - 1}" {edge} fill-opacity="0.08" stroke="{colour}"/>'
        f'<rect width="5" {edge}/>{written}</svg>'
    )


def _text(y: int, text: str, address: str) -> str:
    line = ' text-decoration="underline"' if address else ""
    drawn = (
        f'<title>{_said(text, 200)}</title><text x="12" y="{y}" fill="{_INK}"{line}>'
        f"{_said(text, FITTING)}</text>"
    )
    return f'<a href="{escape(address)}">{drawn}</a>' if address else f"<g>{drawn}</g>"


def _said(text: str, length: int) -> str:
    return escape(visible(one_line(text, length)))
