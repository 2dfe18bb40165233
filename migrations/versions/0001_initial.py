"""The tables of a store and the audit views.

`docs/schema.md` describes the tables, `docs/audit.md` the views.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

# Defined here, not imported: a released migration must not change with the library. For the same
# reason every name goes through `op.f`, which keeps the models' naming convention away from it.
NUMBER = sa.BigInteger()
POSITION = sa.Integer()
FLAG = sa.Boolean()
# The collation "C" sorts by code point, as SQLite does and as the hash of a revision requires.
SHORT_TEXT = sa.String(255).with_variant(sa.String(255, collation="C"), "postgresql")
LONG_TEXT = sa.Text().with_variant(sa.Text(collation="C"), "postgresql")
# `json` keeps the very text that was hashed, `jsonb` does not.
CANONICAL_JSON = sa.Text().with_variant(sa.JSON(none_as_null=True), "postgresql")
UTC_TIME = sa.String(27).with_variant(sa.TIMESTAMP(timezone=True), "postgresql")


def upgrade() -> None:
    """Create the tables, then the views."""
    op.create_table(
        "knowledge_base",
        _column("id"),
        _column("name", SHORT_TEXT),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_knowledge_base")),
        sa.UniqueConstraint("name", name=op.f("uq_knowledge_base_name")),
    )
    for table in _tables():
        table.create()
    fragments = SQLITE if op.get_context().dialect.name == "sqlite" else POSTGRESQL
    for name, query in VIEWS.items():
        op.execute(f"CREATE VIEW {name} AS{_in_dialect(query, fragments).rstrip()}")


def downgrade() -> None:
    """Drop the views and the tables, with all that is stored."""
    for name in reversed(VIEWS):
        op.execute(f"DROP VIEW {name}")
    for table in reversed([*_tables()]):
        op.drop_table(table.name)
    op.drop_table("knowledge_base")


# Every table starts with `kb_id`, and so do its keys and indexes: the descriptions omit it. Several
# columns are one string, separated by spaces.


class Reference(NamedTuple):
    """A foreign key; `target` are the referenced columns, where their names differ."""

    columns: str
    table: str
    target: str = ""
    name: str = ""
    # The row of a revision holds the hash of all its changes, so it is inserted last.
    at_commit: bool = False

    def constraint(self, table: str) -> sa.ForeignKeyConstraint:
        """Make the constraint of a table."""
        own = ["kb_id", *self.columns.split()]
        target = ["kb_id", *(self.target or self.columns).split()] if self.columns else ["id"]
        return sa.ForeignKeyConstraint(
            own,
            [f"{self.table}.{column}" for column in target],
            name=op.f(f"fk_{table}_{self.name or '_'.join(own)}"),
            deferrable=self.at_commit or None,
            initially="DEFERRED" if self.at_commit else None,
        )


class Index(NamedTuple):
    """An index; `where` makes it partial."""

    name: str
    columns: str
    where: str = ""
    unique: bool = False

    def create(self, table: str) -> None:
        """Create the index of a table."""
        # SQLite uses a partial index only for queries that contain its exact condition.
        on_sqlite = "is_goal = 1" if self.where == GOAL else self.where
        op.create_index(
            op.f(f"{'uq' if self.unique else 'ix'}_{table}_{self.name}"),
            table,
            ["kb_id", *self.columns.split()],
            unique=self.unique,
            sqlite_where=sa.text(on_sqlite) if self.where else None,
            postgresql_where=sa.text(self.where) if self.where else None,
        )


class Lookup(NamedTuple):
    """An index by which the views find a name or a text.

    On PostgreSQL it is a hash index: a text may exceed the size limit of a b-tree entry, and the
    planner would use an index that begins with `kb_id` for other queries while statistics are
    missing.
    """

    column: str

    def create(self, table: str) -> None:
        """Create the index of a table."""
        name = op.f(f"ix_{table}_{self.column}")
        op.create_index(name, table, [self.column], postgresql_using="hash")


class Table(NamedTuple):
    """A table; `checks`, `uniques` and `indexes` have the last part of the constraint's name."""

    name: str
    key: str
    columns: list[sa.Column[Any]]
    references: list[Reference]
    checks: Mapping[str, str] = MappingProxyType({})
    uniques: Mapping[str, str] = MappingProxyType({})
    indexes: Sequence[Index | Lookup] = ()

    def create(self) -> None:
        """Create the table and its indexes."""
        checks = (
            sa.CheckConstraint(condition, name=op.f(f"ck_{self.name}_{name}"))
            for name, condition in self.checks.items()
        )
        uniques = (
            sa.UniqueConstraint("kb_id", *columns.split(), name=op.f(f"uq_{self.name}_{name}"))
            for name, columns in self.uniques.items()
        )
        op.create_table(
            self.name,
            _column("kb_id"),
            *self.columns,
            sa.PrimaryKeyConstraint("kb_id", *self.key.split(), name=op.f(f"pk_{self.name}")),
            *(reference.constraint(self.name) for reference in self.references),
            *checks,
            *uniques,
        )
        for index in self.indexes:
            index.create(self.name)


