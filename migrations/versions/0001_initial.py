"""The tables of a store and the audit views.

`docs/schema.md` describes the tables, `docs/audit.md` the views.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

# Defined here, not imported: a released migration must not change with the library.
METADATA = sa.MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
    }
)
NUMBER = sa.BigInteger()
POSITION = sa.Integer()
FLAG = sa.Boolean()
# The collation "C" sorts by code point, as SQLite does and as the hash of a revision requires.
SHORT_TEXT = sa.String(255).with_variant(sa.String(255, collation="C"), "postgresql")
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
# `json` keeps the very text that was hashed, `jsonb` does not.
CANONICAL_JSON = sa.Text().with_variant(sa.JSON(none_as_null=True), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")
LIVE, CLOSED, GOAL = "until IS NULL", "until IS NOT NULL", "is_goal"


def upgrade() -> None:
    """Create the tables, then the views."""
    for table in METADATA.sorted_tables:
        _create(table)
    fragments = SQLITE if op.get_context().dialect.name == "sqlite" else POSTGRESQL
    for name, query in VIEWS.items():
        op.execute(f"CREATE VIEW {name} AS{_in_dialect(query, fragments).rstrip()}")


def downgrade() -> None:
    """Drop the views and the tables, with all that is stored."""
    for name in reversed(VIEWS):
        op.execute(f"DROP VIEW {name}")
    for table in reversed(METADATA.sorted_tables):
        op.execute(sa.schema.DropTable(table))


def _create(table: sa.Table) -> None:
    """Create a table, its comments and its indexes, in the same order each time."""
    op.execute(sa.schema.CreateTable(table))
    if op.get_context().dialect.supports_comments:
        if table.comment:
            op.execute(sa.schema.SetTableComment(table))
        for column in table.columns:
            if column.comment:
                op.execute(sa.schema.SetColumnComment(column))
    for index in sorted(table.indexes, key=lambda index: str(index.name)):
        op.execute(sa.schema.CreateIndex(index))


# Every table starts with `kb_id`, and so do its keys and indexes.


def _key(name: str, kind: Any = NUMBER, comment: str | None = None) -> sa.Column[Any]:
    return sa.Column(name, kind, primary_key=True, autoincrement=False, comment=comment)


def _place(name: str, comment: str | None = None) -> sa.Column[Any]:
    return _key(name, POSITION, comment)


def _column(
    name: str, kind: Any = NUMBER, comment: str | None = None, default: Any = None
) -> sa.Column[Any]:
    return sa.Column(name, kind, nullable=False, comment=comment, server_default=default)


def _optional(name: str, kind: Any = NUMBER, comment: str | None = None) -> sa.Column[Any]:
    return sa.Column(name, kind, comment=comment)


def _since() -> sa.Column[Any]:
    return _key("since", comment="asserted in this revision")


def _until() -> sa.Column[Any]:
    return _optional("until", comment="retracted in this revision; NULL: holds now")


def _text(comment: str = "canonical PDDL") -> sa.Column[Any]:
    return _column("text", LONG_TEXT, comment)


def _alternative() -> sa.Column[Any]:
    return _place("alternative", "from 0: several for either")


def _table(name: str, *items: Any) -> None:
    sa.Table(name, METADATA, _key("kb_id"), *items)


def _to_knowledge_base() -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint(["kb_id"], ["knowledge_base.id"])


def _reference(column: str, table: str) -> sa.ForeignKeyConstraint:
    return sa.ForeignKeyConstraint(["kb_id", column], [f"{table}.kb_id", f"{table}.id"])


def _to_revision(
    column: str, name: str | None = None, at_commit: bool = False
) -> sa.ForeignKeyConstraint:
    # The row of a revision holds the hash of all its changes, so it is inserted last.
    return sa.ForeignKeyConstraint(
        ["kb_id", column],
        ["revision.kb_id", "revision.number"],
        name=name,
        deferrable=at_commit or None,
        initially="DEFERRED" if at_commit else None,
    )


def _index(table: str, name: str, *columns: str) -> sa.Index:
    return sa.Index(f"ix_{table}_{name}", "kb_id", *columns)


def _partial(table: str, name: str, *columns: str, where: str, unique: bool = False) -> sa.Index:
    return sa.Index(
        f"{'uq' if unique else 'ix'}_{table}_{name}",
        "kb_id",
        *columns,
        unique=unique,
        # SQLite uses a partial index only for queries that contain its exact condition.
        sqlite_where=sa.text("is_goal = 1" if where == GOAL else where),
        postgresql_where=sa.text(where),
    )


def _lookup(table: str, column: str) -> sa.Index:
    """Make the index by which the views find a name or a text.

    On PostgreSQL it is a hash index: a text may exceed the size limit of a b-tree entry, and the
    planner would use an index that begins with `kb_id` for other queries while statistics are
    missing.
    """
    return sa.Index(f"ix_{table}_{column}", column, postgresql_using="hash")


def _version_items(table: str, *owner: str, has_lists: bool = False) -> tuple[Any, ...]:
    """Return the constraints and indexes that all version tables have."""
    return (
        _to_revision("since", at_commit=True),
        _to_revision("until", at_commit=True),
        sa.CheckConstraint("since < until", name="since_before_until"),
        # These two find the changes of a revision, and the rows that its deferred foreign keys
        # check. The owner is included because PostgreSQL may use the index to look up the version
        # of an entry of a list, and one revision may add thousands.
        _index(table, "since", "since", *(owner if has_lists else ())),
        _partial(table, "until", "until", where=CLOSED),
        _partial(table, "live", *owner, where=LIVE, unique=True),
    )


def _record(name: str, about: str, *columns: sa.Column[Any]) -> None:
    """Make a table of what is recorded once, about an earlier revision."""
    _table(
        name,
        _key("id"),
        _column("since", comment="recorded in this revision"),
        *columns,
        _text("all of it in canonical form"),
        _to_knowledge_base(),
        _to_revision("since", at_commit=True),
        _to_revision("revision", f"fk_{name}_{about}"),
        _index(name, "since", "since"),
        _index(name, "revision", "revision"),
    )


def _identity(element: str, *items: Any) -> None:
    """Make the table of an element for ever, apart from what held of it when."""
    _table(
        element,
        _key("id"),
        _column("name", SHORT_TEXT, "in its first spelling"),
        _column("key", LONG_TEXT, "the name as compared: case folded"),
        _to_knowledge_base(),
        sa.UniqueConstraint("kb_id", "key"),
        *items,
    )


def _version(element: str, *items: Any) -> None:
    """Make the table of what held of an element from one revision until another."""
    owner, table = f"{element}_id", f"{element}_version"
    _table(
        table,
        _key(owner),
        _since(),
        _until(),
        *items,
        _reference(owner, element),
        *_version_items(table, owner, has_lists=True),
    )


def _list(element: str, name: str, *items: Any) -> None:
    """Make the table of a list that each version of an element has."""
    _table(f"{element}_{name}", _key(f"{element}_id"), _since(), *items)


def _within(
    element: str, name: str, *columns: str, to: tuple[str, ...] = (), key: str | None = None
) -> sa.ForeignKeyConstraint:
    """Make a reference to a row of the same version, in another table of the element."""
    version = ("kb_id", f"{element}_id", "since")
    targets = [f"{element}_{name}.{column}" for column in (*version, *(to or columns))]
    return sa.ForeignKeyConstraint([*version, *columns], targets, name=key)


def _types(element: str, name: str, column: str = "type_id") -> tuple[Any, ...]:
    """Return a column that refers to a type, with its constraint and index."""
    index = _index(f"{element}_{name}", column.removesuffix("_id"), column)
    return _column(column), _reference(column, "type"), index


def _type_list(element: str, name: str, column: str = "type_id", first: int = 1) -> None:
    """Make the table of an element's types, or of those after the first."""
    comment = "from 1: the first is in the version" if first else "from 0"
    types = _types(element, name, column)
    _list(element, name, _place("position", comment), *types, _within(element, "version"))


