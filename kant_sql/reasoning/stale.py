"""The facts behind a condition that nobody has seen for long."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator

from ..dto.formulas import Atom, Comparison, Equal, Formula, Node, Not
from ..dto.lexical import fold
from ..errors import UnsupportedConstructError
from ..history.confirmations import stale_facts
from ..history.revisions import Version
from ..knowledge.definitions import Definitions
from ..knowledge.rules import rules_of
from ..knowledge.symbols import symbols_of
from ..pddl.formulas import flatten
from ..pddl.given import read_condition, text_of
from ..sql.intervals import FIND
from ..store.snapshot import View
from ..store.state import State
from .ask import Asking


def stale(state: State, condition: str | Node, *, than: float) -> list[Version]:
    """Find the facts that a condition needs, and that nobody has asserted or confirmed lately.

    Args:
        condition: an atom, or a conjunction of atoms, comparisons and their negations, as for
            `query`; free variables stand for any objects. The facts are those of its positive
            atoms, for each of its answers.
        than: seconds; a fact seen more recently is not stale.

    Returns:
        The facts that hold, the first asserted first.

    Raises:
        UnsupportedConstructError: the condition has another operator, or a derived predicate.
        InvalidArgumentError: `than` is not a number of seconds, from 0.

    Examples:
        >>> kb.stale("(robot_at ?r ?w)", than=60)
        []
    """
    text = text_of(condition)

    def find(view: View) -> list[Version]:
        atoms = _needed(view.definitions, text)
        asking = Asking(text, None, None, {})
        names = [f"?{fold(name)}" for name in asking.prepared(view.definitions)[0].columns]
        bindings = [dict(zip(names, row, strict=True)) for row in asking.read(view)]
        if view.kb_id is None:
            return stale_facts(state, view, [], than)
        wanted: dict[int, set[str]] = defaultdict(set)
        for predicate, terms in atoms:
            for binding in bindings:
                objects = (binding.get(fold(term), term) for term in terms)
                wanted[predicate].add(view.definitions.arguments(objects) or "")
        own = {"kb": view.kb_id, "is_goal": False}
        ids = [
            row[0]
            for predicate, arguments in wanted.items()
            for row in view.session.rows(
                FIND, predicate=predicate, arguments=view.session.list_value([*arguments]), **own
            )
        ]
        return stale_facts(state, view, ids, than)

    return state.store.read_in_snapshot(find, state.at)


def _needed(definitions: Definitions, text: str) -> list[tuple[int, list[str]]]:
    """Find the facts that a condition needs: predicates, and names of objects and variables."""
    read = read_condition(text, symbols=symbols_of(definitions)).formula
    found = []
    for atom in _atoms(read):
        predicate = definitions.predicates.named(atom.predicate)
        assert predicate is not None
        if predicate.id in rules_of(definitions).component:
            raise _refused(f"{atom}, which is derived")
        terms = [str(term) for term in atom.terms]
        found.append((predicate.id, terms))
    return found


def _atoms(formula: Formula) -> Iterator[Atom]:
    """Yield the positive atoms of a conjunction."""
    for part in flatten(formula):
        if isinstance(part, Atom):
            yield part
        elif not isinstance(part, Not | Comparison | Equal):
            raise _refused(str(part))


def _refused(what: str) -> UnsupportedConstructError:
    return UnsupportedConstructError(
        f"stale takes a conjunction of literals of facts, and of comparisons, not {what}; ask for "
        "the facts that it needs, as in kb.stale('(robot_at ?r ?p)', than=60)"
    )