def _column(
    name: str,
    kind: sa.types.TypeEngine[Any] = NUMBER,
    comment: str | None = None,
    default: Any = None,
) -> sa.Column[Any]:
    """Make a column that always has a value: a number, unless another kind is given."""
    return sa.Column(
        name, kind, autoincrement=False, nullable=False, comment=comment, server_default=default
    )


def _optional(
    name: str, kind: sa.types.TypeEngine[Any] = NUMBER, comment: str | None = None
) -> sa.Column[Any]:
    """Make a column that may be NULL."""
    return sa.Column(name, kind, nullable=True, comment=comment)


TO_KNOWLEDGE_BASE = Reference("", "knowledge_base")
AT_SINCE = Reference("since", "revision", "number", at_commit=True)
AT_UNTIL = Reference("until", "revision", "number", at_commit=True)
LIVE, CLOSED, GOAL = "until IS NULL", "until IS NOT NULL", "is_goal"


def _since() -> sa.Column[Any]:
    return _column("since", comment="asserted in this revision")


def _until() -> sa.Column[Any]:
    return _optional("until", comment="retracted in this revision; NULL: holds now")


def _section() -> sa.Column[Any]:
    return _column("section", sa.String(24), "the part of its owner")


def _position(comment: str | None = "from 0") -> sa.Column[Any]:
    return _column("position", POSITION, comment)


def _text(comment: str = "canonical PDDL") -> sa.Column[Any]:
    return _column("text", LONG_TEXT, comment)


def _fork() -> sa.Column[Any]:
    return _column(
        "fork",
        comment="the revision from since to before until that the highest power of two divides; "
        "0: holds now",
        default=sa.text("0"),
    )


def _tables() -> Iterator[Table]:
    """Describe the tables, each below those that it refers to."""
    yield from _revisions()
    yield from _types()
    yield from _objects()
    yield from _predicates()
    yield from _propositions()
    yield from _functions()
    yield from _function_values()
    yield from _actions()
    yield from _formulas()
    yield from _documents()
    yield from _plans()
    yield from _archives()


def _revisions() -> Iterator[Table]:
    """Describe the tables of revisions."""
    yield Table(
        "head",
        "",
        [
            _column("revision", comment="the last revision; 0: none yet"),
            _column(
                "definition_revision",
                comment="the last revision that changed anything but propositions",
            ),
            _column("next_id", comment="the id that the next element gets"),
            _optional("hash", LONG_TEXT, "of the last revision"),
            _optional("committed_at", UTC_TIME, "of the last revision"),
            _column(
                "archived_revision",
                comment="what ended up to this revision is in an archive; 0: nothing is",
                default=sa.text("0"),
            ),
        ],
        [TO_KNOWLEDGE_BASE],
    )
    yield Table(
        "revision",
        "number",
        [
            _column("number", comment="1, 2, 3 ... without gaps"),
            _column("committed_at", UTC_TIME, "UTC, never going back"),
            _optional("actor", LONG_TEXT, "the component that wrote"),
            _optional("reason", LONG_TEXT),
            _optional("source", CANONICAL_JSON, "what the caller knows: sensor, plan step ..."),
            _column("form", sa.Integer(), "version of the form that was hashed"),
            _column("hash", LONG_TEXT, "SHA-256, chained to the revision before"),
            _optional("observed_at", UTC_TIME, "UTC, when what it says was sensed; NULL: not said"),
        ],
        [TO_KNOWLEDGE_BASE],
        checks={"number_positive": "number > 0"},
        indexes=[Index("committed_at", "committed_at")],
    )


