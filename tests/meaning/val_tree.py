"""The normal form of the tree that VAL's parser prints.

Two texts that mean the same have the same normal form, in spite of what our text does not keep:
- the initial state is a set;
- a conjunction of one formula is that formula, and one within another is part of it;
- everything is of type `object` without being said so, and `(either robot)` is `robot`;
- an empty list of objects is as good as none.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import lru_cache

_ADDRESS = re.compile(r"\[0x[0-9a-f]+\]")
_LIST = "(typed_symbol_list<>)"
_CONJUNCTION = "(conj_goal)"
_ROOT = "name: object"
_STEP = 3


@dataclass
class _Branch:
    """A line, and what is indented below it."""

    line: str
    below: list[_Branch] = field(default_factory=list)

    def lines(self, indent: str = "") -> list[str]:
        """The branch as VAL prints it."""
        lines = [indent + self.line]
        for branch in self.below:
            lines += branch.lines(indent + "   ")
        return lines


def normal_tree(text: str) -> tuple[str, ...]:
    """Write VAL's tree in its normal form, line by line."""
    domain, problem, rest = re.sub(r"File: .*", "", _ADDRESS.sub("", text)).partition("(problem)\n")
    return _normal_part(domain) + _normal_part(problem + rest)


@lru_cache(maxsize=2)
def _normal_part(text: str) -> tuple[str, ...]:
    """A part may be large, and is often the same of an original and of ours."""
    branches = _read([line for line in text.splitlines() if line.strip()])
    for branch in branches:
        _normalise(branch)
        if branch.line == "initial_state:":
            _make_sets(branch)
    return tuple(line for branch in branches for line in branch.lines())


def _read(lines: list[str]) -> list[_Branch]:
    top = _Branch("")
    path = [top]
    for line in lines:
        depth = (len(line) - len(line.lstrip())) // _STEP
        branch = _Branch(line.strip())
        del path[depth + 1 :]
        path[-1].below.append(branch)
        path.append(branch)
    return top.below


def _normalise(branch: _Branch, of_type: bool = False) -> None:
    """Bring a branch into its normal form; `of_type`: it says what is above a type."""
    of_type = of_type or branch.line.startswith(("type:", "either_types:"))
    for below in branch.below:
        _normalise(below, of_type)
    _flatten(branch)
    for one, several in zip(branch.below, branch.below[1:], strict=False):
        if one.line.startswith("type:") and several.line.startswith("either_types:"):
            _normalise_type(one, several, of_type)
    if branch.line == "objects:" and [below.lines() for below in branch.below] == [[_LIST]]:
        branch.line, branch.below = "objects: (NULL)", []


def _flatten(branch: _Branch) -> None:
    """Take a conjunction of one formula for that formula, and one in another for its conjuncts."""
    if branch.line == "(goal_list)":
        branch.below = [
            part
            for item in _items(branch.below)
            for part in (item[1].below[0].below if item[0].line == _CONJUNCTION else item)
        ]
    if [below.line for below in branch.below] == [_CONJUNCTION, "goals:"]:
        items = _items(branch.below[1].below[0].below)
        if len(items) == 1:
            branch.below = items[0]


def _items(branches: list[_Branch]) -> list[list[_Branch]]:
    """Tell a list's entries apart: each begins with the name of its class, or with `prop:`."""
    items: list[list[_Branch]] = []
    for branch in branches:
        if branch.line.startswith("(") or branch.line == "prop:":
            items.append([])
        items[-1].append(branch)
    return items


def _normalise_type(one: _Branch, several: _Branch, of_type: bool) -> None:
    if several.below:
        items = _items(several.below[0].below)
        if of_type:
            items = [item for item in items if item[1].line != _ROOT]
        several.below[0].below = [branch for item in items for branch in item]
        if len(items) == 1:
            one.line, one.below = "type:", items[0]
            several.line, several.below = "either_types: (NULL)", []
    if one.below and one.below[1].line == _ROOT:
        one.line, one.below = "type: (NULL)", []


def _make_sets(initial_state: _Branch) -> None:
    """Sort what each list has, and drop what it has twice."""
    for branch in initial_state.below:
        texts = {
            tuple(line for part in item for line in part.lines()) for item in _items(branch.below)
        }
        branch.below = [_Branch(line) for text in sorted(texts) for line in text]
