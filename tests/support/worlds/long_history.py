"""A long history, written by the database itself: the library would take minutes."""

from __future__ import annotations

import kant_sql
from tests.support.pages import opened
from tests.support.worlds.robots import robot_at

NAME = "tiago"
_TIMES = {
    "SQLite": "strftime('%Y-%m-%dT%H:%M:%S', 1893456000 + n, 'unixepoch') || '.000000Z'",
    "PostgreSQL": "to_timestamp(1893456000 + n)",
}
_NUMBERS = "WITH RECURSIVE t (n) AS (SELECT 2 UNION ALL SELECT n + 1 FROM t WHERE n < {})"
_STATEMENTS = (
    "{numbers} INSERT INTO revision (kb_id, number, committed_at, actor, reason, form, hash)"
    " SELECT k.id, n, {time}, 'executive', 'step ' || n, 1, 'not computed'"
    " FROM knowledge_base AS k, t WHERE k.name = 'tiago'",
    "{numbers} INSERT INTO proposition_version (kb_id, proposition_id, since, until, predicate_id,"
    " is_goal, fork, first_object_id, second_object_id)"
    " SELECT v.kb_id, v.proposition_id, n, n + 1, v.predicate_id, v.is_goal, n,"
    " v.first_object_id, v.second_object_id"
    " FROM proposition_version AS v, t WHERE v.since = 1 AND n < {size}",
    "UPDATE head SET revision = {size}",
)


def write_long_history(url: str, revisions: int) -> None:
    """Write a fact that comes and goes with each revision. The hashes are not computed.

    Args:
        url: a store without a knowledge base.
        revisions: the number of revisions.
    """
    with kant_sql.connect(url, knowledge_base=NAME, actor="test") as kb:
        kb.propositions.save(robot_at())
    with opened(url) as store:
        store.execute("BEGIN", {})
        for statement in _STATEMENTS:
            filled = statement.format(
                numbers=_NUMBERS.format(revisions), time=_TIMES[store.dialect], size=revisions
            )
            store.execute(filled, {})
        store.execute("COMMIT", {})
