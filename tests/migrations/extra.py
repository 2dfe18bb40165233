"""One more migration, in a copy of the folder, for tests that need more than there are."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from kant_sql.sql import schema

HEAD = """
from __future__ import annotations

import sqlalchemy as sa
from alembic import context, op
from alembic.util import CommandError

revision = "9999"
down_revision = {before!r}
branch_labels = None
depends_on = None
"""
VERSION = "9999"


def add_migration(monkeypatch: pytest.MonkeyPatch, folder: Path, body: str) -> None:
    """Add a migration after the last one; `body` has its `upgrade` and `downgrade`."""
    copy = folder / "migrations"
    shutil.copytree(
        schema.migrations_folder(), copy, ignore=shutil.ignore_patterns("__pycache__", "golden")
    )
    head = HEAD.format(before=schema.VERSIONS[-1])
    (copy / "versions" / f"{VERSION}_extra.py").write_text(head + body, encoding="utf-8")
    monkeypatch.setattr(schema, "migrations_folder", lambda: copy)
    monkeypatch.setattr(schema, "VERSIONS", (*schema.VERSIONS, VERSION))
