"""Programs of DAO calls: runs them on a store or on the model, and generates them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

from hypothesis import strategies as st

from kant_sql import (
    KantSqlError,
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
)
from tests.support.atoms import Atoms
from tests.support.model import Model
from tests.support.parts import dao_of
from tests.support.reading import versions
from tests.support.worlds.depot import again

DAOS = ("types", "objects", "predicates", "actions", "propositions")


class Boom(Exception):
    """An error that a component of the robot raises during its work."""


class Items:
    """The items for `save_all`, one by one; they may end with an error."""

    def __init__(self, dtos: list[Any], breaks: bool = False) -> None:
        self.dtos = dtos
        self.breaks = breaks

    def __iter__(self) -> Iterator[Any]:
        yield from self.dtos
        if self.breaks:
            raise Boom

    def __repr__(self) -> str:
        return f"Items({self.dtos!r}, {self.breaks!r})"


class Call(NamedTuple):
    """A call of a DAO."""

    dao: str
    method: str
    arguments: tuple[Any, ...] = ()
    cascade: bool = False


class At(NamedTuple):
    """A call on the past."""

    revision: int
    call: Call


class Block(NamedTuple):
    """A transaction, perhaps one that fails at its end or on entry."""

    steps: list[Any]
    fails: bool = False
    expected_revision: int | None = None


Step = Call | At | Block


class Program(NamedTuple):
    """Steps, each with the number of its process."""

    steps: list[tuple[int, Step]]
    is_tight: bool


def run(kb: Any, step: Step) -> list[object]:
    """Execute a step, and return its results."""
    try:
        if isinstance(step, At):
            return run(kb.at(step.revision), step.call)
        if isinstance(step, Block):
            return _run_block(kb, step)
        method = getattr(_dao(kb, step.dao), step.method)
        options = {"cascade": True} if step.cascade else {}
        return [repr(method(*step.arguments, **options)), kb.revision]
    except (KantSqlError, Boom) as error:
        # Items are read ahead: the error may come from their end or from one of them.
        breaks = isinstance(step, Call) and any(
            getattr(part, "breaks", 0) for part in step.arguments
        )
        return ["Boom" if breaks else type(error).__name__, kb.revision]


def _dao(kb: Any, name: str) -> Any:
    """Return the DAO with a name; `propositions` takes facts and goals, as in the model."""
    is_real = not isinstance(kb, Model)
    return Atoms(kb) if is_real and name == "propositions" else dao_of(kb, name)


def _run_block(kb: Any, block: Block) -> list[object]:
    outcomes: list[object] = []
    try:
        with kb.transaction(expected_revision=block.expected_revision):
            for step in block.steps:
                outcomes += run(kb, step)
            if block.fails:
                raise Boom
    except Boom:
        outcomes.append("undone")
    return [*outcomes, kb.revision]


def state_of(kb: Any) -> dict[str, str]:
    """Return everything that the DAOs read."""
    return {dao: repr(_dao(kb, dao).get_all()) for dao in DAOS}


# Facts and goals have one table.
TABLES = {"fact": "proposition", "goal": "proposition"}


def check(processes: list[KnowledgeBase], program: Program) -> None:
    """Run a program on processes that share a knowledge base, and on the model, step by step."""
    model = Model()
    for number, step in program.steps:
        assert run(processes[number], step) == run(model, step), f"{processes[number]!r}: {step}"
    newcomer = again(processes[0])
    for kb in (*processes, newcomer):
        assert state_of(kb) == state_of(model)
    for revision in range(model.revision + 1):
        assert state_of(newcomer.at(revision)) == state_of(model.at(revision))
    assert [[*map(tuple, entry.changes)] for entry in newcomer.log()][::-1] == model.changes()
    # The tables have no version that the log does not mention.
    came = Counter(
        TABLES.get(kind, kind)
        for lines in model.changes()
        for sign, kind, _ in lines
        if sign == "+"
    )
    for kind in ("type", "object", "predicate", "action", "proposition"):
        assert len(versions(newcomer, kind)) == came[kind], kind


# Makers of programs: their parts fit together, except for a limited number of odd ones.

PARENTS = {"thing": None, "robot": "thing", "place": "thing", "Straße": None, "object": None}
OBJECTS = {"rb1": "robot", "wp1": "place", "\U0001f916": "robot", "o--x": "thing"}
PREDICATES = {"at": ["robot", "place"], "near": ["thing"], "calm": []}
PARAMETERS = {"r": "robot", "s": "place", "rb1": "place"}
BAD_NAMES = ["", "a b", "x" * 256, "a\0b", "\ud800", "either"]


def fits(own: str | None, wanted: str) -> bool:
    return own == wanted or (own is not None and fits(PARENTS[own], wanted))


class Maker:
    """Makes DTOs."""

    def __init__(self, draw: st.DrawFn) -> None:
        self.draw = draw
        self._odd_things = self.one_of(0, 0, 0, 1, 1, 3)

    def one_of(self, *options: Any) -> Any:
        return self.draw(st.sampled_from(options))

    def pick(self, usual: Any, *odd: Any) -> Any:
        """Return the usual value, or from time to time an odd one."""
        if self._odd_things and self.one_of(0, 0, 1):
            self._odd_things -= 1
            return self.one_of(*odd)
        return usual

    def spelled(self, name: str) -> str:
        spelling = self.one_of(name, name, name.upper(), name.title())
        return str(self.pick(spelling, *BAD_NAMES))

    def any_type(self) -> PddlTypeDto:
        """Return any type with any parent, so types are redefined."""
        above = self.one_of(None, *map(PddlTypeDto, PARENTS))
        return PddlTypeDto(self.one_of(*PARENTS), parent=above)

    def type(self, name: str | None = None) -> PddlTypeDto:
        name = name or self.one_of(*PARENTS)
        above = self.pick(self.one_of(None, PARENTS[name]), *PARENTS, None)
        return PddlTypeDto(self.spelled(name), parent=None if above is None else self.type(above))

    def object(self, wanted: str = "object", names: Any = OBJECTS) -> PddlObjectDto:
        fitting = [name for name, own in names.items() if wanted == "object" or fits(own, wanted)]
        name = self.pick(self.one_of(*fitting or names), *names)
        return PddlObjectDto(self.type(self.pick(names[name], *PARENTS)), self.spelled(name))

    def predicate(self, name: str | None = None) -> PddlPredicateDto:
        name = name or self.one_of(*PREDICATES)
        types = self.pick(PREDICATES[name], ["place"], ["object", "place"], ["thing"], [])
        return PddlPredicateDto(self.spelled(name), map(self.type, types))

    def arguments(self, predicate: str, names: Any = OBJECTS) -> list[PddlObjectDto]:
        wanted = self.pick(PREDICATES[predicate], ["thing"], ["place", "robot"], [])
        return [self.object(type_, names) for type_ in wanted]

    def proposition(self) -> PddlPropositionDto:
        name = self.one_of("at", *PREDICATES)
        predicate, arguments = self.predicate(name), self.arguments(name)
        return PddlPropositionDto(predicate, arguments, self.one_of(False, False, True))

    def literal(self, durative: bool, names: dict[str, str]) -> PddlConditionEffectDto:
        name = self.one_of(*PREDICATES)
        times = ["at start", "over all", "at end"]
        time = self.pick(self.one_of(*times), None) if durative else self.pick(None, *times)
        predicate, terms = self.predicate(name), self.arguments(name, names)
        return PddlConditionEffectDto(predicate, terms, time, self.one_of(False, True))

    def action(self) -> PddlActionDto:
        durative = self.one_of(False, True)
        chosen = self.one_of([], ["s"], ["r", "s"], ["r", "s", "rb1"]) + self.pick([], ["s"])
        names = OBJECTS | {name: PARAMETERS[name] for name in chosen}
        conditions, effects = (
            [self.literal(durative, names) for _ in range(self.one_of(0, 1, 2))] for _ in "ce"
        )
        return PddlActionDto(
            self.one_of("go", "GO", "wait"),
            [PddlObjectDto(self.type(PARAMETERS[name]), name) for name in chosen],
            conditions,
            effects,
            durative,
            duration=self.pick(self.one_of(10, 10.0, 2.5, 0), -1),
        )


READS = ["get_all", "get_goals", "get_no_goals", "get_by_predicate", "get"]
WRITES = ["save", "save", "save", "insert", "update", "save_all", "delete", "delete"]


class CallMaker:
    """Makes calls, most of them on a small pool of elements, so they interact."""

    def __init__(self, draw: st.DrawFn, pool: dict[str, list[Any]]) -> None:
        self._draw = draw
        self._pool = pool

    def dto(self, dao: str) -> Any:
        maker = Maker(self._draw)
        if self._pool[dao] and maker.one_of(0, 1, 1):
            return maker.one_of(*self._pool[dao])
        make = maker.any_type if dao == "types" and maker.one_of(0, 1) else getattr(maker, dao[:-1])
        dto = make()
        self._pool[dao].append(dto)
        return dto

    def call(self) -> Call:
        one_of = Maker(self._draw).one_of
        dao = one_of(*DAOS, "propositions", "propositions")
        method = one_of(*WRITES, *READS, *WRITES, "delete_all")
        if dao == "propositions" and method == "get":
            method = "get_all"
        if dao != "propositions" and method in READS:
            method = one_of("get", "get_all")
        if method in ("get_all", "get_goals", "get_no_goals", "delete_all"):
            return Call(dao, method)
        if method == "save_all":
            items = [self.dto(dao) for _ in range(one_of(0, 1, 2, 3, 4))]
            return Call(dao, method, (Items(items, one_of(*[False] * 7, True)),))
        dto = self.dto(dao)
        if method in ("get", "get_by_predicate"):
            return Call(dao, method, (dto.name if method == "get" else dto.predicate.name,))
        redefines = dao in ("types", "objects", "predicates") and method in ("save", "update")
        return Call(dao, method, (dto,), redefines and one_of(False, True))

    def steps(self, depth: int = 0) -> list[Step]:
        """Return one step, or two related ones."""
        one_of = Maker(self._draw).one_of
        kind = one_of(*["call"] * 6, *["block"] * (3 if depth < 3 else 0), "at", "there and back")
        if kind == "call":
            return [self.call()]
        if kind == "at":
            return [At(one_of(0, 1, 1, 2, -1), self.call())]
        if kind == "there and back":
            return self.there_and_back()
        steps = [step for _ in range(one_of(0, 1, 2, 3, 4)) for step in self.steps(depth + 1)]
        return [Block(steps, one_of(False, False, True), one_of(*[None] * 9, 0, 1))]

    def there_and_back(self) -> list[Step]:
        """Return a transaction that may change nothing in the end, and a call that shows it."""
        one_of = Maker(self._draw).one_of
        dao = one_of(*["propositions"] * 5, *DAOS)
        dto, other = self.dto(dao), self.dto("propositions")
        there, back = one_of(("save", "delete"), ("delete", "save"))
        between = one_of(
            Call("propositions", "get_all"),
            Call("propositions", "save_all", (Items([other]),)),
            self.call(),
        )
        block = Block([Call(dao, there, (dto,)), between, Call(dao, back, (dto,))])
        return [block, Call(dao, one_of("delete", "insert", "save"), (dto,))]


def home_world() -> Block:
    """Return an initial world, so short programs have something to redefine and delete."""
    literal = PddlConditionEffectDto
    type_ = {
        name: PddlTypeDto(name, parent=None if parent is None else PddlTypeDto(parent))
        for name, parent in PARENTS.items()
    }
    object_ = {name: PddlObjectDto(type_[own], name) for name, own in OBJECTS.items()}
    predicate = {
        name: PddlPredicateDto(name, [type_[own] for own in listed])
        for name, listed in PREDICATES.items()
    }
    there = PddlPropositionDto(predicate["at"], [object_["rb1"], object_["wp1"]])
    near = PddlPropositionDto(predicate["near"], [object_["o--x"]], is_goal=True)
    place = PddlObjectDto(type_["place"], "s")
    action = PddlActionDto(
        "go",
        [place],
        [literal(predicate["near"], [place], "at start")],
        [literal(predicate["at"], [object_["rb1"], place], "at end", is_negative=True)],
    )
    facts = Call("propositions", "save_all", (Items([there, near]),))
    return Block([facts, Call("actions", "save", (action,))])


@st.composite
def programs(draw: st.DrawFn) -> Program:
    maker = CallMaker(draw, {dao: [] for dao in DAOS})
    steps: list[tuple[int, Step]] = [(0, home_world())] if draw(st.integers(0, 3)) else []
    for _ in range(draw(st.integers(4, 14))):
        process = draw(st.integers(0, 1))
        steps += [(process, step) for step in maker.steps()]
    return Program(steps, draw(st.booleans()))
