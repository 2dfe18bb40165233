"""Names in the store: one spelling for ever, and nothing in them means anything to SQL."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from kant_sql import (
    KnowledgeBase,
    PddlActionDto,
    PddlConditionEffectDto,
    PddlError,
    PddlFunctionDto,
    PddlObjectDto,
    PddlPredicateDto,
    PddlPropositionDto,
    PddlTypeDto,
    UnknownNameError,
)
from kant_sql.errors import InvalidNameError
from tests.support.reading import facts, nothing_changes, present, refuses, state, undone
from tests.support.worlds.depot import again
from tests.support.worlds.robots import RB1, ROBOT, WAYPOINT, robot_at

STRANGE = [
    # What means something to SQL, to COPY, or to who formats text.
    *("%", "_", "100%_--", "\\", "\\N", "\\.", "\\x41", "$$", "$1", "%s", "{0}", "a,b", "{a,b}"),
    *("NULL", "*", "DROP", "/*", "<b>", "a=b", "1-2", "0x10", "1.2.3", "true", "[red]"),
    *("Küche", "Straße", "ЖУК", "机器人", "ロボット", "🤖", "👩🏽", "a\u0301\u0323", "\U0001d54f"),
    *("x" * 255, "😀" * 255, "ﬃ" * 255, "\u0390" * 255),
]


def fact(name: str) -> PddlPropositionDto:
    """A fact all of whose parts have one name."""
    type_ = PddlTypeDto(name)
    return PddlPropositionDto(PddlPredicateDto(name, [type_]), [PddlObjectDto(type_, name)])


def action(name: str) -> PddlActionDto:
    """An action all of whose parts have one name."""
    type_ = PddlTypeDto(name)
    parameter = PddlObjectDto(type_, name)
    literal = PddlConditionEffectDto(PddlPredicateDto(name, [type_]), [parameter])
    return PddlActionDto(name, [parameter], [literal], durative=False)


def test_whatever_a_name_is_made_of_it_is_data(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save_all([fact(name) for name in STRANGE])
    fresh_kb.actions.save_all([action(name) for name in STRANGE])
    for kb in (fresh_kb, fresh_kb.at(fresh_kb.revision)):
        assert [dto.name for dto in kb.types.get_all()] == STRANGE
        assert [dto.name for dto in kb.objects.get_all()] == STRANGE
        assert [dto.name for dto in kb.predicates.get_all()] == STRANGE
        assert [str(dto) for dto in kb.actions.get_all()] == [str(action(n)) for n in STRANGE]
        assert [str(dto) for dto in kb.propositions.get_all()] == [f"({n} {n})" for n in STRANGE]
    for name in STRANGE:
        assert [str(dto) for dto in fresh_kb.propositions.get_by_predicate(name)] == [
            f"({name} {name})"
        ]
        assert str(fresh_kb.types.get(name)) == name


def test_strange_names_are_found_again_one_by_one_and_deleted(fresh_kb: KnowledgeBase) -> None:
    with fresh_kb.transaction():
        for name in STRANGE:
            assert fresh_kb.propositions.insert(fact(name)) is True
    with fresh_kb.transaction():
        for name in STRANGE:
            assert fresh_kb.propositions.insert(fact(name)) is False
            assert fresh_kb.propositions.delete(fact(name)) is True
            assert fresh_kb.types.delete(PddlTypeDto(name)) is True
    assert state(fresh_kb)["types"] == state(fresh_kb)["predicates"] == facts(fresh_kb) == []
    # The names are in the database alone now.
    assert fresh_kb.propositions.save_all([fact(name) for name in STRANGE]) == len(STRANGE)
    assert facts(fresh_kb) == sorted(f"({name} {name})" for name in STRANGE)


def ways_to_save(kb: KnowledgeBase, name: str) -> list[Callable[[], object]]:
    """Calls that would each store a new element of a name, or something that refers to one."""
    type_ = PddlTypeDto(name)
    parameter = PddlObjectDto(ROBOT, name)
    predicate = PddlPredicateDto(name)
    literal = PddlConditionEffectDto(predicate, [], PddlConditionEffectDto.AT_END)
    typed = PddlObjectDto(type_, "x")
    return [
        lambda: kb.types.save(type_),
        lambda: kb.types.insert(type_),
        lambda: kb.types.save_all([WAYPOINT, type_]),
        lambda: kb.types.save(PddlTypeDto("car", parent=type_)),
        lambda: kb.objects.save(parameter),
        lambda: kb.objects.save_all([RB1, parameter]),
        lambda: kb.objects.save(typed),
        lambda: kb.predicates.save(predicate),
        lambda: kb.predicates.save_all([predicate]),
        lambda: kb.predicates.save(PddlPredicateDto("p", [type_])),
        lambda: kb.propositions.save(PddlPropositionDto(predicate)),
        lambda: kb.propositions.save(robot_at(parameter)),
        lambda: kb.propositions.save_all([robot_at(), robot_at(parameter)]),
        lambda: kb.propositions.save(robot_at(RB1, PddlObjectDto(type_, "wp1"))),
        lambda: kb.actions.save(PddlActionDto(name)),
        lambda: kb.actions.save_all([PddlActionDto("a"), PddlActionDto(name)]),
        lambda: kb.actions.save(PddlActionDto("a", [parameter])),
        lambda: kb.actions.save(PddlActionDto("a", [typed])),
        lambda: kb.actions.save(PddlActionDto("a", [], [literal])),
    ]


def test_a_name_pddl_cannot_carry_is_refused_wherever_it_stands(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(ROBOT)
    wrong = ("", "a b", "(", "?x", "a;b", "it's", "a\0b", "\ud800", "a\u200b", "-", ":a")
    for name in (*wrong, "x" * 256, "😀" * 256):
        for call in ways_to_save(fresh_kb, name):
            caught = refuses(fresh_kb, InvalidNameError, call)
            assert "cannot name a" in str(caught)


def test_asking_for_a_name_that_cannot_be_finds_nothing(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(robot_at())
    for name in ("", "a b", "x" * 10_000, "a\0b", "\ud800", "?", "robot_at "):
        assert fresh_kb.types.get(name) is None
        assert fresh_kb.objects.get(name) is None
        assert fresh_kb.predicates.get(name) is None
        assert fresh_kb.actions.get(name) is None
        for kb in (fresh_kb, fresh_kb.at(1)):
            with pytest.raises(UnknownNameError):
                kb.propositions.get_by_predicate(name)
        with nothing_changes(fresh_kb):
            assert fresh_kb.types.delete(PddlTypeDto(name)) is False
            assert fresh_kb.objects.delete(PddlObjectDto(ROBOT, name)) is False
            assert fresh_kb.propositions.delete(robot_at(PddlObjectDto(ROBOT, name))) is False


SPELLINGS = [
    *(("Robot", "rOBOT"), ("Straße", "STRASSE"), ("ẞ", "ss"), ("K\u00fcche", "KU\u0308CHE")),
    *(("ЖУК", "жук"), ("\u212b", "\u00e5")),
]


@pytest.mark.parametrize(("first", "second"), SPELLINGS)
def test_names_ignore_case_and_composition_and_keep_the_first_spelling(
    fresh_kb: KnowledgeBase, first: str, second: str
) -> None:
    fresh_kb.propositions.save(fact(first))
    fresh_kb.actions.save(action(first))
    texts = {**state(fresh_kb)}
    with nothing_changes(fresh_kb):
        assert fresh_kb.propositions.insert(fact(second)) is False
        assert fresh_kb.types.insert(PddlTypeDto(second)) is False
        assert fresh_kb.types.save(PddlTypeDto(second)) is True
        assert fresh_kb.objects.save_all([PddlObjectDto(PddlTypeDto(second), second)]) == 0
        assert fresh_kb.predicates.update(fact(second).predicate) is True
        assert fresh_kb.actions.insert(action(second)) is False
    assert texts["facts"] == [f"({first} {first})"]
    assert present(fresh_kb.types.get(second)).name == first
    assert fresh_kb.propositions.get_by_predicate(second) == [fact(first)]
    assert fresh_kb.types.delete(PddlTypeDto(second)) is True
    assert state(fresh_kb)["types"] == state(fresh_kb)["actions"] == facts(fresh_kb) == []


@pytest.mark.parametrize(("first", "second"), SPELLINGS)
def test_the_first_spelling_stays_after_delete_and_re_create(
    fresh_kb: KnowledgeBase, first: str, second: str
) -> None:
    fresh_kb.propositions.save(fact(first))
    fresh_kb.types.delete(PddlTypeDto(first))
    fresh_kb.propositions.save(fact(second))
    fresh_kb.actions.save(action(second))
    after = state(fresh_kb)
    assert after["types"] == [first]
    assert after["objects"] == [f"{first} - {first}"]
    assert after["facts"] == [f"({first} {first})"]
    fresh_kb.actions.delete(action(second))
    fresh_kb.actions.save(action(first))
    assert present(fresh_kb.actions.get(first)).name == second


def test_a_name_that_was_rolled_back_leaves_no_spelling(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.types.save(WAYPOINT)
    with undone(fresh_kb):
        fresh_kb.types.save(PddlTypeDto("ROBOT"))
        assert state(fresh_kb)["types"] == ["wp", "ROBOT"]
    fresh_kb.types.save(PddlTypeDto("robot"))
    assert state(fresh_kb)["types"] == ["wp", "robot"]


def test_elements_of_different_kinds_may_share_a_name(fresh_kb: KnowledgeBase) -> None:
    fresh_kb.propositions.save(fact("thing"))
    fresh_kb.actions.save(action("THING"))
    fresh_kb.actions.delete(PddlActionDto("thing"))
    assert facts(fresh_kb) == ["(thing thing)"]


def test_names_that_an_older_version_stored_stay_readable(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ["-b", "5", "\u3164", "\u0301a"]
    with monkeypatch.context() as older:
        for module in ("base", "signatures", "type"):
            older.setattr(f"kant_sql.dao.{module}.check_name", lambda *_: None)
        for name in names:
            fresh_kb.propositions.save(fact(name))
        fresh_kb.propositions.save(fact(">="))
        fresh_kb.function_values.set(PddlFunctionDto("not"), objects=[], value=3)
    kb = again(fresh_kb)
    for seen in (kb, kb.at(kb.revision)):
        assert [dto.name for dto in seen.objects.get_all()] == [*names, ">="]
        assert [str(each) for each in seen.propositions.get_by_predicate(">=")] == ["(>= >=)"]
        assert seen.function_values.get("not") == 3
        assert [thing.name for thing in seen.pddl.problem().objects] == [*names, ">="]
    for name in names:
        assert kb.history(PddlObjectDto(PddlTypeDto(name), name))
        assert kb.blame(fact(name)) is not None
        assert kb.propositions.insert(fact(name)) is False
    assert kb.store.verify().findings == ()
    with pytest.raises(InvalidNameError, match="cannot name an object"):
        kb.problem_pddl()
    with pytest.raises(InvalidNameError, match="cannot name a"):
        kb.domain_pddl()
    for name in [*names, ">="]:
        assert kb.types.delete(PddlTypeDto(name))
    assert kb.functions.delete(PddlFunctionDto("not"))
    assert "(:objects" not in kb.problem_pddl() + kb.domain_pddl()


def test_a_requirement_that_an_older_version_took_is_no_finding(
    fresh_kb: KnowledgeBase, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "(define (domain d) (:requirements :strips :?x))"
    with pytest.raises(PddlError):
        fresh_kb.load_domain(text)
    with monkeypatch.context() as older:
        older.setattr("kant_sql.pddl.declarations.is_requirement", lambda _: True)
        fresh_kb.load_domain(text)
    assert fresh_kb.store.verify().findings == ()
    assert fresh_kb.pddl.domain().requirements == (":strips", ":?x")
    with pytest.raises(InvalidNameError, match="cannot name a requirement"):
        fresh_kb.domain_pddl()
    fresh_kb.load_domain(text.replace(" :?x", ""))
    assert "(:requirements :strips)" in fresh_kb.domain_pddl()
