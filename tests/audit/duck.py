"""DuckDB with its extension for SQLite, without a network."""

from __future__ import annotations

from pathlib import Path

import duckdb
import duckdb_extension_sqlite_scanner


def install_sqlite_extension() -> None:
    """Install the extension where DuckDB looks for it: below the folder that HOME names."""
    (file,) = Path(duckdb_extension_sqlite_scanner.__file__).parent.rglob("*.duckdb_extension")
    with duckdb.connect() as tool:
        tool.execute(f"INSTALL '{file}'")