def _parameters(element: str) -> None:
    """Make the tables of an element's parameters, and of the types that each allows."""
    _list(
        element,
        "parameter",
        _place("position", "from 0"),
        _column("name", SHORT_TEXT, "without its question mark"),
        _within(element, "version"),
    )
    _list(
        element,
        "parameter_type",
        _place("position"),
        _alternative(),
        *_types(element, "parameter_type"),
        _within(element, "parameter", "position"),
    )


_NODE = ("section", "position")


def _node_key() -> tuple[Any, ...]:
    section = _key("section", sa.String(24), "the part of its owner")
    return section, _place("position", "from 0, in preorder")


def _trees(element: str, has_parameters: bool, *checks: Any) -> None:
    """Make the tables of an element's expression trees."""
    _nodes(element, *checks)
    _terms(element, has_parameters)
    variable, type_ = f"fk_{element}_variable", f"fk_{element}_variable_type"
    _list(
        element,
        "variable",
        *_node_key(),
        _place("variable", "from 0"),
        _column("name", SHORT_TEXT, "without its question mark"),
        _within(element, "node", *_NODE, key=f"{variable}_node"),
    )
    _list(
        element,
        "variable_type",
        *_node_key(),
        _place("variable"),
        _alternative(),
        *_types(element, "variable_type"),
        _within(element, "variable", *_NODE, "variable", key=f"{type_}_variable"),
    )


def _nodes(element: str, *checks: Any) -> None:
    table = f"{element}_node"
    _list(
        element,
        "node",
        *_node_key(),
        _optional("parent", POSITION, "the position of the node above; NULL: the root"),
        _column(
            "operator",
            sa.String(32),
            "and, not, over all, increase, predicate, function, number ...",
        ),
        _optional("predicate_id"),
        _optional("function_id"),
        _optional(
            "value",
            LONG_TEXT,
            "a number as exact decimal text, a variable's or a preference's name",
        ),
        _within(element, "version", key=f"fk_{table}_version"),
        _within(element, "node", "section", "parent", to=_NODE, key=f"fk_{table}_parent"),
        _reference("predicate_id", "predicate"),
        _reference("function_id", "function"),
        sa.CheckConstraint("parent < position", name="preorder"),
        sa.CheckConstraint("(parent IS NULL) = (position = 0)", name="one_root"),
        sa.CheckConstraint(
            "(operator = 'predicate') = (predicate_id IS NOT NULL)", name="predicate_given"
        ),
        sa.CheckConstraint(
            "(operator = 'function') = (function_id IS NOT NULL)", name="function_given"
        ),
        *checks,
        _index(table, "predicate", "predicate_id"),
        _index(table, "function", "function_id"),
    )


