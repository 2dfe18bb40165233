"""Values that fit nowhere, and every public callable to call with them."""

from __future__ import annotations

import contextlib
import inspect
import itertools
import random
import re
import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from enum import Enum
from fractions import Fraction
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, is_typeddict

import kant_sql
import kant_sql.compat
import kant_sql.dto.formulas
import kant_sql.pddl
import kant_sql.planning
from kant_sql import (
    Dto,
    KantSqlError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlEitherTypeDto,
    PddlEventDto,
    PddlFunctionDto,
    PddlFunctionValueDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlProcessDto,
    PddlPropositionDto,
    PddlTypeDto,
    Plan,
    PlanStep,
)
from kant_sql.dto import formulas as f
from kant_sql.operations import Anchor
from tests.support.parts import PATHS, part
from tests.support.worlds import depot
from tests.support.worlds.robots import assigned

MODULES = (*(kant_sql, kant_sql.pddl, kant_sql.planning, kant_sql.compat),)


class Hostile(Exception):
    """The error that hostile objects raise."""


def hostile(name: str, answer: object = Hostile) -> object:
    """Make an object with one special method that raises or returns nonsense."""

    def method(*_: object) -> object:
        if answer is Hostile:
            raise Hostile(name)
        return answer

    return type(f"Bad{name.strip('_').title()}", (), {name: method})()


def looped_type() -> PddlTypeDto:
    own = PddlTypeDto("own")
    own.parent = own
    return own


def looped_either() -> PddlEitherTypeDto:
    either = PddlEitherTypeDto([PddlTypeDto("one")])
    either.types.append(either)
    return either


def looped_list() -> list[Any]:
    items: list[Any] = []
    items.append(items)
    return items


def tall_type() -> PddlTypeDto:
    top = PddlTypeDto("top")
    for number in range(3_000):
        top = PddlTypeDto(f"t{number}", parent=top)
    return top


def bounded() -> Iterator[int]:
    """Yield numbers, as if without end."""
    yield from range(20_000)
    raise AssertionError("what never ends was read to its end")


def raising() -> Iterator[object]:
    yield depot.IDLE
    raise Hostile("the caller's own generator")


