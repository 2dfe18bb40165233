"""One kind of argument everywhere: text beside each DTO and node, words beside each time.

What is checked is read off the signatures of all that a knowledge base has.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterable, Iterator
from datetime import datetime
from types import UnionType
from typing import Any

import kant_sql
from kant_sql import KnowledgeBase
from kant_sql.dto import Dto
from kant_sql.dto.formulas import Node
from tests.support.parts import PATHS, part


def parameters(kb: KnowledgeBase) -> Iterator[tuple[str, Any]]:
    """Each parameter of each method: its place, and its annotation with type variables replaced."""
    for path in PATHS:
        of = part(kb, path)
        for name in dir(type(of)):
            method = getattr(type(of), name)
            if name.startswith("_") or not inspect.isfunction(method):
                continue
            known: dict[Any, Any] = variables(type(of))
            hints = typing.get_type_hints(method, include_extras=True) if has_hints(method) else {}
            for given in inspect.signature(method).parameters.values():
                if given.name in hints:
                    yield f"{path}.{name}({given.name})", replaced(hints[given.name], known)


def has_hints(method: Any) -> bool:
    try:
        typing.get_type_hints(method)
    except NameError:
        # A class of an optional package.
        return False
    return True


def variables(cls: type) -> dict[Any, Any]:
    """What the type variables of the interfaces of a DAO stand for."""
    known: dict[Any, Any] = {}
    for base in cls.__mro__:
        for generic in getattr(base, "__orig_bases__", ()):
            origin = typing.get_origin(generic)
            if origin in (None, typing.Generic):
                continue
            names = getattr(origin, "__parameters__", ())
            for name, value in zip(names, typing.get_args(generic), strict=False):
                known.setdefault(name, replaced(value, known))
    return known


def replaced(hint: Any, known: dict[Any, Any]) -> Any:
    for _ in range(4):
        names = [each for each in getattr(hint, "__parameters__", ()) if each in known]
        if isinstance(hint, typing.TypeVar):
            hint = known.get(hint, hint)
        elif names:
            hint = hint[tuple(known.get(each, each) for each in hint.__parameters__)]
    return hint


def alternatives(hint: Any) -> Iterator[set[Any]]:
    """The classes that may stand at one place: those of the argument, and of its items."""
    members = typing.get_args(hint) if is_union(hint) else (hint,)
    yield {typing.get_origin(each) or each for each in members}
    for each in members:
        origin = typing.get_origin(each)
        if inspect.isclass(origin) and issubclass(origin, Iterable):
            for item in typing.get_args(each):
                yield from alternatives(item)


def is_union(hint: Any) -> bool:
    return typing.get_origin(hint) in (typing.Union, UnionType)


def test_whoever_takes_a_dto_a_node_or_a_time_takes_its_text() -> None:
    checked, lacking = set(), []
    with kant_sql.connect("sqlite://") as kb:
        for place, hint in parameters(kb):
            for classes in alternatives(hint):
                named = {each for each in classes if inspect.isclass(each)}
                wanted = [each for each in named if issubclass(each, Dto | Node | datetime)]
                checked |= {place} if wanted else set()
                lacking += [place] if wanted and str not in named else []
    assert sorted(lacking) == []
    assert len(checked) > 120
    assert checked >= {"types.save(dto)", ".at(when)", "pddl.metric.set(metric)", ".log(element)"}


def test_the_words_of_the_command_line_are_times_wherever_a_time_is_given() -> None:
    with kant_sql.connect("sqlite://") as kb:
        with kb.transaction(observed_at="2 minutes ago"):
            kb.objects.save("rb1 - robot")
        [revision] = kb.store.revisions("yesterday")
        assert revision.observed_at is not None
        assert 119 < (revision.committed_at - revision.observed_at).total_seconds() < 130
        for call in (
            lambda: kb.at("1 hour ago").revision == 0,
            lambda: kb.diff("yesterday", "now")[0].text == "rb1 - robot",
            lambda: next(iter(kb.log("yesterday"))).revision == revision,
            lambda: next(iter(kb.changes("2 hours ago"))).revision == revision,
            lambda: kb.watch("last monday", timeout=0) == 1,
            lambda: kb.timeline("yesterday", until="now"),
            lambda: [*kb.when("(= ?a ?b)", since="yesterday", until="now", parameters="?a ?b")],
            lambda: kb.pddl.check_rules("(always (= rb1 rb1))", since="yesterday", until="now"),
            lambda: kb.restore("yesterday") or True,
        ):
            assert call()
        assert kb.objects.get_all() == []