_ONE_OF_FOUR = " + ".join(
    f"CASE WHEN {column} IS NULL THEN 0 ELSE 1 END"
    for column in ("parameter", "object_id", "variable", "child")
)


def _terms(element: str, has_parameters: bool) -> None:
    """Make the table of the terms of nodes: parameters, variables, objects, fluents."""
    table = f"{element}_term"
    bound = ("section", "quantifier", "variable")
    of_parameters: Any = sa.CheckConstraint("parameter IS NULL", name="no_parameter")
    if has_parameters:
        of_parameters = _within(
            element, "parameter", "parameter", to=("position",), key=f"fk_{table}_parameter"
        )
    _list(
        element,
        "term",
        *_node_key(),
        _place("term", "from 0"),
        _optional("parameter", POSITION, "the position of the owner's parameter"),
        _optional("object_id", comment="the constant"),
        _optional("quantifier", POSITION, "the position of the node that binds the variable"),
        _optional("variable", POSITION, "which of the quantifier's variables it is"),
        _optional("child", POSITION, "the position of the function node whose value it is"),
        _within(element, "node", *_NODE, key=f"fk_{table}_node"),
        of_parameters,
        _reference("object_id", "object"),
        _within(element, "variable", *bound, to=(*_NODE, "variable"), key=f"fk_{table}_variable"),
        _within(element, "node", "section", "child", to=_NODE, key=f"fk_{table}_child"),
        sa.CheckConstraint(f"{_ONE_OF_FOUR} = 1", name="one_of_four"),
        sa.CheckConstraint("(quantifier IS NULL) = (variable IS NULL)", name="bound"),
        _index(table, "object", "object_id"),
    )


def _atom(
    element: str, owner: str, unique: str, key: str, text: str, *columns: sa.Column[Any]
) -> None:
    """Make the tables of what applies to objects, interned for ever, and of its arguments."""
    _table(
        element,
        _key("id"),
        _column(f"{owner}_id"),
        *columns,
        _column(
            "arguments",
            LONG_TEXT,
            "the ids of its objects in order, by spaces: the key that interns it",
        ),
        _text(text),
        _reference(f"{owner}_id", owner),
        sa.UniqueConstraint("kb_id", *key.split(), name=f"uq_{element}_{unique}"),
        _lookup(element, "text"),
    )
    _table(
        f"{element}_argument",
        _key(f"{element}_id"),
        _place("position", "from 0"),
        _column("object_id"),
        _reference(f"{element}_id", element),
        _reference("object_id", "object"),
        _index(f"{element}_argument", "object", "object_id", f"{element}_id"),
    )


def _intervals(element: str, owner: str, columns: list[sa.Column[Any]], *items: Any) -> None:
    """Make the table of when something applied to objects."""
    table, id_, owner_id = f"{element}_version", f"{element}_id", f"{owner}_id"
    fork = "the revision from since to before until that the highest power of two divides; "
    _table(
        table,
        _key(id_),
        _since(),
        _until(),
        _column(owner_id),
        *columns,
        _column("fork", NUMBER, f"{fork}0: holds now", sa.text("0")),
        *items,
        *_version_items(table, id_),
        _reference(id_, element),
        _reference(owner_id, owner),
        # `until` makes the index cover reads of the present state.
        _partial(table, "now", owner_id, id_, "until", where=LIVE),
        _index(table, "history", owner_id, "fork", "since", "until", id_),
    )


sa.Table(
    "knowledge_base",
    METADATA,
    _key("id"),
    _column("name", SHORT_TEXT),
    sa.UniqueConstraint("name"),
)
_table(
    "head",
    _column("revision", comment="the last revision; 0: none yet"),
    _column(
        "definition_revision", comment="the last revision that changed anything but propositions"
    ),
    _column("next_id", comment="the id that the next element gets"),
    _optional("hash", LONG_TEXT, "of the last revision"),
    _optional("committed_at", UTC_TIME, "of the last revision"),
    _column(
        "archived_revision",
        NUMBER,
        "what ended up to this revision is in an archive; 0: nothing is",
        sa.text("0"),
    ),
    _to_knowledge_base(),
)
_table(
    "revision",
    _key("number", comment="1, 2, 3 ... without gaps"),
    _column("committed_at", UTC_TIME, "UTC, never going back"),
    _optional("actor", LONG_TEXT, "the component that wrote"),
    _optional("reason", LONG_TEXT),
    _optional("source", CANONICAL_JSON, "what the caller knows: sensor, plan step ..."),
    _column("form", POSITION, "version of the form that was hashed"),
    _column("hash", LONG_TEXT, "SHA-256, chained to the revision before"),
    _optional("observed_at", UTC_TIME, "UTC, when what it says was sensed; NULL: not said"),
    _to_knowledge_base(),
    sa.CheckConstraint("number > 0", name="number_positive"),
    _index("revision", "committed_at", "committed_at"),
)

_identity("type")
_version(
    "type",
    _optional("parent_id", comment="the type above it; NULL: right under the root"),
    _text(),
    _reference("parent_id", "type"),
)
_type_list("type", "parent", "parent_id")

