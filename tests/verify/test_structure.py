"""What the tables stand in: indexes that leave rows out, and what no migration has made."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psycopg
import pytest
from sqlalchemy import make_url

import kant_sql
from kant_sql.history.verify.structure import TABLES
from kant_sql.sql.dialects import create_backend
from kant_sql.sql.dialects import postgresql_structure as indexes
from kant_sql.sql.dialects.postgresql_structure import as_created
from kant_sql.sql.schema import VERSIONS, recorded
from kant_sql.sql.tables import Base
from tests.support.citus import is_distributed
from tests.support.pages import opened
from tests.support.processes.commands import run
from tests.support.reading import findings, loaded
from tests.support.roles import DOMAIN, MINE, PROBLEM, members
from tests.support.roles import OTHER as OTHER_KB
from tests.support.stores import Connect
from tests.support.worlds.robots import WP2, robot_at, waypoint
from tests.support.worlds.story import NAME, write_story

FACT, OTHER = robot_at(), robot_at(place=WP2)


def is_sqlite(url: str) -> bool:
    return make_url(url).get_backend_name() == "sqlite"


def tamper(url: str, *statements: str) -> None:
    with opened(url) as store:
        for sql in statements:
            store.execute(sql, {})


def messages(url: str) -> str:
    return "\n".join(f"{each.table}: {each.message}" for each in findings(url))


@pytest.fixture
def filled(shared_url: str, connect: Connect) -> str:
    """A store with two facts and the end of a third."""
    with connect(shared_url, knowledge_base="tiago") as kb:
        kb.propositions.save(FACT)
        kb.propositions.save(OTHER)
        kb.propositions.save(robot_at(place=waypoint(3)))
        kb.propositions.delete(robot_at(place=waypoint(3)))
    assert findings(shared_url) == []
    return shared_url


def facts(url: str) -> list[str]:
    with kant_sql.connect(url, knowledge_base="tiago") as kb:
        return sorted(str(fact) for fact in kb.propositions.get_all())


def skip_on_a_cluster(url: str) -> None:
    if is_distributed(url):
        pytest.skip("shards have their indexes on their nodes, where amcheck compares them")


def hide_a_fact(url: str) -> None:
    """Make an index that leaves a fact out, and put the text of the old one back."""
    skip_on_a_cluster(url)
    with opened(url) as store:
        ((hidden,),) = store.execute(
            "SELECT id FROM proposition WHERE NOT is_goal ORDER BY id LIMIT 1", {}
        )
    name = "ix_proposition_version_now"
    columns = (
        "kb_id, predicate_id, is_goal, first_object_id, second_object_id, proposition_id, until"
    )
    on = f"ON proposition_version ({columns}) WHERE until IS NULL"
    narrow = f"CREATE INDEX {name} {on} AND proposition_id <> {hidden}"
    if is_sqlite(url):
        with sqlite3.connect(str(make_url(url).database), isolation_level=None) as file:
            ((text,),) = file.execute(f"SELECT sql FROM sqlite_master WHERE name = '{name}'")
            file.execute(f"DROP INDEX {name}")
            file.execute(narrow)
            file.execute("PRAGMA writable_schema = ON")
            file.execute(f"UPDATE sqlite_master SET sql = ? WHERE name = '{name}'", (text,))
        file.close()
        return
    tamper(
        url,
        f"DROP INDEX {name}",
        narrow,
        f"CREATE INDEX copy {on}",
        "UPDATE pg_index SET indpred = (SELECT indpred FROM pg_index WHERE indexrelid = "
        f"'copy'::regclass) WHERE indexrelid = '{name}'::regclass",
        "DROP INDEX copy",
    )


def test_an_index_that_leaves_a_row_out_is_a_finding(filled: str) -> None:
    hide_a_fact(filled)
    found = messages(filled)
    assert "ix_proposition_version_now" in found
    if is_sqlite(filled):
        assert facts(filled) == [str(OTHER)]
        assert "missing from index ix_proposition_version_now" in found
    else:
        assert "has 1 of the 2 rows that the table has for it" in found
        assert "REINDEX INDEX ix_proposition_version_now" in found
        tamper(filled, "REINDEX INDEX ix_proposition_version_now")
        assert findings(filled) == []


@pytest.mark.more
def test_an_anchor_does_not_make_a_lying_index_true(filled: str) -> None:
    with kant_sql.connect(filled, knowledge_base="tiago") as kb:
        anchor = kb.store.anchor()
    hide_a_fact(filled)
    with kant_sql.connect(filled, knowledge_base="tiago") as kb:
        assert not kb.store.verify(anchor).is_intact
        assert kb.store.verify(anchor, structure=False).is_intact


def test_an_index_for_looking_up_texts_is_compared_too(filled: str) -> None:
    """It is a hash on PostgreSQL, which cannot be read in order."""
    if is_sqlite(filled):
        pytest.skip("SQLite has one kind of index")
    skip_on_a_cluster(filled)
    tamper(
        filled,
        "DROP INDEX ix_proposition_text",
        f"CREATE INDEX ix_proposition_text ON proposition USING hash (text) WHERE text <> '{FACT}'",
        "UPDATE pg_index SET indpred = NULL WHERE indexrelid = 'ix_proposition_text'::regclass",
    )
    assert "index ix_proposition_text has 2 of the 3 rows that the table has" in messages(filled)


def flips(path: Path, index: str, count: int) -> Iterator[bytes]:
    """Give the file with one flipped bit in the root page of an index, for several bits of it."""
    with sqlite3.connect(path) as file:
        file.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        ((size,),) = file.execute("PRAGMA page_size")
        ((page,),) = file.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (index,))
    file.close()
    whole = path.read_bytes()
    # The header with the cells' places is at its begin, the keys are at its end.
    places = [*range(12), *range(size - count + 12, size)]
    for place in places:
        changed = bytearray(whole)
        changed[(page - 1) * size + place] ^= 1
        yield bytes(changed)


@pytest.mark.more
def test_a_flipped_bit_in_an_index_does_not_hide_a_fact(tmp_path: Path, connect: Connect) -> None:
    path = tmp_path / "store.db"
    url = f"sqlite:///{path}"
    with connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save_all([FACT, OTHER])
    hidden = 0
    for content in flips(path, "ix_proposition_version_now", 40):
        copy = tmp_path / "copy.db"
        copy.write_bytes(content)
        copied = f"sqlite:///{copy}"
        try:
            is_hidden = facts(copied) != [str(FACT), str(OTHER)]
        except kant_sql.errors.StoreError:
            is_hidden = True
        hidden += is_hidden
        if is_hidden:
            assert findings(copied) != []
    assert hidden > 5


COMMON = {
    "DROP INDEX ix_proposition_version_now": (
        "proposition_version: index ix_proposition_version_now is missing"
    ),
    "CREATE INDEX more ON proposition (kb_id)": "proposition: the migrations do not create this",
    "DROP VIEW audit_goal": "audit_goal: view audit_goal is missing",
    "DROP VIEW audit_goal; CREATE VIEW audit_goal AS SELECT * FROM audit_fact WHERE kind = 'goal'"
    " AND text <> '(x)'": "audit_goal: view audit_goal was changed",
    "ALTER TABLE archive RENAME TO kept; CREATE VIEW archive AS SELECT * FROM kept": (
        "archive: table archive is missing"
    ),
    "ALTER TABLE proposition ADD COLUMN more integer": "proposition: table proposition was changed",
    "DROP INDEX uq_proposition_version_live; CREATE INDEX uq_proposition_version_live"
    " ON proposition_version (kb_id, proposition_id) WHERE until IS NULL": (
        "index uq_proposition_version_live"
    ),
}
SQLITE = {
    "CREATE TRIGGER t AFTER INSERT ON proposition_version BEGIN SELECT 1; END": "CREATE TRIGGER t",
    "CREATE TRIGGER t INSTEAD OF INSERT ON audit_fact BEGIN SELECT 1; END": "CREATE TRIGGER t",
    "PRAGMA writable_schema = ON; UPDATE sqlite_master SET sql = replace(sql,"
    " 'CHECK (since < until)', 'CHECK (since < until OR 1)') WHERE name = 'type_version'": (
        "type_version: table type_version was changed"
    ),
    "ALTER TABLE archive RENAME TO kept; CREATE VIRTUAL TABLE archive USING fts5(text)": (
        "table archive"
    ),
}
POSTGRESQL = {
    "CREATE FUNCTION f() RETURNS trigger LANGUAGE plpgsql AS 'BEGIN RETURN NULL; END';"
    "CREATE TRIGGER t BEFORE INSERT ON proposition_version FOR EACH ROW EXECUTE FUNCTION f()": (
        "trigger t on proposition_version"
    ),
    "CREATE RULE r AS ON DELETE TO proposition DO INSTEAD NOTHING": "rule r on proposition",
    "ALTER TABLE proposition DISABLE TRIGGER ALL": "disabled check of a foreign key of propositi",
    "ALTER TABLE type_version DROP CONSTRAINT fk_type_version_kb_id_since": (
        "'CONSTRAINT fk_type_version_kb_id_since FOREIGN KEY"
    ),
    "ALTER TABLE type_version DROP CONSTRAINT ck_type_version_since_before_until, ADD CONSTRAINT"
    " ck_type_version_since_before_until CHECK (since < until) NOT VALID": "NOT VALID",
    "CREATE POLICY p ON proposition USING (false)": "policy p on proposition",
    "ALTER TABLE proposition FORCE ROW LEVEL SECURITY": "forced row security on proposition",
    "CREATE TABLE more () INHERITS (proposition)": "table more, whose rows are read as those of",
    "ALTER TABLE execution_argument SET UNLOGGED": "without a log, which loses its rows in a crash",
    "UPDATE pg_index SET indisvalid = false WHERE indexrelid = 'ix_proposition_version_now'"
    "::regclass": "not valid",
    "CREATE SCHEMA evil; CREATE TABLE evil.proposition_argument (LIKE proposition_argument);"
    "DO $$ BEGIN EXECUTE 'ALTER DATABASE ' || current_database() ||"
    " ' SET search_path TO evil, public'; END $$": (
        "relation that statements find in its place: evil.proposition_argument"
    ),
    "CREATE SCHEMA evil; CREATE VIEW evil.audit_fact AS SELECT * FROM audit_fact WHERE false;"
    "DO $$ BEGIN EXECUTE 'ALTER DATABASE ' || current_database() ||"
    " ' SET search_path TO evil, public'; END $$": (
        "relation that statements find in its place: evil.audit_fact"
    ),
    "CREATE SCHEMA kant_sql_evil; CREATE VIEW kant_sql_evil.audit_fact AS SELECT 1 AS n;"
    "DO $$ BEGIN EXECUTE 'ALTER DATABASE ' || current_database() ||"
    " ' SET search_path TO kant_sql_evil, public'; END $$": (
        "relation that statements find in its place: kant_sql_evil.audit_fact"
    ),
    "CREATE SCHEMA evil; DO $$ BEGIN EXECUTE 'ALTER DATABASE ' || current_database() ||"
    " ' SET search_path TO evil, public, pg_catalog'; END $$": (
        "schema evil, which the search path has before the system's own"
    ),
    "ALTER TABLE function_value_version ALTER until SET DEFAULT 5": "DEFAULT 5",
    'ALTER TABLE proposition ALTER arguments TYPE text COLLATE "default"': (
        "table proposition was changed"
    ),
    "ALTER TABLE archive RENAME TO kept; CREATE MATERIALIZED VIEW archive AS SELECT * FROM kept": (
        "table archive is missing"
    ),
}


@pytest.mark.parametrize(("sql", "message"), [*COMMON.items(), *SQLITE.items()])
@pytest.mark.more
def test_what_the_migrations_have_not_made_is_a_finding_on_sqlite(
    file_url: str, connect: Connect, sql: str, message: str
) -> None:
    with connect(file_url, knowledge_base="tiago") as kb:
        kb.propositions.save(FACT)
    with sqlite3.connect(str(make_url(file_url).database), isolation_level=None) as file:
        file.executescript(sql)
    file.close()
    assert message in messages(file_url)


@pytest.mark.more
@pytest.mark.parametrize(("sql", "message"), [*COMMON.items(), *POSTGRESQL.items()])
def test_what_the_migrations_have_not_made_is_a_finding_on_postgresql(
    server: Any, connect: Connect, sql: str, message: str
) -> None:
    url = server.new_store()
    with connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save(FACT)
    with psycopg.connect(url, autocommit=True) as owner:
        owner.execute(sql.encode())
    assert message in messages(url)
    server.drop_database(url)


def test_a_generated_view_of_something_else_is_a_finding(file_url: str, connect: Connect) -> None:
    with connect(file_url, knowledge_base="tiago") as kb:
        kb.propositions.save(FACT)
    kant_sql.operations.update_views(file_url)
    assert findings(file_url) == []
    with sqlite3.connect(str(make_url(file_url).database), isolation_level=None) as file:
        ((sql,),) = file.execute("SELECT sql FROM sqlite_master WHERE name = 'fact_robot_at'")
        file.execute("DROP VIEW fact_robot_at")
        file.execute(f"{sql} AND p.id <> 1" if "WHERE" in sql else f"{sql} WHERE false")
    file.close()
    (finding,) = findings(file_url)
    assert finding.table == "fact_robot_at"
    assert "'kant-sql views --drop'" in finding.message
    kant_sql.operations.drop_views(file_url)
    kant_sql.operations.update_views(file_url)
    assert findings(file_url) == []


def test_what_had_the_name_of_a_generated_view_before_is_none(filled: str) -> None:
    tamper(filled, "CREATE TABLE fact_robot_at (a INTEGER)")
    assert findings(filled) == []
    kant_sql.operations.update_views(filled)
    assert findings(filled) == []


# What takes the place of a generated view; the second of them looks like it.
REPLACEMENTS = {
    "a table": "CREATE TABLE fact_robot_at (a INTEGER)",
    "a view": "CREATE VIEW fact_robot_at AS SELECT * FROM goal_robot_at",
    "all of them": "CREATE TABLE fact_robot_at AS SELECT * FROM goal_robot_at;"
    "DROP VIEW goal_robot_at",
}


@pytest.mark.parametrize("sql", REPLACEMENTS.values(), ids=REPLACEMENTS)
@pytest.mark.more
def test_what_took_the_place_of_a_generated_view_is_a_finding(filled: str, sql: str) -> None:
    kant_sql.operations.update_views(filled)
    assert findings(filled) == []
    tamper(filled, "DROP VIEW fact_robot_at", *sql.split(";"))
    (finding,) = findings(filled)
    assert finding.table == "fact_robot_at"
    assert "drop or rename it" in finding.message


@pytest.mark.parametrize(
    "table", ["proposition_version", "head", "revision", "knowledge_base", "kant_sql_version"]
)
@pytest.mark.more
def test_a_view_in_place_of_a_table_is_a_finding(filled: str, table: str) -> None:
    tamper(
        filled,
        f"ALTER TABLE {table} RENAME TO hidden",
        f"CREATE VIEW {table} AS SELECT * FROM hidden",
    )
    assert f"{table}: table {table} is missing: the migrations create it" in messages(filled)


def test_a_source_that_is_bytes_is_a_finding(file_url: str, connect: Connect) -> None:
    with connect(file_url, knowledge_base="tiago") as kb, kb.transaction(source={"file": "a"}):
        kb.propositions.save(FACT)
    tamper(file_url, "UPDATE revision SET source = CAST(source AS BLOB)")
    assert messages(file_url) == "revision: column source has 1 value that are not of its type"


@pytest.mark.more
def test_what_others_keep_in_the_same_database_is_theirs(filled: str) -> None:
    tamper(
        filled,
        "CREATE TABLE mission (id integer PRIMARY KEY, kb_id bigint, proposition_id bigint, "
        "FOREIGN KEY (kb_id, proposition_id) REFERENCES proposition (kb_id, id))",
        "CREATE INDEX mission_of ON mission (kb_id)",
        "CREATE VIEW overview AS SELECT * FROM audit_fact WHERE predicate = 'robot_at'",
        "INSERT INTO mission SELECT 1, kb_id, min(id) FROM proposition GROUP BY kb_id",
    )
    if is_sqlite(filled):
        tamper(filled, "CREATE TRIGGER m AFTER INSERT ON mission BEGIN SELECT 1; END")
    else:
        tamper(
            filled,
            "CREATE SEQUENCE counter",
            "CREATE FUNCTION f() RETURNS integer LANGUAGE sql AS 'SELECT 1'",
            "CREATE RULE r AS ON DELETE TO mission DO INSTEAD NOTHING",
        )
    assert findings(filled) == []


def test_a_story_with_views_an_archive_and_an_earlier_version_is_intact(
    shared_url: str, file_url: str
) -> None:
    write_story(shared_url, file_url)
    kant_sql.operations.update_views(shared_url)
    assert findings(shared_url) == findings(file_url) == []
    with kant_sql.connect(shared_url, knowledge_base=NAME) as kb:
        kb.restore(20)
    assert findings(shared_url) == []


@pytest.mark.more
def test_a_store_that_was_of_an_earlier_version_is_intact(shared_url: str) -> None:
    if is_distributed(shared_url):
        pytest.skip("its migrations are tested with the plugin")
    with kant_sql.connect(shared_url, knowledge_base=NAME) as kb:
        loaded(kb, DOMAIN, PROBLEM)
    kant_sql.operations.downgrade(shared_url, revision=VERSIONS[-2])
    kant_sql.upgrade(shared_url)
    assert findings(shared_url) == []


@pytest.mark.more
def test_a_store_with_roles_is_intact_for_its_owner_and_for_who_reads(server: Any) -> None:
    url = server.new_store()
    for name in (MINE, OTHER_KB):
        with kant_sql.connect(url, knowledge_base=name) as kb:
            loaded(kb, DOMAIN, PROBLEM)
    kant_sql.operations.update_views(url)
    roles, own = (
        kant_sql.operations.create_roles(url),
        kant_sql.operations.create_roles(url, knowledge_base=MINE),
    )
    assert findings(url) == []
    with members(url, roles) as users, members(url, own) as limited:
        assert findings(users.reader) == findings(users.writer) == []
        # Who may see one knowledge base may find the views of it first.
        path = {"options": f"-csearch_path={own.schema},public"}
        own_first = make_url(limited.reader).update_query_dict(path)
        for reader in (limited.reader, own_first.render_as_string(hide_password=False)):
            with kant_sql.connect(reader, knowledge_base=MINE) as kb:
                assert kb.store.verify().findings == ()
    server.drop_database(url)


@pytest.mark.parametrize("has_statistics", [False, True])
@pytest.mark.more
def test_every_index_can_be_read_by_itself(
    server: Any, file_url: str, has_statistics: bool
) -> None:
    """Whatever the server knows of the tables: else what is compared is another index."""
    url = server.new_store()
    write_story(url, file_url)
    if has_statistics:
        tamper(url, "VACUUM ANALYZE")
    backend = create_backend(url)
    with backend.open_session() as session:
        session.begin(write=False)
        made = indexes._indexes_of(session, TABLES, None)
        assert len(made) > 100
        assert len(indexes._by_indexes(session, made, None)) == len(made)
        session.rollback()
    backend.close()
    server.drop_database(url)


def test_what_amcheck_finds_is_a_finding(server: Any, connect: Connect) -> None:
    """A function that stands for it, for not every server has the extension."""
    url = server.new_store()
    with connect(url, knowledge_base="tiago") as kb:
        kb.propositions.save(FACT)
    tamper(
        url,
        "CREATE FUNCTION bt_index_check(index regclass, heapallindexed boolean) RETURNS void "
        "LANGUAGE plpgsql AS 'BEGIN IF index = ''pk_object''::regclass AND heapallindexed THEN "
        "RAISE EXCEPTION ''heap tuple lacks matching index tuple'' USING ERRCODE = ''XX002''; "
        "END IF; END'",
    )
    (finding,) = findings(url)
    assert finding.table == "object"
    assert finding.message.startswith("index pk_object: ")
    assert "heap tuple lacks matching index tuple" in finding.message
    server.drop_database(url)


def test_knowledge_bases_have_the_structure_in_common(filled: str) -> None:
    with kant_sql.connect(filled, knowledge_base="pepper") as kb:
        kb.propositions.save(FACT)
    tamper(filled, "DROP VIEW audit_goal")
    result = run("verify", filled, "--all", "--json")
    assert result.exit_code == 1
    first, second = map(json.loads, result.stdout.splitlines())
    assert [each["table"] for each in first["findings"]] == ["audit_goal"]
    assert (second["findings"], second["is_intact"]) == ([], True)


@pytest.mark.parametrize("dialect", ["sqlite", "postgresql"])
def test_the_records_are_of_the_last_version(dialect: str) -> None:
    heads = {each.head for each in recorded(dialect)}
    assert {f"CREATE TABLE {table}" for table in Base.metadata.tables} <= {
        head.replace('"', "") for head in heads
    }


WORDS = "'a''b'::character varying, 'c, d'::character varying"
CREATED = {
    "constraint": (
        f"CHECK (((x)::text = ANY ((ARRAY[{WORDS}])::text[])))",
        "CHECK (((x)::text = ANY (ARRAY[('a''b'::character varying)::text, "
        "('c, d'::character varying)::text])))",
    ),
    "view": (
        f"WHEN x::text = ANY (ARRAY[{WORDS}]::text[]) THEN 1",
        "WHEN x::text = ANY (ARRAY['a''b'::character varying::text, "
        "'c, d'::character varying::text]) THEN 1",
    ),
}


@pytest.mark.parametrize("kind", CREATED)
def test_a_list_of_words_is_one_after_a_restore_with_other_words_another(kind: str) -> None:
    created, restored = CREATED[kind]
    assert as_created(created) == created
    assert as_created(restored) == created
    assert as_created(restored.replace("c, d", "c, e")) == created.replace("c, d", "c, e")
    # What is not a list of words alone stays.
    other = restored.replace("'c, d'::character varying", "lower('c')")
    assert as_created(other) == other
