"""The names of the roles of one knowledge base: safe identifiers, and no two the same."""

from __future__ import annotations

import re

from hypothesis import given
from hypothesis import strategies as st

from kant_sql.sql.dialects.postgresql_roles import RoleScope, safe_part
from kant_sql.sql.dialects.postgresql_structure import Qualifier

NAMES = st.one_of(
    st.text(min_size=1, max_size=255),
    st.from_regex(r"[a-z_0-9]{1,70}", fullmatch=True),
    st.from_regex(r"[a-z]{1,5}_[0-9a-f]{12}", fullmatch=True),
)


@given(NAMES)
def test_all_names_are_plain_and_short_enough_for_the_server(name: str) -> None:
    roles = RoleScope(name, 1).roles(has_writer=True)
    for identifier in (roles.writer, roles.reader, roles.auditor, roles.schema):
        assert identifier is not None
        assert re.fullmatch(r"kant_sql_[a-z0-9_]+", identifier)
        assert len(identifier) <= 63


@given(NAMES, NAMES)
def test_no_two_knowledge_bases_share_roles(one: str, other: str) -> None:
    assert (safe_part(one) == safe_part(other)) == (one == other)


def test_a_plain_name_stays_as_it_is() -> None:
    assert safe_part("tiago") == "tiago"
    assert safe_part("robot_2") == "robot_2"


def test_case_and_what_is_cut_off_make_a_difference() -> None:
    names = [*("Tiago", "tiago", "ti-ago", "ti_ago", "ß", "ss", "'", '"', "_", "1")]
    names += ["x" * 100, "x" * 101]
    names += [safe_part(name) for name in names if safe_part(name) != name]
    assert len({safe_part(name) for name in names}) == len(names)


def test_identifiers_are_quoted() -> None:
    assert Qualifier('a"b').relation("user") == '"a""b"."user"'
    assert Qualifier("50%").relation("head") == '"50%".head'
