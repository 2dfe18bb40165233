"""`kb.rules`: rules that the store keeps, which report or refuse violations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .. import html
from ..arguments import one_of
from ..dao.base import identify
from ..dao.formula import tree_writer
from ..dao.text import expect_text, read_text
from ..dto import formulas as f
from ..dto.lexical import check_name
from ..errors import InvalidArgumentError, InvalidKnowledgeError
from ..history.revisions import LARGEST, Revision, read_numbered
from ..knowledge.canonical import with_text
from ..knowledge.definitions import REFUSE, REPORT, Definitions, RuleDefinition
from ..knowledge.formulas import TreeReader
from ..pddl.given import read_rules
from ..sql.periods import read_kept_rules
from ..store.guard import forbidden_by
from ..store.snapshot import View
from ..store.state import State
from ..store.transaction import Transaction
from .trajectory import rules_of

OnViolation = Literal["report", "refuse"]
EXAMPLE = "(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))"


@dataclass(frozen=True)
class KeptRule(html.OneRow):
    """A rule that the store keeps.

    Attributes:
        name: its name.
        rule: the rule as PDDL text.
        on_violation: `report`, or `refuse`: a transaction that would violate it fails.
    """

    name: str
    rule: str
    on_violation: OnViolation

    def __str__(self) -> str:
        return f"{self.name} ({self.on_violation}): {self.rule}"

    def _html_row_(self) -> html.Row:
        return {"name": self.name, "rule": self.rule, "on violation": self.on_violation}


def kept(definitions: Definitions, rule: RuleDefinition) -> KeptRule:
    """Convert the definition of a rule."""
    text = str(TreeReader(definitions, rule.constraint).formula())
    return KeptRule(rule.name, text, "refuse" if rule.on_violation == REFUSE else "report")


def get(state: State, name: str) -> KeptRule | None:
    """Read a rule.

    Args:
        name: its name, in any case.

    Returns:
        The rule; None if there is none of that name.

    Examples:
        >>> _ = kb.rules.save("one place", "(always (robot_at rb1 wp1))")
        Traceback (most recent call last):
        kant_sql.errors.InvalidNameError: ...
        >>> kb.rules.get("one-place") is None
        True
    """

    def read(definitions: Definitions) -> KeptRule | None:
        found = definitions.rules.named(name)
        return None if found is None else kept(definitions, found)

    return state.store.read_definitions(read, state.at)


def get_all(state: State) -> list[KeptRule]:
    """Read all kept rules.

    Returns:
        The rules, in the order in which they were first saved.

    Examples:
        >>> _ = kb.rules.save("home", "(sometime (robot_at rb1 wp1))")
        >>> print(*kb.rules.get_all())
        home (report): (sometime (robot_at rb1 wp1))
    """

    def read(definitions: Definitions) -> list[KeptRule]:
        return html.Listing([kept(definitions, one) for one in definitions.rules], "rule")

    return state.store.read_definitions(read, state.at)


def read_saved(state: State) -> list[tuple[KeptRule, Revision]]:
    """Read all kept rules, each with the revision that last saved it."""

    def read(view: View) -> list[tuple[KeptRule, Revision]]:
        if view.kb_id is None:
            return []
        at = LARGEST if view.at is None else view.at
        rows = read_kept_rules(view.session, view.kb_id, at)
        revisions = read_numbered(view.session, view.kb_id, {since for _, since, _ in rows})
        saved = {id_: revisions[since] for id_, since, _ in rows}
        definitions = view.definitions
        return [(kept(definitions, one), saved[one.id]) for one in definitions.rules]

    return state.store.read_in_snapshot(read, state.at)


def save(
    state: State, name: str, rule: str | f.Formula, *, on_violation: OnViolation = "report"
) -> bool:
    """Keep a rule in the store, or change the one of that name.

    Args:
        name: a name, without spaces.
        rule: a constraint on trajectories, or a count: PDDL text such as
            `(forall (?r - robot) (at-most-one (?p - place) (at ?r ?p)))`, or a node. Its names
            must be known.
        on_violation: `report`, so `kb.pddl.check_rules` and `kb.watch_rules` judge it; or
            `refuse`, so each transaction that would violate it fails, including this one. Only
            rules that a single state can violate can refuse: `always`, `at-most-one` and
            `exactly-one`, in conjunctions and universal quantifiers.

    Returns:
        True; a rule that the store cannot keep raises.

    Raises:
        PddlError: the text is not a rule, or it names an unknown element.
        InvalidNameError: this is not a valid name.
        UnsupportedConstructError: PDDL 3.0 gives it no meaning, or it cannot refuse.
        RuleViolatedError: the present state violates a rule that refuses.

    Examples:
        >>> kb.rules.save(
        ...     "one-place",
        ...     "(forall (?r - robot) (at-most-one (?w - wp) (robot_at ?r ?w)))",
        ...     on_violation="refuse",
        ... )
        True
        >>> kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp2]))
        Traceback (most recent call last):
        kant_sql.errors.RuleViolatedError: ...
    """
    one_of(on_violation, (REPORT, REFUSE), "on_violation", InvalidArgumentError)
    expect_text(rule, "a kept rule", "a rule", EXAMPLE)

    def work(transaction: Transaction) -> bool:
        check_name("rule", name)
        found = read_text(transaction, read_rules, rule)
        if len(found) != 1:
            raise InvalidKnowledgeError(
                f"rule {name!r} has {len(found)} formulas; give one, or (and ...) of several"
            )
        id_, spelling = identify(transaction, "rule", name)
        tree = tree_writer(transaction).tree(found[0])
        made = RuleDefinition(id_, spelling, on_violation, tree)
        # Both raise for rules that they cannot judge, whatever the objects are.
        [*rules_of(found[0], lambda _: ("?",))]
        if on_violation == REFUSE:
            [*forbidden_by(transaction.definitions, made, found[0])]
        transaction.define("rule", with_text(transaction.definitions, made))
        return True

    return state.store.write(work)


def delete(state: State, name: str) -> bool:
    """Delete a rule; its history stays.

    Args:
        name: its name, in any case.

    Returns:
        False if there is none.

    Examples:
        >>> kb.rules.delete("home")
        False
    """

    def work(transaction: Transaction) -> bool:
        found = transaction.definitions.rules.named(name)
        if found is not None:
            transaction.undefine("rule", found.id)
        return found is not None

    return state.store.write(work)