_identity("object", _lookup("object", "name"))
_version(
    "object",
    _column("type_id"),
    _text(),
    _column("is_constant", FLAG, "declared in the domain, not in the problem", sa.false()),
    _reference("type_id", "type"),
)
_type_list("object", "type")

_identity("predicate", _lookup("predicate", "name"))
_version("predicate", _text())
_parameters("predicate")

_identity("function", _lookup("function", "name"))
_version("function", _text())
_parameters("function")
# The types of its values: none for numbers.
_type_list("function", "type", first=0)

_identity("action")
_version(
    "action",
    _text(),
    _column("kind", sa.String(16), "action, durative-action, process or event", "action"),
)
_parameters("action")
_trees(
    "action",
    True,
    sa.CheckConstraint("section IN ('duration', 'condition', 'effect')", name="section"),
)

# The name of a formula is the SHA-256 of its section and its text, in hexadecimal.
_identity("formula")
_version(
    "formula",
    _column("section", sa.String(24), "the part of the domain or the problem that it stands in"),
    _text(),
    sa.CheckConstraint(
        "section IN ('derived', 'domain constraint', 'initial', 'timed', 'goal', 'constraint', "
        "'metric')",
        name="section",
    ),
)
_trees("formula", False)

# The domain and the problem, one of each.
_identity("document", sa.CheckConstraint("key IN ('domain', 'problem')", name="domain_or_problem"))
_version(
    "document",
    _column("title", SHORT_TEXT, "the name in its define form"),
    _optional("domain", SHORT_TEXT, "a problem's domain"),
    _text("all of it on one line"),
)
# What stands at a position of a document: it is live elsewhere, or the position is empty.
_list(
    "document",
    "item",
    _key("section", sa.String(24), "requirement, type, goal ..."),
    _place("position", "from 0"),
    _column("name", LONG_TEXT, "the element's name; for a goal that is a ground atom, its text"),
    _within("document", "version"),
)

_atom(
    "proposition",
    "predicate",
    "atom",
    "is_goal predicate_id arguments",
    "canonical PDDL",
    _column("is_goal", FLAG),
)
_intervals(
    "proposition",
    "predicate",
    [_column("is_goal", FLAG, None, sa.false())],
    # Goals are few among many facts, and current goals are few among past ones.
    _partial("proposition_version", "goal", "until", "since", "proposition_id", where=GOAL),
    _partial(
        "proposition_version",
        "goal_history",
        *("fork", "since", "until", "proposition_id"),
        where=GOAL,
    ),
)
_atom(
    "function_value",
    "function",
    "fluent",
    "function_id arguments",
    "canonical PDDL, without the value",
)
_intervals(
    "function_value",
    "function",
    [
        _optional("value", LONG_TEXT, "the number, as exact decimal text"),
        _optional("number", sa.Double(), "the number, as near as a double comes"),
        _optional("object_id", comment="the object that it is"),
        _text("canonical PDDL, with the value"),
    ],
    _reference("object_id", "object"),
    sa.CheckConstraint("(value IS NULL) <> (object_id IS NULL)", name="value_or_object"),
    sa.CheckConstraint("(value IS NULL) = (number IS NULL)", name="number_of_value"),
    # Numbers change often and do not belong in it.
    _partial("function_value_version", "object", "object_id", where="object_id IS NOT NULL"),
)

GIVEN = "what the planner was given, if it is not what the store writes"
_record(
    "plan",
    "problem",
    _column("revision", comment="the state that it was planned from"),
    _column(
        "problem_hash",
        LONG_TEXT,
        "SHA-256 of the domain and then the problem that the planner was given",
    ),
    _optional("planner", LONG_TEXT),
    _optional("planner_version", LONG_TEXT),
    _optional("objective", LONG_TEXT, "what the plan is to make small or large"),
    _optional("value", LONG_TEXT, "what the objective comes to, as exact decimal text"),
    _optional("status", LONG_TEXT, "what the planner says of it"),
    _optional("domain_pddl", LONG_TEXT, GIVEN),
    _optional("problem_pddl", LONG_TEXT, GIVEN),
)


def _to_step() -> sa.ForeignKeyConstraint:
    key = ("kb_id", "plan_id", "position")
    return sa.ForeignKeyConstraint(key, [f"plan_step.{column}" for column in key])


_table(
    "plan_step",
    _key("plan_id"),
    _place("position", "from 0"),
    _optional("start", LONG_TEXT, "seconds from the plan's beginning, as exact decimal text"),
    _optional("duration", LONG_TEXT, "seconds, as exact decimal text; NULL: an instant"),
    _column("action_id"),
    _text("canonical PDDL, without times"),
    _reference("plan_id", "plan"),
    _reference("action_id", "action"),
    _index("plan_step", "action", "action_id"),
)
_table(
    "plan_step_argument",
    _key("plan_id"),
    _place("position"),
    _place("argument", "from 0"),
    _column("object_id"),
    _to_step(),
    _reference("object_id", "object"),
    _index("plan_step_argument", "object", "object_id"),
)
_table(
    "plan_step_version",
    _key("plan_id"),
    _place("position"),
    _since(),
    _until(),
    _column("status", sa.String(16), "started, succeeded, failed or aborted"),
    _text("which step of which plan, and its status"),
    _to_step(),
    *_version_items("plan_step_version", "plan_id", "position"),
    sa.CheckConstraint("status IN ('started', 'succeeded', 'failed', 'aborted')", name="status"),
)
_table(
    "revision_plan_step",
    _key("number", comment="the revision"),
    _column("plan_id"),
    _column("position", POSITION, "the step's"),
    _to_revision("number"),
    _to_step(),
    _index("revision_plan_step", "step", "plan_id", "position", "number"),
)
_record(
    "archive",
    "upto",
    _column("revision", comment="the versions that ended up to this revision were moved"),
    _column("target", LONG_TEXT, "where to: a URL without its password"),
    _column("versions", comment="how many were moved"),
    _column("rest", LONG_TEXT, "SHA-256 of what this store keeps of the revisions up to there"),
)