def _identity(element: str, checks: dict[str, str] | None = None, lookup: bool = False) -> Table:
    """Describe the table of a named element's identities."""
    return Table(
        element,
        "id",
        [
            _column("id"),
            _column("name", SHORT_TEXT, "in its first spelling"),
            _column("key", LONG_TEXT, "the name as compared: case folded"),
        ],
        [TO_KNOWLEDGE_BASE],
        checks or {},
        {"kb_id_key": "key"},
        [Lookup("name")] if lookup else [],
    )


def _version(
    element: str,
    columns: list[sa.Column[Any]],
    references: list[Reference] | None = None,
    checks: dict[str, str] | None = None,
    indexes: list[Index | Lookup] | None = None,
    has_parts: bool = True,
) -> Table:
    """Describe the table of what held of an element, and when; tables of parts may refer to it."""
    owner = f"{element}_id"
    return Table(
        f"{element}_version",
        f"{owner} since",
        [_column(owner), _since(), _until(), *columns],
        [Reference(owner, element, "id"), AT_SINCE, AT_UNTIL, *(references or [])],
        {"since_before_until": "since < until", **(checks or {})},
        indexes=[
            # These two find the changes of a revision, and the rows that its deferred foreign keys
            # check. The owner is included because PostgreSQL may use the index to look up the
            # version of a part, and one revision may add thousands.
            Index("since", f"since {owner}" if has_parts else "since"),
            Index("until", "until", CLOSED),
            Index("live", owner, LIVE, unique=True),
            *(indexes or []),
        ],
    )


def _part(
    element: str,
    name: str,
    key: str,
    columns: list[sa.Column[Any]],
    references: list[Reference],
    indexes: list[Index | Lookup] | None = None,
    checks: dict[str, str] | None = None,
) -> Table:
    """Describe a table of parts of one version of an element."""
    owner = f"{element}_id"
    return Table(
        f"{element}_{name}",
        f"{owner} since {key}",
        [_column(owner), _since(), *columns],
        references,
        checks or {},
        indexes=indexes or [],
    )


def _parameters(element: str) -> Iterator[Table]:
    """Describe the tables of an element's parameters, and of the types that each allows."""
    version = f"{element}_id since"
    yield _part(
        element,
        "parameter",
        "position",
        [_position(), _column("name", SHORT_TEXT, "without its question mark")],
        [Reference(version, f"{element}_version")],
    )
    yield _part(
        element,
        "parameter_type",
        "position alternative",
        [_position(None), _alternative(), _column("type_id")],
        [
            Reference(f"{version} position", f"{element}_parameter"),
            Reference("type_id", "type", "id"),
        ],
        [Index("type", "type_id")],
    )


def _alternative() -> sa.Column[Any]:
    return _column("alternative", POSITION, "from 0: several for either")


def _types() -> Iterator[Table]:
    """Describe the tables of types."""
    yield _identity("type")
    yield _version(
        "type",
        [_optional("parent_id", comment="the type above it; NULL: right under the root"), _text()],
        [Reference("parent_id", "type", "id")],
    )
    yield _part(
        "type",
        "parent",
        "position",
        [_position("from 1: the first is in the version"), _column("parent_id")],
        [Reference("type_id since", "type_version"), Reference("parent_id", "type", "id")],
        [Index("parent", "parent_id")],
    )


def _objects() -> Iterator[Table]:
    """Describe the tables of objects."""
    yield _identity("object", lookup=True)
    yield _version(
        "object",
        [
            _column("type_id"),
            _text(),
            _column(
                "is_constant",
                FLAG,
                "declared in the domain, not in the problem",
                default=sa.false(),
            ),
        ],
        [Reference("type_id", "type", "id")],
    )
    yield _part(
        "object",
        "type",
        "position",
        [_position("from 1: the first is in the version"), _column("type_id")],
        [Reference("object_id since", "object_version"), Reference("type_id", "type", "id")],
        [Index("type", "type_id")],
    )


def _predicates() -> Iterator[Table]:
    """Describe the tables of predicates."""
    yield _identity("predicate", lookup=True)
    yield _version("predicate", [_text()])
    yield from _parameters("predicate")


