"""Imports on first use: most programs use few of the questions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from types import MappingProxyType

_NONE: Mapping[str, Iterable[str]] = MappingProxyType({})


def asked_for(package: str, homes: Mapping[str, Iterable[str]] = _NONE) -> Callable[[str], object]:
    """Make the `__getattr__` of a package, for its modules and for names of modules.

    Args:
        package: its name.
        homes: a module, relative to the package -> the names that the package exports from it.
    """
    home = {name: module for module, names in homes.items() for name in names}

    def find(name: str) -> object:
        if name in home:
            return getattr(import_module(home[name], package), name)
        missing = AttributeError(f"module {package!r} has no attribute {name!r}")
        if name.startswith("_"):
            raise missing
        try:
            return import_module(f"{package}.{name}")
        except ModuleNotFoundError as error:
            if error.name == f"{package}.{name}":
                raise missing from None
            raise

    return find