# What the two dialects have to say differently. Times in seconds are exact: the microseconds since
# 1970, and those between two times, are whole numbers that a double has.
SQLITE = {
    "EPOCH": "(strftime('%s', substr({0}, 1, 19)) * 1000000 + substr({0}, 21, 6)) / 1000000.0",
    "SECONDS": "((strftime('%s', substr({1}, 1, 19)) - strftime('%s', substr({0}, 1, 19)))"
    " * 1000000 + substr({1}, 21, 6) - substr({0}, 21, 6)) / 1000000.0",
    "HOUR": "substr({0}, 1, 13)",
    "TEXT": "{0}",
    "WORD": "'{0}'",
    "DOUBLE": "CAST({0} AS REAL)",
    # SQLite uses a partial index only where a query repeats its very condition.
    "IS": "{0} = 1",
    # Without statistics SQLite takes all of a knowledge base for ten rows, and would read that
    # rather than begin at what a question is about. Of the shares that were tried, these give every
    # condition its index, with statistics and without; revisions need none.
    "OF": "likelihood({0}, 0.05)",
    "ONE": "likelihood({0}, 0.01)",
}
POSTGRESQL = {
    "EPOCH": "CAST(extract(epoch FROM {0}) AS double precision)",
    "SECONDS": "CAST(extract(epoch FROM {1} - {0}) AS double precision)",
    "HOUR": "to_char({0} AT TIME ZONE 'UTC', 'YYYY-MM-DD\"T\"HH24') COLLATE \"C\"",
    "TEXT": 'CAST({0} AS text) COLLATE "C"',
    "WORD": "CAST('{0}' AS text) COLLATE \"C\"",
    "DOUBLE": "CAST({0} AS double precision)",
    "IS": "{0}",
    "OF": "{0}",
    "ONE": "{0}",
}
FRAGMENT = re.compile(rf"\b({'|'.join(SQLITE)})\(([^()]*)\)")

# A view is about the rows of one table, `v`, and looks up what they mention. That is there, by
# foreign keys. Yet the joins are left joins: so both databases leave out those that a question does
# not ask for, begin at the other end only where a condition is on that, and need no statistics.
KNOWLEDGE_BASE = "LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)"
REVISION = """
    r.committed_at,
    EPOCH(r.committed_at) AS committed_epoch,
    HOUR(r.committed_at) AS committed_hour,
    r.observed_at,
    EPOCH(r.observed_at) AS observed_epoch,
    SECONDS(r.observed_at, r.committed_at) AS delay,
    r.actor,
    r.reason,
    TEXT(r.source) AS source,
    x.plan_id,
    x.position AS plan_step"""
ASSERTED = """
    v.since,
    s.committed_at AS since_at,
    EPOCH(s.committed_at) AS since_epoch,
    s.observed_at AS since_observed_at,
    s.actor AS asserted_by,
    s.reason AS asserted_reason"""
INTERVAL = f"""{ASSERTED},
    v.until,
    u.committed_at AS until_at,
    EPOCH(u.committed_at) AS until_epoch,
    u.observed_at AS until_observed_at,
    u.actor AS retracted_by,
    u.reason AS retracted_reason,
    SECONDS(s.committed_at, u.committed_at) AS duration"""
SINCE = f"""{KNOWLEDGE_BASE}
LEFT JOIN revision AS s ON s.kb_id = v.kb_id AND s.number = v.since"""
ENDS = f"""{SINCE}
LEFT JOIN revision AS u ON u.kb_id = v.kb_id AND u.number = v.until"""

AUDIT_REVISION = f"""
SELECT
    k.name AS knowledge_base,
    r.number AS revision,{REVISION},
    r.form,
    r.hash
FROM revision AS r
LEFT JOIN knowledge_base AS k ON OF(k.id = r.kb_id)
LEFT JOIN revision_plan_step AS x ON x.kb_id = r.kb_id AND x.number = r.number
"""