def _atom(
    element: str, owner: str, unique: dict[str, str], columns: list[sa.Column[Any]], text: str
) -> Iterator[Table]:
    """Describe the tables of what applies to objects, interned for ever, and of its arguments."""
    yield Table(
        element,
        "id",
        [
            _column("id"),
            _column(f"{owner}_id"),
            *columns,
            _column(
                "arguments",
                LONG_TEXT,
                "the ids of its objects in order, by spaces: the key that interns it",
            ),
            _text(text),
        ],
        [Reference(f"{owner}_id", owner, "id")],
        uniques=unique,
        indexes=[Lookup("text")],
    )
    yield Table(
        f"{element}_argument",
        f"{element}_id position",
        [_column(f"{element}_id"), _position(), _column("object_id")],
        [Reference(f"{element}_id", element, "id"), Reference("object_id", "object", "id")],
        indexes=[Index("object", f"object_id {element}_id")],
    )


def _propositions() -> Iterator[Table]:
    """Describe the tables of facts and of goals that are ground atoms."""
    yield from _atom(
        "proposition",
        "predicate",
        {"atom": "is_goal predicate_id arguments"},
        [_column("is_goal", FLAG)],
        "canonical PDDL",
    )
    yield _version(
        "proposition",
        [_column("predicate_id"), _column("is_goal", FLAG, default=sa.false()), _fork()],
        [Reference("predicate_id", "predicate", "id")],
        indexes=[
            # `until` makes the index cover reads of the present state.
            Index("now", "predicate_id proposition_id until", LIVE),
            Index("history", "predicate_id fork since until proposition_id"),
            # Goals are few among many facts, and current goals are few among past ones.
            Index("goal", "until since proposition_id", GOAL),
            Index("goal_history", "fork since until proposition_id", GOAL),
        ],
        has_parts=False,
    )


def _functions() -> Iterator[Table]:
    """Describe the tables of functions."""
    yield _identity("function", lookup=True)
    yield _version("function", [_text()])
    yield from _parameters("function")
    yield _part(
        "function",
        "type",
        "position",
        [_position(), _column("type_id")],
        [Reference("function_id since", "function_version"), Reference("type_id", "type", "id")],
        [Index("type", "type_id")],
    )


def _function_values() -> Iterator[Table]:
    """Describe the tables of fluents, and of their values."""
    yield from _atom(
        "function_value",
        "function",
        {"fluent": "function_id arguments"},
        [],
        "canonical PDDL, without the value",
    )
    yield _version(
        "function_value",
        [
            _column("function_id"),
            _optional("value", LONG_TEXT, "the number, as exact decimal text"),
            _optional("number", sa.Double(), "the number, as near as a double comes"),
            _optional("object_id", comment="the object that it is"),
            _text("canonical PDDL, with the value"),
            _fork(),
        ],
        [Reference("function_id", "function", "id"), Reference("object_id", "object", "id")],
        {
            "value_or_object": "(value IS NULL) <> (object_id IS NULL)",
            "number_of_value": "(value IS NULL) = (number IS NULL)",
        },
        [
            Index("now", "function_id function_value_id until", LIVE),
            Index("history", "function_id fork since until function_value_id"),
            # Numbers change often and do not belong in it.
            Index("object", "object_id", "object_id IS NOT NULL"),
        ],
        has_parts=False,
    )


def _actions() -> Iterator[Table]:
    """Describe the tables of actions, processes and events."""
    yield _identity("action")
    yield _version(
        "action",
        [
            _text(),
            _column(
                "kind", sa.String(16), "action, durative-action, process or event", default="action"
            ),
        ],
    )
    yield from _parameters("action")
    yield from _trees(
        "action", {"section": "section IN ('duration', 'condition', 'effect')"}, has_parameters=True
    )


def _formulas() -> Iterator[Table]:
    """Describe the tables of formulas on their own: derived predicates, goals, the metric ..."""
    yield _identity("formula")
    yield _version(
        "formula",
        [
            _column(
                "section", sa.String(24), "the part of the domain or the problem that it stands in"
            ),
            _text(),
        ],
        checks={
            "section": "section IN ('derived', 'domain constraint', 'initial', 'timed', 'goal', "
            "'constraint', 'metric')"
        },
    )
    yield from _trees("formula", {}, has_parameters=False)


