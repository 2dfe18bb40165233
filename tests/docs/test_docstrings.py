"""A public docstring stands once and is inherited, its examples run, and its types are public."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pydoc
import re
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow
import pytest

import kant_sql
from kant_sql import KnowledgeBase, PddlPropositionDto
from kant_sql.factory import DaoFactory
from kant_sql.plans import PlanDao
from tests.docs.test_docs import ROOT
from tests.support.modules import import_all
from tests.support.parts import DAOS, FRONTS, PATHS, part
from tests.support.worlds.robots import RB1, ROBOT, ROBOT_AT, WAYPOINT, WP1, WP2

INDEX = (ROOT / "docs" / "api" / "index.md").read_text(encoding="utf-8")
PUBLIC = [importlib.import_module(name) for name in re.findall(r"^\| \[`([\w.]+)`\]", INDEX, re.M)]
MODULES = import_all()


# The methods that questions of a state were made into.
QUESTIONS = [
    (cls, name)
    for cls in FRONTS.values()
    for name in dir(cls)
    if name[0] != "_" and hasattr(getattr(cls, name), "__wrapped__")
]
BOUND = {f"{cls.__module__}.{cls.__name__}.{name}" for cls, name in QUESTIONS}


FINDER = doctest.DocTestFinder(exclude_empty=True)
EXAMPLES = {
    test.name: test
    for module in (kant_sql, *MODULES)
    for test in FINDER.find(module)
    # A descriptor of `aio` has the docstring of the method that it calls; a bound question its own.
    if test.examples and not test.name.startswith("kant_sql.aio.Async") and test.name not in BOUND
}


@pytest.mark.usefixtures("closed_stores")
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_examples_of_a_docstring_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    test = EXAMPLES[name]
    # What the example of `connect` begins with.
    test.globs |= {name: getattr(kant_sql, name) for name in kant_sql.__all__}
    test.globs |= {"robot": ROBOT, "wp": WAYPOINT, "robot_at": ROBOT_AT}
    test.globs |= {"rb1": RB1, "wp1": WP1, "wp2": WP2}
    with kant_sql.connect("sqlite://", knowledge_base="tiago", actor="perception") as kb:
        kb.propositions.save(PddlPropositionDto(ROBOT_AT, [RB1, WP1]))
        flags = doctest.ELLIPSIS | doctest.IGNORE_EXCEPTION_DETAIL
        said: list[str] = []
        result = doctest.DocTestRunner(optionflags=flags).run(
            doctest.DocTest(test.examples, test.globs | {"kb": kb}, *place(test)), out=said.append
        )
    assert result.attempted > 0
    assert result.failed == 0, "".join(said)


def place(test: doctest.DocTest) -> tuple[str, str | None, int | None, str | None]:
    return test.name, test.filename, test.lineno, test.docstring


def test_what_users_call_first_has_an_example() -> None:
    wanted = {
        "kant_sql.knowledge_base.connect",
        "kant_sql.aio.connect",
        "kant_sql.factory.DaoFactory.transaction",
        "kant_sql.knowledge_base.KnowledgeBase.at",
        "kant_sql.documents.exchange.load_domain",
        "kant_sql.reasoning.search.plan",
        "kant_sql.knowledge_base.KnowledgeBase.diff",
        *(f"kant_sql.history.{name}.{name}" for name in ("log", "restore")),
        *(f"kant_sql.dao.interfaces.AnyDao.{name}" for name in ("save", "get_all", "delete")),
    }
    assert wanted - EXAMPLES.keys() == set()


def interfaces(cls: type) -> list[type]:
    """The classes that state what a part of a knowledge base does, most general last."""
    return [
        base
        for base in cls.__mro__
        if base.__module__.endswith(".interfaces") or base in (DaoFactory, PlanDao)
    ]


def methods(cls: type) -> Iterator[tuple[str, Any]]:
    for name, method in vars(cls).items():
        if not name.startswith("_") and (
            inspect.isfunction(method) or isinstance(method, property)
        ):
            yield name, method


def parts(kb: KnowledgeBase) -> dict[str, object]:
    return {"factory": kb.store.factory, **{path: part(kb, path) for path in PATHS}}


def test_each_docstring_stands_once_and_is_inherited() -> None:
    stated = 0
    with kant_sql.connect("sqlite://") as kb:
        for role, of in parts(kb).items():
            seen: set[str] = set()
            for interface in interfaces(type(of)):
                for name, method in methods(interface):
                    if name in seen or name.startswith("create_"):
                        continue
                    seen.add(name)
                    stated += 1
                    got = inspect.getattr_static(type(of), name)
                    shown = got if isinstance(got, property) else getattr(of, name)
                    assert inspect.getdoc(shown) == inspect.getdoc(method), f"{role}.{name}"
            for cls in set(type(of).__mro__) - set(interfaces(type(of))) - {*FRONTS.values()}:
                own = {name for name, method in methods(cls) if method.__doc__} & seen
                assert own == set(), f"{cls.__name__} repeats {own}"
    assert stated + len(QUESTIONS) > 150


@pytest.mark.parametrize(("cls", "name"), QUESTIONS)
def test_a_method_is_the_question_that_it_binds(cls: type, name: str) -> None:
    bound = inspect.getattr_static(cls, name)
    asked = bound.__wrapped__
    assert inspect.getdoc(bound) == inspect.getdoc(asked)
    _, *parameters = inspect.signature(asked).parameters.values()
    assert [*inspect.signature(bound).parameters.values()][1:] == parameters
    described = (inspect.getdoc(bound) or "").partition("\nArgs:\n")[2].partition("\n\n")[0]
    said = re.findall(r"^    \**(\w+): ", described, re.M)
    assert said == [parameter.name for parameter in parameters if described]


def test_help_shows_signature_and_docstring() -> None:
    with kant_sql.connect("sqlite://") as kb:
        for method, words in (
            (kb.propositions.save, ("save(dto: 'FactLike | Sequence[FactLike]')", "Save a fact.")),
            (kb.log, ("log(since: 'When | None' = None", "Read revisions and their changes")),
            (kb.load_domain, ("load_domain(*sources: 'Source'", "Load a domain")),
            (kb.transaction, ("transaction(*, actor: 'str | None' = None", "Make many calls")),
        ):
            # Since Python 3.13 each parameter of a long signature has its own line.
            text = " ".join(pydoc.plain(pydoc.render_doc(method)).split()).replace("( ", "(")
            assert [word for word in words if word not in text] == []


def public_objects() -> Iterator[tuple[str, Any]]:
    for module in PUBLIC:
        for name in module.__all__:
            yield f"{module.__name__}.{name}", getattr(module, name)


def annotated(value: Any) -> Iterator[Any]:
    """A public function, or a public class with its methods and those that it inherits."""
    yield value
    if inspect.isclass(value):
        for name, member in inspect.getmembers(value):
            function = member.fget if isinstance(member, property) else member
            if inspect.isfunction(function) and not name.startswith("_"):
                yield function


def classes_in(hint: Any) -> Iterator[type]:
    arguments = typing.get_args(hint)
    if isinstance(hint, list):
        arguments = tuple(hint)
    if inspect.isclass(hint) and not isinstance(hint, types.GenericAlias):
        yield hint
    for argument in (typing.get_origin(hint), *arguments):
        if argument is not None and argument is not hint:
            yield from classes_in(argument)


def hints(value: Any) -> list[Any]:
    if not (inspect.isclass(value) or inspect.isfunction(value)):
        return []
    # These packages are optional: their classes are not the library's.
    optional = {"UpProblem": object, "Environment": object, "Figure": object}
    found = typing.get_type_hints(value, localns={**optional, "pyarrow": pyarrow})
    return [hint for name, hint in found.items() if not name.startswith("_")]


def test_every_class_in_a_public_annotation_is_public() -> None:
    public = {id(value) for _, value in public_objects()}
    lost = {
        f"{cls.__module__}.{cls.__qualname__} of {name}"
        for name, value in public_objects()
        for each in annotated(value)
        for hint in hints(each)
        for cls in classes_in(hint)
        if cls.__module__.startswith("kant_sql") and id(cls) not in public
    }
    assert len(public) > 150
    assert sorted(lost) == []


def test_the_parts_of_an_asynchronous_knowledge_base_are_public() -> None:
    from kant_sql.aio import AsyncKnowledgeBase, _Door

    public = {id(value) for _, value in public_objects()}
    with kant_sql.connect("sqlite://") as kb:
        door = _Door(kb)
        opened = AsyncKnowledgeBase(door, kb=kb)
        daos = [part(opened, path) for path in PATHS]
    assert len(daos) == len(DAOS) + len(FRONTS) == 22
    assert {type(dao).__name__ for dao in daos if id(type(dao)) not in public} == set()