# What revisions change: a table, its rows' kind, the id of their element, their text, and which.
CHANGED = (
    ("type_version", "WORD(type)", "v.type_id", "v.text", ""),
    ("object_version", "WORD(object)", "v.object_id", "v.text", ""),
    ("predicate_version", "WORD(predicate)", "v.predicate_id", "v.text", ""),
    ("function_version", "WORD(function)", "v.function_id", "v.text", ""),
    ("action_version", "WORD(action)", "v.action_id", "v.text", ""),
    ("formula_version", "TEXT(v.section)", "v.formula_id", "v.text", ""),
    ("document_version", "WORD(document)", "v.document_id", "v.text", ""),
    ("proposition_version", "WORD(fact)", "v.proposition_id", "p.text", "NOT v.is_goal"),
    ("proposition_version", "WORD(goal)", "v.proposition_id", "p.text", "IS(v.is_goal)"),
    ("function_value_version", "WORD(value)", "v.function_value_id", "v.text", ""),
    ("plan", "WORD(plan)", "v.id", "v.text", ""),
    ("plan_step_version", "WORD(plan step)", "v.plan_id", "v.text", ""),
    ("archive", "WORD(archive)", "v.id", "v.text", ""),
)
NEVER_RETRACTED = ("plan", "archive")
PROPOSITION = "\nLEFT JOIN proposition AS p ON p.kb_id = v.kb_id AND ONE(p.id = v.proposition_id)"


def _changes() -> Iterator[str]:
    """Give what selects the ends of the rows of each table."""
    for sign, end in (("+", "since"), ("-", "until")):
        for table, kind, element, text, which in CHANGED:
            if sign == "-" and table in NEVER_RETRACTED:
                continue
            conditions = [part for part in (which, "v.until IS NOT NULL" * (sign == "-")) if part]
            where = f"\nWHERE {' AND '.join(conditions)}" if conditions else ""
            yield f"""
SELECT
    k.name AS knowledge_base,
    v.{end} AS revision,
    WORD({sign}) AS sign,
    {kind} AS kind,
    {text} AS text,
    {element} AS element_id,{REVISION}
FROM {table} AS v
{KNOWLEDGE_BASE}{PROPOSITION if text == "p.text" else ""}
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.{end}
LEFT JOIN revision_plan_step AS x ON x.kb_id = v.kb_id AND x.number = v.{end}{where}
"""


AUDIT_FACT = f"""
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN WORD(goal) ELSE WORD(fact) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    rtrim(substr(p.text, length(d.name) + 3), ')') AS arguments,
    p.text,{INTERVAL}
FROM proposition_version AS v{PROPOSITION}
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.predicate_id)
{ENDS}
"""
AUDIT_GOAL = f"""{AUDIT_FACT}WHERE IS(v.is_goal)
"""
# An argument of the version `v` of an atom, by its predicate or function.
ARGUMENT = """(
        SELECT m.name
        FROM {0}_version AS w
        JOIN {0}_parameter AS m ON m.kb_id = w.kb_id
            AND m.{0}_id = w.{0}_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.{0}_id = v.{0}_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id"""
AUDIT_FACT_ARGUMENT = f"""
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN WORD(goal) ELSE WORD(fact) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    p.text,
    a.position,
    {ARGUMENT.format("predicate")},{INTERVAL}
FROM proposition_version AS v
JOIN proposition_argument AS a ON a.kb_id = v.kb_id AND ONE(a.proposition_id = v.proposition_id)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND ONE(o.id = a.object_id){PROPOSITION}
LEFT JOIN predicate AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.predicate_id)
{ENDS}
"""

AUDIT_VALUE = f"""
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    rtrim(substr(f.text, length(d.name) + 3), ')') AS arguments,
    f.text AS fluent,
    COALESCE(v.value, o.name) AS value,
    v.number,
    v.text,{INTERVAL}
FROM function_value_version AS v
LEFT JOIN function_value AS f ON f.kb_id = v.kb_id AND ONE(f.id = v.function_value_id)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.function_id)
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
{ENDS}
"""
AUDIT_VALUE_ARGUMENT = f"""
SELECT
    k.name AS knowledge_base,
    v.function_value_id,
    d.name AS function,
    v.text,
    a.position,
    {ARGUMENT.format("function")},{INTERVAL}
FROM function_value_version AS v
JOIN function_value_argument AS a ON a.kb_id = v.kb_id
    AND ONE(a.function_value_id = v.function_value_id)
LEFT JOIN object AS o ON o.kb_id = a.kb_id AND ONE(o.id = a.object_id)
LEFT JOIN function AS d ON d.kb_id = v.kb_id AND ONE(d.id = v.function_id)
{ENDS}
"""

# Of `rb1 - robot`, or of `(:constants rb1 - robot)`, what comes last.
AUDIT_OBJECT = f"""
SELECT
    k.name AS knowledge_base,
    o.name AS object,
    v.object_id,
    CASE WHEN v.is_constant
        THEN substr(v.text, length(o.name) + 16, length(v.text) - length(o.name) - 16)
        ELSE substr(v.text, length(o.name) + 4) END AS type,
    v.is_constant,
    v.text,{INTERVAL}
FROM object_version AS v
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
{ENDS}
"""


def _definitions() -> Iterator[str]:
    """Give what selects the definitions of each kind."""
    for table, kind, element, text, _ in CHANGED[:7]:
        yield f"""
SELECT
    k.name AS knowledge_base,
    {kind} AS kind,
    n.name,
    {element} AS element_id,
    {text},{INTERVAL}
FROM {table} AS v
LEFT JOIN {table.removesuffix("_version")} AS n ON n.kb_id = v.kb_id AND ONE(n.id = {element})
{ENDS}
"""


