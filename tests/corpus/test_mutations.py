"""Whatever the reader accepts goes through a store: it verifies, and comes back as it was read.

Files are changed at random: words are left out, doubled, swapped, or replaced by words of the
language or of the file, here and there or everywhere. KANT_SQL_TEST_EXAMPLES=5000
changes that many files, each time from another seed.
"""

from __future__ import annotations

import random

import kant_sql
from kant_sql.errors import KantSqlError, PddlError
from kant_sql.pddl import Domain, read_domain, read_problem, write
from tests.pddl.test_names_everywhere import DOMAIN, PROBLEM, WORDS
from tests.support.corpus import PAIRS
from tests.support.profile import HUNT, PROFILE

SMALL = 12_000
_LANGUAGE = """
:strips :?x :typing : :: :init :goal :metric :requirements :types :constants :objects :predicates
:functions :parameters :effect :domain ?x ?y ?duration ? -3 1e3 +5 .5 007 1.50 maximize () (and)
(or) (p) (:length)
"""
LANGUAGE = (
    *(*WORDS, *_LANGUAGE.split()),
    *("- object", "(either a b)", "(= (f) 1)", "(not (p))", ";\n"),
)
Pair = tuple[str, str]


def sources() -> list[Pair]:
    """A pair in which everything stands, and the small ones of the corpus."""
    found = [(DOMAIN, PROBLEM)]
    for pair in PAIRS:
        domain, problem = (path.read_text(errors="ignore") for path in (pair.domain, pair.problem))
        if len(domain) + len(problem) < SMALL:
            found.append((domain, problem))
    return found


def end_of_list(words: list[str], at: int) -> int:
    """The place behind a word, or behind the parenthesis that closes it."""
    depth = 0
    for place in range(at, len(words)):
        depth += {"(": 1, ")": -1}.get(words[place], 0)
        if depth <= 0:
            return place + 1
    return len(words)


def change(text: str, chance: random.Random) -> str:
    """Change a few words of a text."""
    words = text.replace("(", " ( ").replace(")", " ) ").split()
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        at, other = chance.randrange(len(words)), chance.randrange(len(words))
        whole = chance.random() < 0.8
        until = end_of_list(words, at) if whole else at + 1
        new = chance.choice(LANGUAGE)
        changes: list[tuple[int, int, list[str]]] = [
            (at, until, []),
            (other, other, words[at:until]),
            (at, until, words[other : end_of_list(words, other)]),
            (at, at + 1, [new]),
            (at, at, [new]),
            (at, at + 1, [words[at].swapcase()]),
        ]
        if words[at] not in "()" and chance.random() < 0.4:
            words = [new if word == words[at] else word for word in words]
        else:
            start, end, part = chance.choice(changes)
            words[start:end] = part
        words = words or ["("]
    # Of several lines, it is not a path, whatever it begins with.
    return " ".join([*words, "\n"])


def check(domain_text: str, problem_text: str) -> bool:
    """Check one pair; give whether it is read."""
    try:
        domain = read_domain(domain_text)
        problem = read_problem(problem_text, domain=domain)
    except PddlError:
        return False
    assert read_domain(write(domain)) == domain
    assert read_problem(write(problem), domain=domain) == problem
    with kant_sql.connect("sqlite://") as kb:
        kb.load_domain(domain_text)
        kb.load_problem(problem_text)
        assert kb.store.verify().findings == ()
        assert kb.pddl.domain() == domain
        assert kb.pddl.problem() == problem
        check_text(kb, domain)
        kb.load_domain(kb.domain_pddl())
        kb.load_problem(kb.problem_pddl())
        assert kb.revision <= 2
    return True


def check_text(kb: kant_sql.KnowledgeBase, domain: Domain) -> None:
    text = kb.domain_pddl()
    assert text == write(kb.pddl.domain())
    assert read_domain(text) == domain
    assert read_problem(kb.problem_pddl(), domain=domain) == kb.pddl.problem()


def test_whatever_is_read_verifies_and_is_regenerated() -> None:
    chance = random.Random(None if HUNT else 8)
    pairs = sources()
    taken = 0
    for number in range(HUNT or PROFILE.mutants):
        domain_text, problem_text = pairs[0] if number % 2 else chance.choice(pairs)
        if chance.random() < 0.5:
            domain_text = change(domain_text, chance)
        else:
            problem_text = change(problem_text, chance)
        try:
            taken += check(domain_text, problem_text)
        except (AssertionError, KantSqlError) as error:
            error.add_note(f"{domain_text}\n\n{problem_text}")
            raise
    assert taken > (HUNT or PROFILE.mutants) // 20
