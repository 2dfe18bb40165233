"""Expected facts among a million changes: what acts asserted and nobody has seen.

    python -m tests.benchmarks.confirming [--changes 1000000] [--backend sqlite]

The stores are filled by the bare driver: a hundred robots move, each act is a revision with an
outcome, a fact that begins, and one that ends. What is measured is `kb.unconfirmed()`, which finds
the hundred facts that hold. The table has medians. Aim: less than 50 ms.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

import kant_sql
from tests.benchmarks.drivers import bare
from tests.benchmarks.support import alternate, print_table, read_options, stores

NAME, ROBOTS, REPEAT = "robot", 100, 9
DOMAIN = "(define (domain d) (:types robot) (:predicates (away ?r - robot)))"
ACTS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < {acts}) "
FILL = (
    "INSERT INTO revision (kb_id, number, committed_at, actor, form, hash) {acts}"
    " SELECT r.kb_id, r.number + n.i, r.committed_at, 'executive', 1, '' FROM n, revision AS r"
    " WHERE r.number = {first}",
    "INSERT INTO execution_version"
    " (kb_id, plan_id, position, since, until, kind, outcome, text) {acts}"
    " SELECT h.kb_id, 0, 1000 + n.i, {first} + n.i, NULL, 'execution', 'succeeded', ''"
    " FROM n, head AS h",
    "INSERT INTO proposition_version"
    " (kb_id, proposition_id, since, until, predicate_id, is_goal, fork, first_object_id) {acts}"
    " SELECT p.kb_id, p.id, {first} + n.i,"
    " CASE WHEN n.i + {robots} > {count} THEN NULL ELSE {first} + n.i + {robots} END,"
    " p.predicate_id, p.is_goal, CASE WHEN n.i + {robots} > {count} THEN 0 ELSE {first} + n.i END,"
    " CAST(p.arguments AS bigint)"
    " FROM n JOIN proposition AS p ON p.id = {id} + n.i % {robots}",
    "UPDATE head SET revision = {first} + {count}",
)


def fill(url: str, changes: int) -> None:
    """Fill a store."""
    names = " ".join(f"r{n}" for n in range(ROBOTS))
    with kant_sql.connect(url, knowledge_base=NAME, actor="executive") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(f"(define (problem p) (:domain d) (:objects {names} - robot))")
        kb.propositions.save_all(f"(away r{n})" for n in range(ROBOTS))
        kb.propositions.delete_all()
        first = kb.revision
    store = bare(url)
    store.without_checks()
    store.execute("BEGIN")
    ((id_,),) = store.execute("SELECT min(id) FROM proposition")
    count = changes // 3
    for sql in FILL:
        acts = ACTS.format(acts=count)
        store.execute(sql.format(acts=acts, first=first, count=count, robots=ROBOTS, id=id_))
    store.execute("COMMIT")
    store.settle()
    store.close()


def main(argv: Sequence[str] | None = None) -> int:
    options = read_options(__doc__, argv, changes=1_000_000)
    with stores(options.backend) as places:
        for backend, new in places.items():
            url = new()
            fill(url, options.changes)
            with kant_sql.connect(url, knowledge_base=NAME) as kb:
                assert len(kb.unconfirmed()) == ROBOTS
                [taken] = alternate(REPEAT, lambda _: kb.unconfirmed)
            title = f"Expected facts among {options.changes:,} changes, {backend}, ms, median"
            print_table(title, ["", "unconfirmed"], [["", f"{1e3 * median(taken):.1f}"]])
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