def _trees(element: str, checks: dict[str, str], has_parameters: bool) -> Iterator[Table]:
    """Describe the tables of an element's expression trees, in preorder."""
    yield _nodes(element, checks)
    node, variable = _node(element), f"{_node(element)} variable"
    yield _part(
        element,
        "variable",
        "section position variable",
        [
            *_node_columns(),
            _column("variable", POSITION, "from 0"),
            _column("name", SHORT_TEXT, "without its question mark"),
        ],
        [Reference(node, f"{element}_node", name="node")],
    )
    yield _part(
        element,
        "variable_type",
        "section position variable alternative",
        [*_node_columns(), _column("variable", POSITION), _alternative(), _column("type_id")],
        [
            Reference(variable, f"{element}_variable", name="variable"),
            Reference("type_id", "type", "id"),
        ],
        [Index("type", "type_id")],
    )
    yield _terms(element, has_parameters)


def _node(element: str) -> str:
    return f"{element}_id since section position"


def _node_columns() -> list[sa.Column[Any]]:
    return [_section(), _position("from 0, in preorder")]


def _nodes(element: str, checks: dict[str, str]) -> Table:
    """Describe the table of the nodes of an element's expression trees."""
    return _part(
        element,
        "node",
        "section position",
        [
            *_node_columns(),
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
        ],
        [
            Reference(f"{element}_id since", f"{element}_version", name="version"),
            Reference(
                f"{element}_id since section parent", f"{element}_node", _node(element), "parent"
            ),
            Reference("predicate_id", "predicate", "id"),
            Reference("function_id", "function", "id"),
        ],
        [Index("predicate", "predicate_id"), Index("function", "function_id")],
        {
            "preorder": "parent < position",
            "one_root": "(parent IS NULL) = (position = 0)",
            "predicate_given": "(operator = 'predicate') = (predicate_id IS NOT NULL)",
            "function_given": "(operator = 'function') = (function_id IS NOT NULL)",
            **checks,
        },
    )


ONE_OF_FOUR = (
    "CASE WHEN parameter IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN object_id IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN variable IS NULL THEN 0 ELSE 1 END"
    " + CASE WHEN child IS NULL THEN 0 ELSE 1 END = 1"
)


def _terms(element: str, has_parameters: bool) -> Table:
    """Describe the table of the terms of the nodes: parameters, variables, objects, fluents."""
    node, version = _node(element), f"{element}_id since"
    parameter = Reference(
        f"{version} parameter", f"{element}_parameter", f"{version} position", "parameter"
    )
    variable = Reference(
        f"{version} section quantifier variable",
        f"{element}_variable",
        f"{node} variable",
        "variable",
    )
    return _part(
        element,
        "term",
        "section position term",
        [
            *_node_columns(),
            _column("term", POSITION, "from 0"),
            _optional("parameter", POSITION, "the position of the owner's parameter"),
            _optional("object_id", comment="the constant"),
            _optional("quantifier", POSITION, "the position of the node that binds the variable"),
            _optional("variable", POSITION, "which of the quantifier's variables it is"),
            _optional("child", POSITION, "the position of the function node whose value it is"),
        ],
        [
            Reference(node, f"{element}_node", name="node"),
            *([parameter] if has_parameters else []),
            Reference("object_id", "object", "id"),
            variable,
            Reference(f"{version} section child", f"{element}_node", node, "child"),
        ],
        [Index("object", "object_id")],
        {
            "one_of_four": ONE_OF_FOUR,
            "bound": "(quantifier IS NULL) = (variable IS NULL)",
            **({} if has_parameters else {"no_parameter": "parameter IS NULL"}),
        },
    )


def _documents() -> Iterator[Table]:
    """Describe the tables of the domain and the problem as documents."""
    yield _identity("document", {"domain_or_problem": "key IN ('domain', 'problem')"})
    yield _version(
        "document",
        [
            _column("title", SHORT_TEXT, "the name in its define form"),
            _optional("domain", SHORT_TEXT, "a problem's domain"),
            _text("all of it on one line"),
        ],
    )
    yield _part(
        "document",
        "item",
        "section position",
        [
            _column("section", sa.String(24), "requirement, type, goal ..."),
            _position(),
            _column(
                "name", LONG_TEXT, "the element's name; for a goal that is a ground atom, its text"
            ),
        ],
        [Reference("document_id since", "document_version")],
    )


