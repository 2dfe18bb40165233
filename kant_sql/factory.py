"""The factory method: a family of DAOs for each kind of database, chosen by the URL.

`DaoFactory` is the abstract factory, with one concrete factory for each family. Another package
joins by an entry point in the group `kant_sql.dao_families`, named like the URL's dialect, that
gives a `DaoFactory` class.
"""

from __future__ import annotations

from importlib.metadata import entry_points

from .abstract_factory import DaoFactory
from .backends import dialect_name
from .errors import InvalidUrlError
from .sql_factory import PostgresqlDaoFactory, SqliteDaoFactory

__all__ = [
    "FAMILIES",
    "DaoFactory",
    "PostgresqlDaoFactory",
    "SqliteDaoFactory",
    "create_dao_factory",
]

ENTRY_POINTS = "kant_sql.dao_families"

FAMILIES: dict[str, type[DaoFactory]] = {
    "sqlite": SqliteDaoFactory,
    "postgresql": PostgresqlDaoFactory,
}


def create_dao_factory(
    url: str, *, knowledge_base: str = "default", actor: str | None = None
) -> DaoFactory:
    """Create the factory of the family that a database URL names.

    Args:
        url: the database URL, for example `sqlite:///robot.db`.
        knowledge_base: the knowledge base's name; it comes to be with its first write.
        actor: who writes, when a transaction does not say.

    Returns:
        The factory. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL cannot be read, or no family answers to it.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.
    """
    name = dialect_name(url)
    family = FAMILIES.get(name) or _joined_family(name)
    return family(url, knowledge_base=knowledge_base, actor=actor)


def _joined_family(name: str) -> type[DaoFactory]:
    found = entry_points(group=ENTRY_POINTS)
    for entry_point in found.select(name=name):
        family = entry_point.load()
        if not (isinstance(family, type) and issubclass(family, DaoFactory)):
            raise InvalidUrlError(
                f"{name}: entry point {entry_point.value!r} is not a DaoFactory class"
            )
        return family
    known = ", ".join(sorted({*FAMILIES, *found.names}))
    raise InvalidUrlError(f"{name}: no DAO family answers to this URL; there are {known}")