AUDIT_ACTION = f"""
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    v.action_id,
    TEXT(v.kind) AS kind,
    v.text,{INTERVAL}
FROM action_version AS v
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND ONE(a.id = v.action_id)
{ENDS}
"""

# From a leaf of a tree up to its root. `asserted` and `denied` say whether the leaf is one of
# several cases, given that the nodes above deny an even or an odd number of times: under a denial,
# `and` is what `or` is else. The first node below another is the one that comes next in preorder.
TREE = "{0}.kb_id = n.kb_id AND {0}.action_id = n.action_id AND {0}.since = n.since"
WALK = f"""(
        WITH RECURSIVE walk (position, above, is_denied, asserted, denied, time, is_need) AS (
            SELECT n.position, n.parent, 0, 0, 0, CAST(NULL AS varchar(32)),
                CASE WHEN n.section = 'condition' THEN 1 ELSE 0 END
            UNION ALL
            SELECT m.position, m.parent,
                CASE WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN 1 - walk.is_denied ELSE walk.is_denied END,
                CASE WHEN m.operator IN ('or', 'imply', 'exists', 'forall', 'when', 'preference')
                    THEN 1 WHEN m.operator = 'not' THEN walk.denied ELSE walk.asserted END,
                CASE WHEN m.operator IN ('and', 'exists', 'forall', 'when', 'preference') THEN 1
                    WHEN m.operator = 'not'
                    OR m.operator = 'imply' AND walk.position = m.position + 1
                    THEN walk.asserted ELSE walk.denied END,
                CASE WHEN m.operator IN ('at start', 'over all', 'at end')
                    THEN m.operator ELSE walk.time END,
                CASE WHEN m.operator = 'when' AND walk.position = m.position + 1
                    THEN 1 ELSE walk.is_need END
            FROM walk
            JOIN action_node AS m ON {TREE.format("m")} AND m.section = n.section
                AND m.position = walk.above
        )
        SELECT {{0}} FROM walk WHERE above IS NULL
    )"""
ROLE = WALK.format(
    """CASE WHEN is_need = 1
            THEN CASE WHEN is_denied = 0 THEN WORD(needs) ELSE WORD(needs not) END
            ELSE CASE WHEN is_denied = 0 THEN WORD(adds) ELSE WORD(deletes) END END"""
)
# A literal's text, term by term: down into the fluents among its terms, and out of them again.
SPELL = f"""(
        WITH RECURSIVE spell (position, term, text) AS (
            SELECT n.position, 0, '(' || d.name
            UNION ALL
            SELECT
                CASE WHEN t.child IS NOT NULL THEN t.child
                    WHEN t.term IS NULL THEN o.position ELSE spell.position END,
                CASE WHEN t.child IS NOT NULL THEN 0
                    WHEN t.term IS NULL THEN o.term + 1 ELSE spell.term + 1 END,
                spell.text || CASE WHEN t.term IS NULL THEN ')'
                    WHEN t.child IS NOT NULL THEN ' (' || (
                        SELECT f.name FROM action_node AS c
                        JOIN function AS f ON f.kb_id = c.kb_id AND f.id = c.function_id
                        WHERE {TREE.format("c")} AND c.section = n.section AND c.position = t.child
                    )
                    WHEN t.object_id IS NOT NULL THEN ' ' || (
                        SELECT e.name FROM object AS e
                        WHERE e.kb_id = n.kb_id AND e.id = t.object_id
                    )
                    WHEN t.parameter IS NOT NULL THEN ' ?' || (
                        SELECT q.name FROM action_parameter AS q
                        WHERE {TREE.format("q")} AND q.position = t.parameter
                    )
                    ELSE ' ?' || (
                        SELECT b.name FROM action_variable AS b
                        WHERE {TREE.format("b")} AND b.section = n.section
                            AND b.position = t.quantifier AND b.variable = t.variable
                    ) END
            FROM spell
            LEFT JOIN action_term AS t ON {TREE.format("t")} AND t.section = n.section
                AND t.position = spell.position AND t.term = spell.term
            LEFT JOIN action_term AS o ON t.term IS NULL AND {TREE.format("o")}
                AND o.section = n.section AND o.child = spell.position
            WHERE spell.position IS NOT NULL
        )
        SELECT text FROM spell WHERE position IS NULL
    )"""
AUDIT_ACTION_LITERAL = f"""
SELECT
    k.name AS knowledge_base,
    a.name AS action,
    n.action_id,
    TEXT(v.kind) AS kind,
    TEXT(n.section) AS section,
    n.position,
    {ROLE} AS role,
    d.name AS predicate,
    {SPELL} AS literal,
    {WALK.format("TEXT(time)")} AS time,
    {WALK.format("asserted = 1")} AS is_conditional,{INTERVAL}
FROM action_node AS n
JOIN action_version AS v ON v.kb_id = n.kb_id AND v.action_id = n.action_id AND v.since = n.since
LEFT JOIN action AS a ON a.kb_id = n.kb_id AND a.id = n.action_id
LEFT JOIN predicate AS d ON d.kb_id = n.kb_id AND d.id = n.predicate_id
{ENDS}
WHERE n.predicate_id IS NOT NULL
"""


