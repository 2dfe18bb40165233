"""What is done to a whole history: holes, swaps, a tail that is cut off, another past."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from kant_sql.history.anchors import AnchoredHead
from kant_sql.history.verify.chain import rest_digest, stream_chain
from kant_sql.history.verify.sides import LISTED, Finding
from kant_sql.knowledge.canonical import archive_text
from tests.support.worlds.story import NAME
from tests.verify.bare import TABLES, Bare

LAST = 24
ARCHIVED = 8


@pytest.fixture(autouse=True)
def _tampering(bare: Bare) -> Iterator[None]:
    with bare.tampering():
        yield


def anchored(bare: Bare) -> AnchoredHead:
    ((number, digest),) = bare.run("SELECT revision, hash FROM head")
    return AnchoredHead(NAME, number, digest, "2026-01-31T09:30:00.000000Z")


def first(findings: list[Finding]) -> tuple[int | None, str]:
    return findings[0].revision, findings[0].message


def test_a_revision_that_was_removed_leaves_a_hole(bare: Bare) -> None:
    for table in TABLES.values():
        for column in ("since", "until", "number"):
            if column in table.c:
                bare.run(f"DELETE FROM {table.name} WHERE {column} = 10")
    findings = bare.findings()
    assert first(findings) == (10, "revision 10 is missing: a hole in the chain")


def test_a_revision_whose_row_alone_is_gone_leaves_its_changes(bare: Bare) -> None:
    bare.run("DELETE FROM revision WHERE number = 10")
    messages = [(each.revision, each.message) for each in bare.findings()]
    assert (10, "revision 10 is missing: a hole in the chain") in messages
    assert any(
        number == 10 and "revision 10 is missing, but has 2 changes" in message
        for number, message in messages
    )


def test_revisions_that_changed_places_are_both_named(bare: Bare) -> None:
    for table in TABLES.values():
        for column in ("since", "until", "number"):
            if column in table.c:
                for old, new in ((13, -1), (14, 13), (-1, 14)):
                    sql = f"UPDATE {table.name} SET {column} = ? WHERE {column} = ?"
                    bare.run(sql, new, old)
    assert {13, 14} <= {each.revision for each in bare.findings()}


def test_a_tail_that_was_cut_off_is_missed_by_an_anchor_alone(bare: Bare) -> None:
    known = anchored(bare)
    bare.run("DELETE FROM revision WHERE number = ?", LAST)
    bare.run("DELETE FROM archive WHERE since = ?", LAST)
    bare.run("UPDATE head SET archived_revision = 0, revision = ?", LAST - 1)
    bare.run("UPDATE head SET hash = (SELECT hash FROM revision WHERE number = ?)", LAST - 1)
    sql = "UPDATE head SET committed_at = (SELECT committed_at FROM revision WHERE number = ?)"
    bare.run(sql, LAST - 1)
    without = [each for each in bare.findings() if each.revision not in range(1, ARCHIVED + 1)]
    assert without == []
    cut = next(each for each in bare.findings(known) if "cut off" in each.message)
    assert cut.revision == LAST
    assert f"it ends at revision {LAST - 1}, and the anchor of 2026" in cut.message


def test_a_history_that_was_rewritten_is_told_by_an_anchor_alone(bare: Bare) -> None:
    known = anchored(bare)
    bare.run("UPDATE revision SET actor = 'nobody' WHERE number = 20")
    assert bare.findings()[0].revision == 20
    seal_from(bare, 20)
    assert bare.findings() == []
    (finding,) = bare.findings(known)
    assert finding.revision == LAST
    assert "the history up to it was rewritten" in finding.message


def seal_from(bare: Bare, low: int) -> None:
    """Recompute the hashes from one revision on."""
    ((previous,),) = bare.run("SELECT hash FROM revision WHERE number = ?", low - 1)
    for number in range(low, LAST + 1):
        (step,) = [
            step._replace(changes=iter([*step.changes]))
            for step in stream_chain(bare.session, 1, number, number)
        ]
        assert step.link is not None
        previous = step.link.digest(NAME, previous, step.changes)
        bare.run("UPDATE revision SET hash = ? WHERE number = ?", previous, number)
    bare.run("UPDATE head SET hash = ?", previous)


@pytest.mark.parametrize(
    ("sql", "revision", "message"),
    [
        (
            "UPDATE revision SET hash = 'x' WHERE number = 15",
            15,
            "the column hash of revision 15 was altered: revision 16 is chained to the right hash",
        ),
        (
            "UPDATE revision SET reason = 'well' WHERE number = 15",
            15,
            "its reason was added: without it, the hash is right",
        ),
        (
            "UPDATE function_value_version SET until = 13 WHERE until = 10",
            10,
            "'- value (= (fuel t1) 7.50)' is missing in it; it was moved to revision 13",
        ),
        (
            "UPDATE revision SET actor = NULL WHERE number = 15",
            15,
            "its contents differ from what was hashed: actor, reason",
        ),
        ("UPDATE revision SET form = 1 WHERE number = 21", 21, "it is of form 1, and has a seed"),
        (
            "UPDATE revision SET seed = NULL WHERE number = 21",
            21,
            "its seed is missing, and nothing of it was erased",
        ),
        ("UPDATE revision SET form = 9 WHERE number = 20", 20, "form 9 is unknown"),
        (
            "UPDATE type_version SET until = NULL WHERE until IS NOT NULL",
            15,
            "overlaps the version before it",
        ),
        (
            "UPDATE proposition_version SET fork = fork + 1",
            None,
            "which is not that of its revisions",
        ),
        ("DELETE FROM head", None, "head has 0 rows of the knowledge base, not one"),
        ("UPDATE head SET next_id = 5", None, "next_id is 5, and"),
        ("UPDATE head SET definition_revision = 9", None, "definition_revision is 9, and 17"),
        ("UPDATE head SET revision = 23", None, "revision is 23, and that of the last"),
        ("UPDATE archive SET rest = 'x'", None, "the rest of the revisions up to 8 differs"),
        ("UPDATE revision SET actor = 'x' WHERE number = 3", None, "the rest of the revisions"),
        ("UPDATE action_node SET operator = 'or' WHERE position = 0", None, "not a conjunction"),
        ("DELETE FROM object_type", None, "its rows say 'x - truck'"),
        ("UPDATE plan SET status = 'solved optimally'", None, "differ from its text"),
        (
            "UPDATE execution SET text = '(load t1 c2)' WHERE position = 0",
            None,
            "differs from its action and arguments",
        ),
        ("INSERT INTO revision_execution VALUES (1, 99, 99, 0)", 99, "and one of them is missing"),
        (
            "UPDATE proposition_argument SET kb_id = 7",
            None,
            "proposition_argument has rows of a missing knowledge base",
        ),
    ],
)
def test_what_differs_is_said(bare: Bare, sql: str, revision: int | None, message: str) -> None:
    bare.run(sql)
    findings = bare.findings()
    found = [each for each in findings if message in each.message]
    assert found, findings
    assert revision is None or found[0].revision == revision


def test_a_line_that_was_slipped_in_is_shown(bare: Bare) -> None:
    bare.run("INSERT INTO type VALUES (1, 900, 'drone', 'drone')")
    bare.run("INSERT INTO type_version VALUES (1, 900, 15, NULL, NULL, 'drone')")
    bare.run("UPDATE head SET next_id = 901")
    (finding,) = bare.findings()
    assert finding.revision == 15
    assert "'+ type drone' was inserted into it, moved there or duplicated" in finding.message


@pytest.mark.parametrize("since", [3, LAST - 1])
def test_an_archive_cannot_be_made_up_to_hide_what_was_changed(bare: Bare, since: int) -> None:
    """It would take revisions out of the chain: so its own record has to be in the chain."""
    bare.run("DELETE FROM archive")
    bare.run("UPDATE revision SET actor = 'nobody' WHERE number = 12")
    upto = LAST if since == 3 else 12
    rest = rest_digest(bare.session, 1, upto)
    text = archive_text(1, upto, "sqlite:///nowhere.db", 1, rest)
    row = (1, 1, since, upto, "sqlite:///nowhere.db", 1, rest, text)
    bare.run(f"INSERT INTO archive VALUES ({', '.join('?' * len(row))})", *row)
    bare.run("UPDATE head SET archived_revision = ?", upto)
    assert since in {each.revision for each in bare.findings()}


def test_two_terms_of_one_name_are_not_taken_for_each_other(bare: Bare) -> None:
    """The text is the same, whichever of two variables of one name is meant."""
    bare.run("UPDATE formula_variable SET name = 'q' WHERE name = 'p'")
    assert any("is not bound as its name is" in each.message for each in bare.findings())


@pytest.mark.parametrize(
    ("table", "column"),
    [
        ("function_value_version", "function_value_id"),
        *(("proposition_version", "proposition_id"), ("proposition_argument", "proposition_id")),
        *(("execution_version", "plan_id"), ("action_node", "action_id")),
        *(("object_version", "object_id"), ("revision", "number"), ("archive", "revision")),
        *(("head", "next_id"), ("head", "archived_revision")),
    ],
)
def test_a_key_that_is_null_is_a_finding(bare: Bare, table: str, column: str) -> None:
    row = bare.rows(table)[-1]
    bare.update(table, row, {column: None})
    assert bare.findings()


# SQLite keeps values of other types, and times as text; PostgreSQL keeps times that no clock shows.
WRONG_VALUES = {
    "?": (
        "UPDATE revision SET committed_at = 5 WHERE number = 12",
        "UPDATE revision SET committed_at = '31 January' WHERE number = 12",
        "UPDATE revision SET observed_at = 'yesterday' WHERE number = 12",
        "UPDATE revision SET number = 'twelve' WHERE number = 12",
        "UPDATE proposition_version SET since = 'twelve'",
        "UPDATE type_version SET since = 'twelve'",
        "UPDATE plan SET since = 'twelve'",
        "UPDATE head SET revision = 'twelve'",
        "UPDATE action_node SET parent = 'root' WHERE position > 1",
        "UPDATE proposition SET text = x'00ff'",
        "UPDATE function_value_version SET number = 'much'",
        "UPDATE revision SET source = '' WHERE number = 20",
        "UPDATE execution_version SET until = 9e999 WHERE until IS NULL",
        "UPDATE type_version SET until = 9e999 WHERE until IS NULL;"
        "UPDATE head SET definition_revision = 9e999",
        "UPDATE proposition SET is_goal = 2 WHERE is_goal;"
        "UPDATE proposition_version SET is_goal = 2 WHERE is_goal",
    ),
    "%s": (
        "UPDATE revision SET committed_at = 'infinity' WHERE number = 12",
        "UPDATE revision SET observed_at = '20000-01-01' WHERE number = 12",
        "UPDATE head SET committed_at = 'infinity'",
    ),
}


def test_values_that_no_column_should_have_are_a_finding(bare: Bare) -> None:
    for sql in WRONG_VALUES[bare.session.placeholder]:
        bare.run("SAVEPOINT one")
        for statement in sql.split(";"):
            bare.run(statement)
        assert bare.findings(), sql
        bare.run("ROLLBACK TO SAVEPOINT one")


def test_many_findings_are_counted(bare: Bare) -> None:
    for number in range(500):
        bare.run("INSERT INTO proposition_argument VALUES (1, ?, 0, 1)", 1_000 + number)
    findings = bare.findings()
    assert len(findings) == LISTED + 1
    assert findings[-1].message == f"{500 - LISTED} more findings in proposition_argument"


def test_many_wrong_revisions_are_counted(bare: Bare, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kant_sql.history.verify.chain.EXPLAINED", 2)
    bare.run("UPDATE knowledge_base SET name = 'elsewhere'")
    messages = [each.message for each in bare.findings()]
    assert (
        f"{LAST - ARCHIVED - 2} more revisions differ from what was hashed, the last is 24"
        in messages
    )
