"""Who calls says what is meant: keywords from the second argument on, on all that is public."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

import pytest

import kant_sql
import kant_sql.aio
import kant_sql.operations
import kant_sql.pddl
import kant_sql.planning
from kant_sql.factory import FAMILIES
from tests.support.parts import DAOS, FRONTS
from tests.support.worlds.robots import robot_at

MODULES = (kant_sql, kant_sql.aio, kant_sql.operations, kant_sql.pddl, kant_sql.planning)
# Two states of one kind, in the order of `git diff A B`; from and to, in that of `cp`; what is done
# and who does it, in that of `map`; a name and what it names, in that of `setattr`.
KNOWN_ORDER = {"diff", "backup", "execute", "KeptRules.save"}
POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def is_plain_data(cls: type) -> bool:
    """Whether the order of a constructor's arguments is fixed by what the class is.

    That is so of DTOs and the nodes of formulas, whose order the design fixes, of records, which
    the library makes and others only read, and of exceptions, which are pickled by position.
    """
    kinds = (tuple, BaseException, kant_sql.KnowledgeState)
    return dataclasses.is_dataclass(cls) or issubclass(cls, kinds)


def public(module: ModuleType) -> Iterator[tuple[str, Any]]:
    for name in module.__all__:
        yield f"{module.__name__}.{name}", getattr(module, name)


def reachable_classes() -> dict[type, str]:
    """All classes that a user gets in hand: exported, or a part of an open knowledge base."""
    found = {
        value: name
        for module in MODULES
        for name, value in public(module)
        if inspect.isclass(value)
    }
    with kant_sql.connect("sqlite://") as kb:
        makers = [name for name in dir(kb.store.factory) if name.startswith("create_")]
        assert len(makers) >= 17
        for name in makers:
            part = type(getattr(kb.store.factory, name)())
            found |= {cls: cls.__name__ for cls in part.__mro__}
    found |= dict.fromkeys(FAMILIES.values(), "family")
    for hint in [*FRONTS.values(), *DAOS.values()]:
        found |= {cls: cls.__name__ for cls in hint.__mro__}
    return {cls: name for cls, name in found.items() if cls.__module__.startswith("kant_sql")}


def is_own(method: Any) -> bool:
    return inspect.isfunction(method) and method.__module__.startswith("kant_sql")


def callables() -> Iterator[tuple[str, Callable[..., Any], bool]]:
    """Every public callable: its name, itself, and whether its first parameter is `self`."""
    for module in MODULES:
        for name, value in public(module):
            if inspect.isfunction(value):
                yield name, value, False
    for cls, name in reachable_classes().items():
        # What reads a store, behind the front door, is made by factories alone.
        if not is_plain_data(cls) and not cls.__name__.lstrip("_").startswith("Sql"):
            yield f"{name}()", inspect.getattr_static(cls, "__init__"), True
        for attribute, method in inspect.getmembers(cls, is_own):
            if not attribute.startswith("_"):
                yield f"{name}.{attribute}", method, True


def positional(function: Callable[..., Any], is_method: bool) -> list[str]:
    parameters = inspect.signature(function).parameters.values()
    return [one.name for one in parameters if one.kind in POSITIONAL][is_method:]


def test_from_the_second_argument_on_all_are_keywords() -> None:
    found = list(callables())
    assert len(found) > 400
    assert {name.rsplit(".", 1)[-1] for name, *_ in found} >= {"transaction", "restore", "set"}
    too_many = {
        name: positional(function, is_method)
        for name, function, is_method in found
        if len(positional(function, is_method)) > 1
        and not KNOWN_ORDER & {name, name.rsplit(".", 1)[-1]}
    }
    assert too_many == {}


def test_what_a_revision_says_of_itself_is_never_told_by_position() -> None:
    with kant_sql.connect("sqlite://") as kb:
        anyhow: Any = kb
        kb.propositions.save(robot_at())
        for call in (
            lambda: anyhow.transaction("moving"),
            lambda: anyhow.store.factory.transaction("moving"),
            lambda: anyhow.restore(0, "it was better"),
            lambda: anyhow.function_values.set("battery", ["rb1"], 3),
            lambda: kant_sql.connect("sqlite://", "tiago"),  # type: ignore[call-arg]
        ):
            with pytest.raises(TypeError, match="positional argument"):
                call()
        assert kb.revision == 1