def _count(status: str, name: str) -> str:
    """Give what counts the steps of a plan that are at a status."""
    return f"""(
        SELECT count(*) FROM plan_step_version AS w
        WHERE w.kb_id = v.kb_id AND w.plan_id = v.id AND w.until IS NULL AND w.status = '{status}'
    ) AS steps_{name}"""


AUDIT_PLAN = f"""
SELECT
    k.name AS knowledge_base,
    v.id AS plan_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.problem_hash,
    v.planner,
    v.planner_version,
    v.objective,
    v.value,
    DOUBLE(v.value) AS number,
    v.status,
    (
        SELECT count(*) FROM plan_step AS w WHERE w.kb_id = v.kb_id AND w.plan_id = v.id
    ) AS steps,
    {_count("started", "running")},
    {_count("succeeded", "succeeded")},
    {_count("failed", "failed")},
    {_count("aborted", "aborted")},{ASSERTED},
    v.text,
    v.domain_pddl,
    v.problem_pddl
FROM plan AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
{SINCE}
"""
AUDIT_PLAN_STEP = f"""
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    a.name AS action,
    rtrim(substr(v.text, length(a.name) + 3), ')') AS arguments,
    v.text,
    DOUBLE(v.start) AS planned_start,
    DOUBLE(v.duration) AS planned_duration,
    TEXT(w.status) AS status,
    b.since AS started,
    s.committed_at AS started_at,
    EPOCH(s.committed_at) AS started_epoch,
    s.actor AS started_by,
    u.number AS ended,
    u.committed_at AS ended_at,
    EPOCH(u.committed_at) AS ended_epoch,
    u.actor AS ended_by,
    u.reason AS ended_reason,
    SECONDS(s.committed_at, u.committed_at) AS duration,
    (
        SELECT count(*) FROM revision_plan_step AS x
        WHERE x.kb_id = v.kb_id AND x.plan_id = v.plan_id AND x.position = v.position
    ) AS revisions
FROM plan_step AS v
{KNOWLEDGE_BASE}
LEFT JOIN action AS a ON a.kb_id = v.kb_id AND ONE(a.id = v.action_id)
LEFT JOIN plan_step_version AS w ON w.kb_id = v.kb_id AND w.plan_id = v.plan_id
    AND w.position = v.position AND w.until IS NULL
LEFT JOIN plan_step_version AS b ON b.kb_id = v.kb_id AND b.plan_id = v.plan_id
    AND b.position = v.position AND b.since = (
        SELECT max(c.since) FROM plan_step_version AS c
        WHERE c.kb_id = v.kb_id AND c.plan_id = v.plan_id AND c.position = v.position
            AND c.status = 'started'
    )
LEFT JOIN revision AS s ON s.kb_id = b.kb_id AND s.number = b.since
LEFT JOIN revision AS u ON u.kb_id = w.kb_id AND u.number = w.since AND w.status <> 'started'
"""
AUDIT_PLAN_STEP_STATUS = f"""
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    TEXT(v.status) AS status,
    v.text,{INTERVAL}
FROM plan_step_version AS v
{ENDS}
"""
AUDIT_PLAN_STEP_ARGUMENT = """
SELECT
    k.name AS knowledge_base,
    v.plan_id,
    v.position,
    p.text,
    v.argument,
    o.name AS object,
    v.object_id
FROM plan_step_argument AS v
LEFT JOIN plan_step AS p ON p.kb_id = v.kb_id AND p.plan_id = v.plan_id AND p.position = v.position
LEFT JOIN object AS o ON o.kb_id = v.kb_id AND ONE(o.id = v.object_id)
LEFT JOIN knowledge_base AS k ON OF(k.id = v.kb_id)
"""
AUDIT_ARCHIVE = f"""
SELECT
    k.name AS knowledge_base,
    v.id AS archive_id,
    v.revision,
    r.committed_at AS revision_at,
    EPOCH(r.committed_at) AS revision_epoch,
    v.target,
    v.versions,
    v.rest,{ASSERTED},
    v.text
FROM archive AS v
LEFT JOIN revision AS r ON r.kb_id = v.kb_id AND r.number = v.revision
{SINCE}
"""

VIEWS = {
    "audit_revision": AUDIT_REVISION,
    "audit_change": "UNION ALL".join(_changes()),
    "audit_fact": AUDIT_FACT,
    "audit_goal": AUDIT_GOAL,
    "audit_fact_argument": AUDIT_FACT_ARGUMENT,
    "audit_value": AUDIT_VALUE,
    "audit_value_argument": AUDIT_VALUE_ARGUMENT,
    "audit_object": AUDIT_OBJECT,
    "audit_definition": "UNION ALL".join(_definitions()),
    "audit_action": AUDIT_ACTION,
    "audit_action_literal": AUDIT_ACTION_LITERAL,
    "audit_plan": AUDIT_PLAN,
    "audit_plan_step": AUDIT_PLAN_STEP,
    "audit_plan_step_status": AUDIT_PLAN_STEP_STATUS,
    "audit_plan_step_argument": AUDIT_PLAN_STEP_ARGUMENT,
    "audit_archive": AUDIT_ARCHIVE,
}


def _in_dialect(query: str, fragments: dict[str, str]) -> str:
    """Write a query as one dialect has it."""
    return FRAGMENT.sub(lambda found: fragments[found[1]].format(*found[2].split(", ")), query)
