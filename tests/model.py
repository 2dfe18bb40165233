"""A plain Python model of a knowledge base: what every store must answer, by none of its means.

It is written from what `kant_sql/dao/interfaces.py` states and is as simple as that allows: a state
is a few dictionaries, a transaction copies them, and each revision is kept whole. `Model` looks
like a `KnowledgeBase`, so that one program runs on both.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

from kant_sql import (
    PddlActionDto,
    PddlConditionEffectDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    ReadOnlyError,
    StaleRevisionError,
    UnknownRevisionError,
)
from tests.model_state import Action, ModelState, fold, key_of


def dto_of(state: ModelState, kind: str, key: Any) -> Any:
    name, value = state.known[kind][key], state.held[kind][key]
    if kind == "type":
        return PddlTypeDto(name, parent=None if value is None else dto_of(state, "type", value))
    if kind == "object":
        return PddlObjectDto(dto_of(state, "type", value), name)
    if kind == "predicate":
        return PddlPredicateDto(name, [dto_of(state, "type", type_) for type_ in value])
    if kind == "atom":
        predicate = dto_of(state, "predicate", key.predicate)
        objects = [dto_of(state, "object", object_) for object_ in key.arguments]
        return PddlPropositionDto(predicate, objects, key.is_goal)
    return _action_dto(state, name, value)


def _action_dto(state: ModelState, name: str, action: Action) -> PddlActionDto:
    parameters = [
        PddlObjectDto(dto_of(state, "type", type_), own) for own, type_ in action.parameters
    ]
    conditions, effects = (
        [
            PddlConditionEffectDto(
                dto_of(state, "predicate", literal.predicate),
                [
                    parameters[term] if isinstance(term, int) else dto_of(state, "object", term)
                    for term in literal.terms
                ],
                literal.time,
                literal.is_negative,
            )
            for literal in part
        ]
        for part in (action.conditions, action.effects)
    )
    text = action.duration
    if text is None:
        return PddlActionDto(name, parameters, conditions, effects, durative=False)
    duration = float(text) if "." in text else int(text)
    return PddlActionDto(name, parameters, conditions, effects, duration=duration)


def lines_of(state: ModelState) -> dict[tuple[str, Any], tuple[str, str]]:
    """The kind and the PDDL text of each element that holds."""
    return {
        (kind, key): (
            kind if kind != "atom" else "goal" if key.is_goal else "fact",
            str(dto_of(state, kind, key)),
        )
        for kind, part in state.held.items()
        for key in part
    }


class ModelDao:
    def __init__(self, model: Model, kind: str) -> None:
        self._model = model
        self._kind = kind

    def get(self, name: str) -> Any:
        state = self._model.state
        key = fold(name)
        return dto_of(state, self._kind, key) if key in state.held[self._kind] else None

    def get_all(self) -> list[Any]:
        state, kind = self._model.state, self._kind
        return [dto_of(state, kind, key) for key in state.known[kind] if key in state.held[kind]]

    def get_by_predicate(self, name: str) -> list[Any]:
        return [dto for dto in self.get_all() if fold(dto.predicate.name) == fold(name)]

    def get_goals(self) -> list[Any]:
        return [dto for dto in self.get_all() if dto.is_goal]

    def get_no_goals(self) -> list[Any]:
        return [dto for dto in self.get_all() if not dto.is_goal]

    def save(self, dto: Any, **options: Any) -> bool:
        with self._model.transaction() as state:
            state.define(self._kind, dto, **options)
        return True

    def insert(self, dto: Any) -> bool:
        return not self._is_there(dto) and self.save(dto)

    def update(self, dto: Any, **options: Any) -> bool:
        return self._is_there(dto) and self.save(dto, **options)

    def save_all(self, dtos: Iterable[Any]) -> int:
        with self._model.transaction() as state:
            return sum(state.define(self._kind, dto) for dto in dtos)

    def delete(self, dto: Any) -> bool:
        if not self._is_there(dto):
            return False
        with self._model.transaction() as state:
            state.remove(self._kind, {key_of(self._kind, dto)})
        return True

    def delete_all(self) -> int:
        with self._model.transaction() as state:
            count = len(state.held[self._kind])
            state.remove(self._kind, set(state.held[self._kind]))
        return count

    def _is_there(self, dto: Any) -> bool:
        self._model.check_writable()
        return key_of(self._kind, dto) in self._model.state.held[self._kind]


class Model:
    """A knowledge base, at its head or as it was at a revision."""

    def __init__(self, states: list[ModelState] | None = None) -> None:
        self._is_past = states is not None
        self._states = states or [ModelState()]
        self._log: list[list[tuple[str, str, str]]] = []
        self._depth = 0
        self.state = ModelState(self._states[-1])
        self.types, self.objects, self.predicates, self.actions, self.propositions = (
            ModelDao(self, kind) for kind in ("type", "object", "predicate", "action", "atom")
        )

    @property
    def revision(self) -> int:
        return len(self._states) - 1

    def changes(self) -> list[list[tuple[str, str, str]]]:
        """What each revision changed, oldest first."""
        return self._log

    def at(self, revision: int) -> Model:
        if not 0 <= revision <= self.revision:
            raise UnknownRevisionError
        return Model(self._states[: revision + 1])

    def check_writable(self) -> None:
        if self._is_past:
            raise ReadOnlyError

    @contextmanager
    def transaction(self, expected_revision: int | None = None) -> Iterator[ModelState]:
        self.check_writable()
        if expected_revision not in (None, self.revision):
            raise StaleRevisionError("", expected_revision or 0, self.revision)
        before, self.state = self.state, ModelState(self.state)
        self._depth += 1
        try:
            yield self.state
        except BaseException:
            self.state = before
            raise
        finally:
            self._depth -= 1
        if self._depth == 0:
            self._commit()

    def _commit(self) -> None:
        before, now = lines_of(self._states[-1]), lines_of(self.state)
        changes = [("-", *line) for key, line in before.items() if now.get(key) != line]
        changes += [("+", *line) for key, line in now.items() if before.get(key) != line]
        if changes:
            self._states.append(ModelState(self.state))
            self._log.append(sorted(changes))
        else:
            # Nothing is remembered of a transaction that changed nothing.
            self.state = ModelState(self._states[-1])