ROBOT, WP = PddlTypeDto("truck"), PddlTypeDto("place")
WP_OBJECT = PddlObjectDto(WP, "p1")
FACT = PddlPropositionDto(PddlPredicateDto("at", [ROBOT, WP]), [PddlObjectDto(ROBOT, "t1")])
# Immutable values, by their repr.
CONSTANTS: tuple[Any, ...] = (
    *(None, True, 0, -1, 2**63, 1.5, float("nan"), float("inf"), float("-inf"), 1j, "", "x", " "),
    *(Decimal("NaN"), Decimal("sNaN"), Decimal("Infinity"), Decimal("1E+999999"), Fraction(1, 3)),
    *("a\0b", "\ud800", "(\udfff)", "(", "a\\b'\"--;", b"x", (), frozenset(), range(3), len),
    *(Mapping, PddlTypeDto, ..., NotImplemented, datetime(2026, 1, 31), datetime.max),
    *(datetime.max.replace(tzinfo=UTC), datetime.min.replace(tzinfo=UTC)),
    *(datetime(2026, 1, 31).date(), Path("/"), Path("/no/such/file.pddl"), Path("a\0b")),
)
# Each call makes a new value, because some can be used only once.
JUNK: dict[str, Callable[[], Any]] = {
    **{repr(value): lambda value=value: value for value in CONSTANTS},  # type: ignore[misc]
    "10**5000": lambda: 10**5000,
    "-10**5000": lambda: -(10**5000),
    "letters": lambda: "x" * 10_000,
    "nested text": lambda: "(" * 5_000,
    "10 MB": lambda: "x" * 10_000_000,
    "bytearray": lambda: bytearray(b"\xff"),
    "memoryview": lambda: memoryview(b"x"),
    "list": lambda: [],
    "list of None": lambda: [None],
    "list of lists": lambda: [[[]]],
    "list of str": lambda: ["x"],
    "list of its own": looped_list,
    "dict": lambda: {"x": 1},
    "set": lambda: {1, "x"},
    "generator": lambda: (None for _ in range(3)),
    "exhausted": lambda: iter(()),
    "without end": bounded,
    "raising generator": raising,
    "object": object,
    "lambda": lambda: lambda *_: None,
    "module": lambda: kant_sql,
    "exception": lambda: ValueError("x"),
    "type": lambda: PddlTypeDto("wp"),
    "name that is none": lambda: PddlTypeDto("a b"),
    "object DTO": lambda: PddlObjectDto(ROBOT, "t1"),
    "predicate": lambda: PddlPredicateDto("at", [ROBOT, WP]),
    "function DTO": lambda: PddlFunctionDto("fuel", [ROBOT]),
    "fact": lambda: FACT,
    "list of facts": lambda: [FACT, FACT],
    "literal": lambda: PddlConditionEffectDto(PddlPredicateDto("idle"), time="at noon"),
    "action": lambda: PddlActionDto("go", duration=[depot.IDLE]),
    "value": lambda: PddlFunctionValueDto(PddlFunctionDto("fuel", [ROBOT]), [], WP_OBJECT),
    "swapped fields": lambda: assigned(PddlObjectDto(ROBOT, "t1"), type="t1", name=ROBOT),
    "fact of None": lambda: assigned(PddlPropositionDto(FACT.predicate), predicate=None),
    "fact with a hostile flag": lambda: assigned(
        PddlPropositionDto(PddlPredicateDto("idle")), is_goal=hostile("__bool__")
    ),
    "name None": lambda: assigned(PddlTypeDto("x"), name=None),
    "hostile name": lambda: assigned(PddlTypeDto("x"), name=hostile("__str__")),
    "objects None": lambda: assigned(PddlPropositionDto(FACT.predicate), objects=None),
    "bare DTO": Dto,
    "own parent": looped_type,
    "either of itself": looped_either,
    "3,000 parents": tall_type,
    "atom": lambda: f.Atom("at", (f.Constant("t1"), f.Variable("p"))),
    "constant": lambda: f.Constant("t1"),
    "variable": lambda: f.Variable("x"),
    "number": lambda: f.Number(1),
    "metric": lambda: f.Metric("minimise", f.Fluent("fuel")),
    "modal": lambda: f.Modal("never", (), ()),
    "plan": lambda: Plan((PlanStep(None, "nosuch", ("x",)),), engine="x", status="x"),
    "anchor": lambda: Anchor("junk"),  # type: ignore[arg-type]
    **{
        f"bad {name}": lambda name=name: hostile(name)  # type: ignore[misc]
        for name in (
            *("__str__", "__repr__", "__eq__", "__hash__", "__iter__", "__len__", "__bool__"),
            *("__index__", "__float__", "__fspath__", "__call__", "__format__", "__lt__"),
            *("__contains__", "__getitem__", "__getattr__"),
        )
    },
    **{
        f"wrong {name}": lambda name=name: hostile(name, 5)  # type: ignore[misc]
        for name in ["__str__", "__repr__", "__iter__", "__fspath__", "__hash__", "__enter__"]
    },
}
# Errors of the caller's own code pass only while the library iterates over its items.
OWN_ERRORS = {"raising generator", "bad __call__"}
SLOW = {"10 MB"}
# The library makes other records itself: their constructors check nothing.
CHECKED = (
    *(Plan, PlanStep, f.TypedName, kant_sql.pddl.Action, kant_sql.pddl.Domain),
    *(kant_sql.pddl.Function, kant_sql.pddl.Predicate, kant_sql.pddl.Problem),
)
_COUNT = re.compile(
    r"missing \d+ required|positional argument|unexpected keyword|multiple values|takes no arg"
    r"|at least one source"
)


