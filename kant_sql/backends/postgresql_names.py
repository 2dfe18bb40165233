"""What roles, and what belongs to them, are called on PostgreSQL."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from typing import NamedTuple

from sqlalchemy.dialects.postgresql.base import PGDialect

from .roles import Roles

# What all that is made for roles begins with, the roles too.
PREFIX = "kant_sql_"
# With the longest prefix below, and what is put behind, 63 bytes: what PostgreSQL keeps of a name.
_LONGEST_PART = 40
_PLAIN = re.compile(rf"[a-z][a-z0-9_]{{0,{_LONGEST_PART - 1}}}")
_LOOKS_MADE = re.compile(r".*_[0-9a-f]{12}")
_STRANGE = re.compile(r"[^a-z0-9]+")
# In a style of parameters that does not want each percent sign twice.
_PREPARER = PGDialect(paramstyle="named").identifier_preparer  # type: ignore[no-untyped-call]


def safe_part(knowledge_base: str) -> str:
    """Make a part of identifiers of a knowledge base's name: no two names share one.

    Args:
        knowledge_base: the name.

    Returns:
        The name itself, if it is plain; else what is plain of it, and the beginning of its SHA-256.
    """
    if _PLAIN.fullmatch(knowledge_base) and not _LOOKS_MADE.fullmatch(knowledge_base):
        return knowledge_base
    digest = hashlib.sha256(knowledge_base.encode()).hexdigest()[:12]
    plain = _STRANGE.sub("_", knowledge_base.lower()).strip("_")
    return f"{plain[: _LONGEST_PART - 13].strip('_') or 'kb'}_{digest}"


class Names:
    """How the relations of a database, and the roles' own objects, are called in statements.

    Attributes:
        schema: the schema in which the tables are.
    """

    def __init__(self, schema: str) -> None:
        self.schema = schema

    @staticmethod
    def quote(identifier: str) -> str:
        """Write an identifier.

        Args:
            identifier: a name of any kind.

        Returns:
            The name, in quotes if it needs them.
        """
        return str(_PREPARER.quote(identifier))

    def relation(self, name: str, schema: str | None = None) -> str:
        """Write the name of a table or a view.

        Args:
            name: its name.
            schema: its schema; the tables' own when not given.

        Returns:
            Both, with a dot between.
        """
        return f"{self.quote(self.schema if schema is None else schema)}.{self.quote(name)}"


class Scope(NamedTuple):
    """What a set of roles is about: all knowledge bases, or one.

    Attributes:
        knowledge_base: the name of the one; None for all.
        kb_id: its id.
    """

    knowledge_base: str | None = None
    kb_id: int | None = None

    @property
    def suffix(self) -> str:
        """What the names of its roles and policies end with."""
        return "" if self.knowledge_base is None else f"_{safe_part(self.knowledge_base)}"

    @property
    def schema(self) -> str | None:
        """The schema of its auditor's views; None where they are beside the tables."""
        return None if self.knowledge_base is None else f"{PREFIX}{self.suffix[1:]}"

    def roles(self, statements: Iterable[str] = (), remaining: Iterable[str] = ()) -> Roles:
        """Give its roles.

        Args:
            statements: the SQL that makes them.
            remaining: the SQL that somebody else has to run.

        Returns:
            The roles.
        """
        return Roles(
            f"{PREFIX}writer{self.suffix}",
            f"{PREFIX}reader{self.suffix}",
            f"{PREFIX}auditor{self.suffix}",
            self.schema,
            self.knowledge_base,
            tuple(statements),
            tuple(remaining),
        )
