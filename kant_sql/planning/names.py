"""Names in a problem of unified-planning, where all elements share one set of names.

PDDL lets an action and a predicate, or an object and a type, have one name. Objects and actions
keep theirs, because plans are made of them; what clashes with them has its category appended.
"""

from __future__ import annotations

from ..dto.name import fold
from ..pddl.document import Domain, Problem

OBJECT, PREDICATE, FUNCTION, TYPE = "object", "predicate", "function", "type"


class Names:
    """What each element is called in unified-planning."""

    def __init__(self, domain: Domain, problem: Problem) -> None:
        """Choose a name for each element, always the same for the same documents.

        Args:
            domain: the domain.
            problem: the problem.
        """
        self._taken: set[str] = set()
        self._chosen: dict[tuple[str, str], str] = {}
        self._action_of: dict[str, str] = {}
        clashing = [key for key in _declared(domain, problem) if not self._claim(*key)]
        for category, name in clashing:
            self._chosen[category, fold(name)] = self.unused(f"{name}_{category}")

    def _claim(self, category: str, name: str) -> bool:
        if fold(name) in self._taken:
            return (category, fold(name)) in self._chosen
        self._taken.add(fold(name))
        self._chosen[category, fold(name)] = name
        return True

    def unused(self, name: str) -> str:
        """Take a name that nothing else has.

        Args:
            name: the name that is wanted.

        Returns:
            The name, with a number appended when it is taken.
        """
        candidate, number = name, 2
        while fold(candidate) in self._taken:
            candidate, number = f"{name}_{number}", number + 1
        self._taken.add(fold(candidate))
        return candidate

    def of(self, category: str, name: str) -> str:
        """Give an element's name in unified-planning.

        Args:
            category: what it is: an object, a type, an action ...
            name: its name in PDDL.

        Returns:
            Its name in unified-planning; the PDDL name for what was declared nowhere.
        """
        return self._chosen.get((category, fold(name)), name)

    def stands_for(self, up_name: str, action: str) -> None:
        """Remember which action of the document an action of unified-planning stands for.

        Args:
            up_name: the name in unified-planning.
            action: the name in PDDL.
        """
        self._action_of[up_name] = action

    def action_of(self, up_name: str) -> str:
        """Give the PDDL name of an action.

        Args:
            up_name: its name in unified-planning.

        Returns:
            Its name in the domain.
        """
        return self._action_of[up_name]


def _declared(domain: Domain, problem: Problem) -> list[tuple[str, str]]:
    return [
        *((OBJECT, part.name) for part in (*domain.constants, *problem.objects)),
        *((action.kind, action.name) for action in domain.actions),
        *((PREDICATE, part.name) for part in domain.predicates),
        *((FUNCTION, part.name) for part in domain.functions),
        *((TYPE, part.name) for part in domain.types),
    ]
