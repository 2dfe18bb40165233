"""The parts of a knowledge base by their paths: its DAOs, as `types` and `pddl.metric`."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from functools import cached_property
from operator import attrgetter
from typing import Any

from kant_sql import KnowledgeBase
from kant_sql.knowledge_base import Operations, PddlParts

# What is behind an attribute of its own.
FRONTS: dict[str, type] = {"": KnowledgeBase, "pddl": PddlParts, "store": Operations}


def _daos() -> Iterator[tuple[str, type]]:
    for front, cls in FRONTS.items():
        for name, member in vars(cls).items():
            if isinstance(member, cached_property) and name not in FRONTS:
                yield f"{front}.{name}".lstrip("."), typing.get_type_hints(member.func)["return"]


DAOS = dict(_daos())
# All that methods are called of.
PATHS = [*FRONTS, *DAOS]


def part(of: Any, path: str) -> Any:
    """The part of a knowledge base, or of one for asyncio, at a path."""
    return attrgetter(path)(of) if path else of


def dao_of(kb: Any, name: str) -> Any:
    """The DAO of a name, which may be one of the rarer parts of PDDL."""
    return getattr(kb if hasattr(kb, name) else kb.pddl, name)
