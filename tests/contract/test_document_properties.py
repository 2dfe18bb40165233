"""Any documents survive the store, on every backend, and so do those that others replace.

KANT_SQL_TEST_EXAMPLES=1000 hunts for longer, each time from another seed.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from hypothesis import given

from kant_sql import KnowledgeBase
from kant_sql.dto.lexical import fold
from kant_sql.pddl import read_domain, read_problem, write
from kant_sql.pddl.document import Domain, Problem
from tests.support.generators.documents import domains_and_problems
from tests.support.profile import PROFILE, hunting
from tests.support.reading import loaded
from tests.support.stores import Everywhere
from tests.support.worlds.depot import again

Documents = tuple[Domain, Problem]


def load(kb: KnowledgeBase, documents: Documents) -> None:
    with kb.transaction():
        loaded(kb, write(documents[0]), write(documents[1]))


def folded(value: Any) -> Any:
    """A document, or a part of one, with its names as they are compared."""
    if isinstance(value, str):
        return fold(value)
    if isinstance(value, tuple):
        parts = [folded(part) for part in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(*(folded(getattr(value, field.name)) for field in fields(value)))
    return value


def check_holds(kb: KnowledgeBase, documents: Documents) -> None:
    """Check that a knowledge base gives just these documents, in whatever way it is asked."""
    domain, problem = documents
    assert kb.pddl.domain() == domain
    assert kb.pddl.problem() == problem
    assert kb.domain_pddl() == write(domain)
    text = kb.problem_pddl()
    assert text == write(kb.pddl.problem()) == kb.problem_pddl()
    assert read_problem(text, domain=domain) == problem


def test_documents_survive_the_store(everywhere: Everywhere) -> None:
    @hunting(PROFILE.documents)
    @given(domains_and_problems(repeats=True))
    def survive(documents: Documents) -> None:
        def check(kb: KnowledgeBase) -> None:
            load(kb, documents)
            made = kb.revision
            check_holds(kb, documents)
            # Definitions of a process that has not written them come from the tables.
            newcomer = again(kb)
            check_holds(newcomer, documents)
            for mode in ("replace", "merge"):
                assert newcomer.load_domain(kb.domain_pddl(), mode=mode).revision is None
                assert newcomer.load_problem(kb.problem_pddl(), mode=mode).revision is None
            assert kb.revision == made

        everywhere(check)

    survive()


@pytest.mark.more
def test_documents_replace_others(everywhere: Everywhere) -> None:
    @hunting(PROFILE.documents)
    @given(domains_and_problems(), domains_and_problems())
    def replace(before: Documents, after: Documents) -> None:
        def check(kb: KnowledgeBase) -> None:
            load(kb, before)
            load(kb, after)
            # What is known already keeps its first spelling.
            assert folded((kb.pddl.domain(), kb.pddl.problem())) == folded(after)
            assert read_domain(kb.domain_pddl()) == kb.pddl.domain()
            text = kb.problem_pddl()
            assert read_problem(text, domain=kb.pddl.domain()) == kb.pddl.problem()
            check_holds(kb.at(1), before)
            load(kb, before)
            check_holds(kb, before)
            check_holds(again(kb), before)

        everywhere(check)

    replace()
