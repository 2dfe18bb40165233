"""The worlds of the demos."""

from __future__ import annotations

from kant_sql.errors import KantSqlError
from kant_sql.knowledge_base import KnowledgeStore

from . import coffee_shop, failed_plan, hospital, late_reports, warehouse
from .stories import World

WORLDS = (
    coffee_shop.WORLD,
    hospital.WORLD,
    warehouse.WORLD,
    late_reports.WORLD,
    failed_plan.WORLD,
)


def find(name: str) -> World | None:
    """Find a world by its name."""
    return next((world for world in WORLDS if world.name == name), None)


def write(world: World, store: KnowledgeStore) -> None:
    """Write the story of a world to a store that does not have its knowledge base yet.

    Raises:
        KantSqlError: the store has such a knowledge base.
    """
    if store.catalog.has(world.name):
        raise KantSqlError(
            f"{store.address} has a knowledge base {world.name!r} already; name another store, "
            f"or look at this one with: kant-sql serve '{store.address}'"
        )
    world.fill(lambda actor: store.knowledge_base(world.name, actor=actor))
