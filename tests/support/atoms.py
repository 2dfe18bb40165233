"""Facts and goals through one object, as in the paper: each goes to its own DAO."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby
from typing import Any

from kant_sql import KnowledgeBase, PddlPropositionDto
from kant_sql.dao import AnyDao
from kant_sql.dto.lexical import fold


class Atoms:
    """The propositions of a knowledge base, facts before goals."""

    def __init__(self, kb: KnowledgeBase) -> None:
        self._kb = kb

    def get_all(self) -> list[PddlPropositionDto]:
        return [*self._kb.propositions.get_all(), *self.get_goals()]

    def get_goals(self) -> list[PddlPropositionDto]:
        return self._kb.goals.get_propositions()

    def get_no_goals(self) -> list[PddlPropositionDto]:
        return self._kb.propositions.get_all()

    def get_by_predicate(self, name: str) -> list[PddlPropositionDto]:
        found = self._kb.propositions.get_by_predicate(name)
        return found + [
            goal for goal in self.get_goals() if fold(goal.predicate.name) == fold(name)
        ]

    def save(self, dto: PddlPropositionDto) -> bool:
        return self._kb.goals.save(dto) if dto.is_goal else self._kb.propositions.save(dto)

    def insert(self, dto: PddlPropositionDto) -> bool:
        return self._kb.goals.insert(dto) if dto.is_goal else self._kb.propositions.insert(dto)

    def update(self, dto: PddlPropositionDto) -> bool:
        if not dto.is_goal:
            return self._kb.propositions.update(dto)
        with self._kb.transaction():
            stored = {fold(str(goal)) for goal in self.get_goals()}
            return fold(str(dto)) in stored and self._kb.goals.save(dto)

    def save_all(self, dtos: Iterable[PddlPropositionDto]) -> int:
        changed = 0
        with self._kb.transaction():
            for are_goals, some in groupby(dtos, lambda dto: dto.is_goal):
                dao: AnyDao[Any, Any] = self._kb.goals if are_goals else self._kb.propositions
                changed += dao.save_all([*some])
        return changed

    def delete(self, dto: PddlPropositionDto) -> bool:
        return self._kb.goals.delete(dto) if dto.is_goal else self._kb.propositions.delete(dto)

    def delete_all(self) -> int:
        with self._kb.transaction():
            return self._kb.propositions.delete_all() + self._kb.goals.delete_all()
