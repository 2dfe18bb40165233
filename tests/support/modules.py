"""The modules of the library."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

import kant_sql

# The only modules that import rclpy, which comes with ROS 2, not from a package index.
NODE = ("kant_sql.ros.node", "kant_sql.ros.skills")


def import_all() -> list[ModuleType]:
    """Import all modules that need no ROS 2."""
    names = [found.name for found in pkgutil.walk_packages(kant_sql.__path__, "kant_sql.")]
    return [
        importlib.import_module(name)
        for name in names
        if name not in NODE and not name.endswith("__main__") and ".migrations" not in name
    ]
