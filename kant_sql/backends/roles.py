"""The roles of a database: who may write, who may read, and who may only look at the views."""

from __future__ import annotations

from typing import NamedTuple


class Roles(NamedTuple):
    """Three roles that users can be made members of.

    Attributes:
        writer: the role that adds revisions, and cannot change what is past.
        reader: the role that reads tables and views.
        auditor: the role that reads views.
        schema: where the auditor's views are, when that is not where the tables are.
        knowledge_base: the one that they are limited to; None for all.
        statements: the SQL that makes them, or brings them up to date.
        remaining: the SQL that takes from everybody what these roles are not to have, and that
            needs more rights than the caller has.
    """

    writer: str
    reader: str
    auditor: str
    schema: str | None
    knowledge_base: str | None
    statements: tuple[str, ...]
    remaining: tuple[str, ...] = ()