STEP = Reference("plan_id position", "plan_step")


def _plans() -> Iterator[Table]:
    """Describe the tables of plans, and of what became of their steps."""
    given = "what the planner was given, if it is not what the store writes"
    yield _record(
        "plan",
        [
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
            _optional("domain_pddl", LONG_TEXT, given),
            _optional("problem_pddl", LONG_TEXT, given),
        ],
        "problem",
    )
    yield Table(
        "plan_step",
        "plan_id position",
        [
            _column("plan_id"),
            _position(),
            _optional(
                "start", LONG_TEXT, "seconds from the plan's beginning, as exact decimal text"
            ),
            _optional("duration", LONG_TEXT, "seconds, as exact decimal text; NULL: an instant"),
            _column("action_id"),
            _text("canonical PDDL, without times"),
        ],
        [Reference("plan_id", "plan", "id"), Reference("action_id", "action", "id")],
        indexes=[Index("action", "action_id")],
    )
    yield Table(
        "plan_step_argument",
        "plan_id position argument",
        [
            _column("plan_id"),
            _position(None),
            _column("argument", POSITION, "from 0"),
            _column("object_id"),
        ],
        [STEP, Reference("object_id", "object", "id")],
        indexes=[Index("object", "object_id")],
    )
    yield from _outcomes()


def _outcomes() -> Iterator[Table]:
    """Describe the tables of what became of the steps, and of what was changed during each."""
    yield Table(
        "plan_step_version",
        "plan_id position since",
        [
            _column("plan_id"),
            _position(None),
            _since(),
            _until(),
            _column("status", sa.String(16), "started, succeeded, failed or aborted"),
            _text("which step of which plan, and its status"),
        ],
        [STEP, AT_SINCE, AT_UNTIL],
        {
            "since_before_until": "since < until",
            "status": "status IN ('started', 'succeeded', 'failed', 'aborted')",
        },
        indexes=[
            Index("since", "since"),
            Index("until", "until", CLOSED),
            Index("live", "plan_id position", LIVE, unique=True),
        ],
    )
    yield Table(
        "revision_plan_step",
        "number",
        [_column("number", comment="the revision"), _column("plan_id"), _position("the step's")],
        [Reference("number", "revision"), STEP],
        indexes=[Index("step", "plan_id position number")],
    )


def _archives() -> Iterator[Table]:
    """Describe the table of what was moved elsewhere."""
    yield _record(
        "archive",
        [
            _column("revision", comment="the versions that ended up to this revision were moved"),
            _column("target", LONG_TEXT, "where to: a URL without its password"),
            _column("versions", comment="how many were moved"),
            _column(
                "rest", LONG_TEXT, "SHA-256 of what this store keeps of the revisions up to there"
            ),
        ],
        "upto",
    )


def _record(name: str, columns: list[sa.Column[Any]], reference: str) -> Table:
    """Describe a table of what is recorded once, about an earlier revision."""
    return Table(
        name,
        "id",
        [
            _column("id"),
            _column("since", comment="recorded in this revision"),
            *columns,
            _text("all of it in canonical form"),
        ],
        [TO_KNOWLEDGE_BASE, AT_SINCE, Reference("revision", "revision", "number", reference)],
        indexes=[Index("since", "since"), Index("revision", "revision")],
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
AUDIT_FACT_ARGUMENT = f"""
SELECT
    k.name AS knowledge_base,
    CASE WHEN v.is_goal THEN WORD(goal) ELSE WORD(fact) END AS kind,
    v.proposition_id,
    d.name AS predicate,
    p.text,
    a.position,
    (
        SELECT m.name
        FROM predicate_version AS w
        JOIN predicate_parameter AS m ON m.kb_id = w.kb_id
            AND m.predicate_id = w.predicate_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.predicate_id = v.predicate_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,{INTERVAL}
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
    (
        SELECT m.name
        FROM function_version AS w
        JOIN function_parameter AS m ON m.kb_id = w.kb_id
            AND m.function_id = w.function_id AND m.since = w.since
        WHERE w.kb_id = v.kb_id AND w.function_id = v.function_id AND w.since <= v.since
            AND (w.until IS NULL OR w.until > v.since) AND m.position = a.position
    ) AS parameter,
    o.name AS object,
    a.object_id,{INTERVAL}
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