@dataclass
class World:
    """A knowledge base with some content, and the usual arguments of its callables."""

    kb: KnowledgeBase
    folder: Path
    base: int = 0
    calls: int = 0

    def __post_init__(self) -> None:
        kb = self.kb
        self.compat = kant_sql.compat.DaoFactory("sqlite://")
        if not kb.revision:
            depot.load(kb)
            kb.actions.save(PddlActionDto("rest", [PddlObjectDto(ROBOT, "t")], durative=False))
            kb.pddl.processes.save(PddlProcessDto("age"))
            kb.pddl.events.save(PddlEventDto("fail", [], [], [depot.IDLE]))
            kb.pddl.derived_predicates.save(self.formulas["derived_predicates"])
            kb.goals.save(depot.IDLE)
            kb.pddl.metric.set(self.formulas["metric"])
            kb.plans.record(self.plan)
        self.base = kb.revision
        self.recorded = kb.plans.get_all()[-1]

    plan = Plan((PlanStep(None, "rest", ("t1",)),), engine="x", status="x")
    dtos: typing.ClassVar[dict[str, Dto]] = {
        "types": PddlTypeDto("truck"),
        "objects": PddlObjectDto(ROBOT, "t1"),
        "predicates": PddlPredicateDto("idle"),
        "functions": PddlFunctionDto("fuel", [ROBOT]),
        "function_values": PddlFunctionValueDto(
            PddlFunctionDto("fuel", [ROBOT]), [PddlObjectDto(ROBOT, "t1")], 3
        ),
        "propositions": PddlPropositionDto(PddlPredicateDto("idle")),
        "actions": PddlActionDto("rest"),
        "processes": PddlProcessDto("age"),
        "events": PddlEventDto("fail"),
    }
    formulas: typing.ClassVar[dict[str, Any]] = {
        "derived_predicates": f.Derived("idle", (), f.Not(f.Not(f.Atom("idle")))),
        "timed_initial_literals": f.TimedLiteral(f.Number(1), f.Atom("idle")),
        "initial_literals": f.Not(f.Atom("idle")),
        "goals": f.Comparison(">", f.Fluent("fuel", (f.Constant("t1"),)), f.Number(1)),
        "constraints": f.Modal("always", (), (f.Atom("idle"),)),
        "domain_constraints": f.Modal("always", (), (f.Atom("idle"),)),
        "metric": f.Metric("minimize", f.Fluent("fuel", (f.Constant("t1"),))),
    }

    def usual(self, owner: str, name: str) -> Any:
        """Return the usual argument of a parameter, so only the others are wrong."""
        part = owner.rsplit(".", maxsplit=1)[-1]
        if name in ("dto", "formula", "metric"):
            return {**self.dtos, **self.formulas}.get(part, depot.IDLE)
        if name in ("dtos", "formulas"):
            return [{**self.dtos, **self.formulas}.get(part, depot.IDLE)]
        made = self.made().get(name)
        return self.values().get(name) if made is None else made()

    def made(self) -> dict[str, Callable[[], Any]]:
        """Return functions that make usual arguments, including slow ones."""
        kb = self.kb
        return {
            "domain": kb.pddl.domain,
            "problem": kb.pddl.problem,
            "document": kb.pddl.problem,
            "text": lambda: kb.store.anchor().text(),
        }

    def values(self) -> dict[str, Any]:
        """Return the other usual arguments, by the names of parameters."""
        scratch = f"sqlite:///{self.folder / 'scratch.db'}"
        return {
            "a": 1, "b": 0, "when": 1, "before": 1, "since": 1, "until": 1, "after": 0, "limit": 2,
            "timeout": 0, "mode": "merge", "strict": False, "dry_run": True, "cascade": False,
            "element": "idle", "name": "truck", "id_": self.recorded.id, "engine": None,
            "view": "fact",
            "url": scratch, "to": scratch, "uri": scratch, "knowledge_base": "tiago",
            "revision": "head", "function": "fuel", "objects": ["t1"], "value": 2, "by": 2,
            "sources": depot.DOMAIN, "source": depot.PROBLEM, "plan": self.plan,
            "step": self.recorded.steps[0], "status": "started", "variables": (), "names": (),
            "family": 2, "predicate_name": "idle", "parameters": None,
            "factory": self.kb.store.factory,
        }  # fmt: skip

    def subjects(self) -> dict[str, Callable[[], Any]]:
        """Return functions that make the objects whose methods are called, some of them slowly."""
        kb = self.kb
        compat = self.compat
        return {
            **{module.__name__: lambda module=module: module for module in MODULES},
            "factory": lambda: kb.store.factory,
            "past.factory": lambda: kb.at(self.base).store.factory,
            **{f"kb.{path}".rstrip("."): partial(part, kb, path) for path in PATHS},
            **{
                f"past.{path}".rstrip("."): lambda path=path: part(kb.at(self.base), path)
                for path in PATHS
            },
            **{f"dto.{name}": lambda dto=dto: dto for name, dto in self.dtos.items()},
            "dto.literal": lambda: PddlConditionEffectDto(PddlPredicateDto("idle")),
            "dto.either": lambda: PddlEitherTypeDto([ROBOT, WP]),
            **{
                f"compat.{made}": getattr(compat, f"create_pddl_{single}_dao")
                for made, single in (
                    ("types", "type"), ("objects", "object"), ("predicates", "predicate"),
                    ("propositions", "proposition"), ("actions", "action"),
                )
            },
            "compat.factory_method": kant_sql.compat.DaoFactoryMethod,
            "plan": lambda: self.plan,
            "recorded": lambda: self.recorded,
            "recorded.step": lambda: self.recorded.steps[0],
            "anchor": kb.store.anchor,
            "entry": lambda: next(iter(kb.log())),
            "verification": kb.store.verify,
        }  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One call: the callable, and which argument is junk."""

    owner: str
    method: str
    parameter: str | None
    junk: str

    def __str__(self) -> str:
        return f"{self.owner}.{self.method}({self.parameter}={self.junk})"


# Other tests cover closed objects.
_LEFT_OUT = {"close"}
_POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def functions(module: ModuleType) -> Iterator[tuple[str, Any]]:
    """Yield the public functions and classes of a module that can be called."""
    for name in module.__all__:
        value = getattr(module, name)
        is_class = inspect.isclass(value) and not inspect.isabstract(value)
        if (
            is_class
            and not (issubclass(value, BaseException | Enum) or value is Dto or is_typeddict(value))
        ) or inspect.isfunction(value):
            yield name, value


def methods(subject: object) -> Iterator[str]:
    """Yield the names of an object's public methods; for the drop-in's DAOs two more."""
    for name, _ in inspect.getmembers(type(subject), inspect.isfunction):
        is_drop_in = name in ("_save", "_update") and type(subject).__module__ == "kant_sql.compat"
        if is_drop_in or (name not in _LEFT_OUT and not name.startswith("_")):
            yield name


def signature(called: Any) -> list[inspect.Parameter]:
    return list(inspect.signature(called).parameters.values())


def cases(world: World) -> list[Case]:
    """List all calls."""
    found = []
    for owner, get in world.subjects().items():
        subject = get()
        is_module = isinstance(subject, ModuleType)
        names = [name for name, _ in functions(subject)] if is_module else methods(subject)
        for name in names:
            found += [Case(owner, name, None, "nothing"), Case(owner, name, None, "all")]
            for parameter in signature(getattr(subject, name)):
                found += [Case(owner, name, parameter.name, junk) for junk in JUNK]
    return found


def sample(found: list[Case], size: int | None, seed: int) -> list[Case]:
    """Choose some calls, without slow ones, or return all."""
    if size is None:
        return found
    chooser = random.Random(seed)
    quick = [case for case in found if case.junk not in SLOW]
    return chooser.sample(quick, size)


class Calling:
    """Makes calls, and judges the results."""

    def __init__(self, make: Callable[[], World], seed: int = 0) -> None:
        self._make = make
        self._world = make()
        self._random = random.Random(seed)
        self.faults: list[str] = []

    def call(self, case: Case) -> None:
        """Make a call; record faults of its result."""
        world = self._world
        world.calls += 1
        before = world.kb.revision
        called = getattr(world.subjects()[case.owner](), case.method)
        positional, keywords = self.arguments(case, signature(called))
        try:
            use(called(*positional, **keywords))
        except KantSqlError as error:
            self._judge_error(case, error)
            if world.kb.revision != before:
                self.faults.append(f"{case}: failed, and made a revision")
        except Exception as error:
            self._judge_other(case, error)
        self._check_store(case, before)

    def arguments(
        self, case: Case, parameters: list[inspect.Parameter]
    ) -> tuple[list[Any], dict[str, Any]]:
        """Return the arguments of a call, by position and by name."""
        if case.junk == "nothing":
            return [], {}
        positional: list[Any] = []
        keywords: dict[str, Any] = {}
        for parameter in parameters:
            if case.junk == "all":
                given = JUNK[self._random.choice([name for name in JUNK if name not in SLOW])]()
            elif parameter.name == case.parameter:
                given = JUNK[case.junk]()
            else:
                given = self._world.usual(case.owner, parameter.name)
                if given is None and parameter.default is not parameter.empty:
                    continue
                if given is None:
                    given = self._example(parameter)
            if parameter.kind in (*_POSITIONAL, parameter.VAR_POSITIONAL) and not keywords:
                positional.append(given)
            elif parameter.kind is not parameter.VAR_KEYWORD:
                keywords[parameter.name] = given
        return positional, keywords

    def _example(self, parameter: inspect.Parameter) -> Any:
        """Return an example for the annotation of a constructor's parameter."""
        text = str(parameter.annotation)
        examples: list[tuple[str, Any]] = [
            ("Iterable[PddlTypeDto]", [ROBOT]), ("PddlTypeDto", ROBOT),
            ("PddlFunctionDto", self._world.dtos["functions"]),
            ("PddlPredicateDto", PddlPredicateDto("idle")), ("tuple[", ()),
            ("Fluent", f.Fluent("f")), ("Expression", f.Number(1)), ("Formula", depot.IDLE),
            ("Atom", depot.IDLE), ("Term", f.Constant("c")), ("Number", f.Number(1)),
            ("bool", True), ("int", 1), ("Sequence[", ()), ("Iterable[Verdict]", ()), ("str", "x"),
        ]  # fmt: skip
        return next((value for key, value in examples if key in text), None)

    def _judge_error(self, case: Case, error: KantSqlError) -> None:
        message = str(error)
        if not message or len(message) > 2_000:
            self.faults.append(f"{case}: a message of {len(message)} characters")

    def _judge_other(self, case: Case, error: Exception) -> None:
        if isinstance(error, TypeError) and _COUNT.search(str(error)) and is_binding(error):
            return
        if isinstance(error, Hostile) and case.junk in (*OWN_ERRORS, "all"):
            return
        trace = error.__traceback__
        while trace is not None and trace.tb_next is not None:
            trace = trace.tb_next
        assert trace is not None
        place = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}"
        self.faults.append(f"{case}: {type(error).__name__}: {str(error)[:100]} at {place}")

    def _check_store(self, case: Case, before: int) -> None:
        world = self._world
        store: Any = world.kb.store.factory._store  # type: ignore[attr-defined]
        if store.current() is not None:
            self.faults.append(f"{case}: left a transaction open")
        if world.kb.revision != before:
            verified = world.kb.store.verify()
            if not verified.is_intact:
                self.faults.append(f"{case}: {verified.findings[:2]}")
            world.kb.restore(world.base)
            if world.kb.revision > world.base + 60:
                world.kb.close()
                self._world = self._make()


def is_binding(error: BaseException) -> bool:
    """Return whether an error is from binding the arguments, possibly behind a wrapper."""
    depth, trace = 0, error.__traceback__
    while trace is not None:
        depth, trace = depth + 1, trace.tb_next
    return depth <= 2


def use(result: Any) -> None:
    """Use a result as a caller would: evaluate lazy ones, run blocks."""
    if isinstance(result, Iterator):
        list(itertools.islice(result, 3))
    elif isinstance(result, KnowledgeBase | kant_sql.DaoFactory):
        result.revision  # noqa: B018
    elif isinstance(result, contextlib.AbstractContextManager):
        with result:
            pass
    elif isinstance(result, (Dto, kant_sql.dto.formulas.Node, *CHECKED)):
        str(result)
        hash(result)
        assert result == result
