"""Which strings are names, and which names are the same."""

from __future__ import annotations

import re
import sys
import unicodedata
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kant_sql import InvalidKnowledgeError
from kant_sql.dto.lexical import check_name, fold, is_requirement, is_word
from kant_sql.errors import InvalidNameError

UNSEEN = re.compile("HANGUL .*FILLER|VARIATION SELECTOR|GRAPHEME JOINER|INHERENT|SCRIPT FILLER")


def all_characters() -> Iterator[str]:
    return map(chr, range(sys.maxunicode + 1))


def characters() -> Iterator[str]:
    """Those that are neither unassigned, private nor half a character."""
    return (sign for sign in all_characters() if unicodedata.category(sign)[0] != "C")


def is_unseen(sign: str) -> bool:
    """Whether a letter or a mark leaves no ink, by its name."""
    return UNSEEN.search(unicodedata.name(sign, "")) is not None


def is_name(text: str) -> bool:
    try:
        check_name("action", text)
    except InvalidNameError:
        return False
    return True


@pytest.mark.parametrize(
    "name",
    [
        *("a", "robot_at", "Robot-1", "7up", "a:b", "a-", "1-2", "3rd", "1.2.3", "#1", "_", "%"),
        *("\\", "$$", "#", "@home", "a.b", "a/b", "[x]", "{x}", "a,b", "a=b", "<", "!", "*", "&"),
        *(
            *("|", "~", "^", "+", "Küche", "Ku\u0308che", "straße", "ẞ", "жук", "机器人", "🤖"),
            "ロボット",
        ),
        *("x" * 255, "😀" * 255),
    ],
)
def test_text_that_pddl_can_carry_is_a_name(name: str) -> None:
    check_name("type", name)


@pytest.mark.parametrize(
    "name",
    [
        *("", "two words", " a", "a ", "tab\t", "line\n", "a\rb", "a\u00a0b", "a\u2003b"),
        *("a\u2028b", "a\u3000b", "(", "a)", "a;b", "?r", "a?", "it's", 'say "x"', "`x`", "a\0b"),
        *("a\x07b", "a\x7fb", "a\x85b", "a\u200bb", "a\u00adb", "\ufeffa", "\ud800", "a\udfff"),
        *("\ue000", "\U0010ffff", "-", ":a", ":", "x" * 256, "😀" * 256),
    ],
)
def test_text_that_pddl_could_not_carry_is_refused(name: str) -> None:
    with pytest.raises(InvalidNameError, match=r"cannot name a type: .*; choose another name"):
        check_name("type", name)


@pytest.mark.parametrize("name", [None, 5, 2.5, b"robot", ["robot"], True, object()])
def test_what_is_no_string_is_refused(name: object) -> None:
    with pytest.raises(InvalidNameError, match="a name of type is a string, not"):
        check_name("type", name)  # type: ignore[arg-type]
    with pytest.raises(InvalidNameError, match="a name is a string, not"):
        fold(name)  # type: ignore[arg-type]


OPERATORS = ["and", "OR", "Not", "imply", "forall", "exists", "when", "=", "<", ">=", "<=", ">"]


@pytest.mark.parametrize("word", OPERATORS)
@pytest.mark.parametrize("kind", ["predicate", "function"])
def test_a_predicate_or_function_may_not_have_the_name_of_an_operator(kind: str, word: str) -> None:
    with pytest.raises(InvalidNameError, match="reserved in PDDL"):
        check_name(kind, word)
    check_name("object", word)
    check_name("action", word)


@pytest.mark.parametrize("word", ["+", "*", "/", "Is-Violated"])
def test_a_function_may_not_have_the_name_of_an_operation(word: str) -> None:
    with pytest.raises(InvalidNameError, match="reserved in PDDL"):
        check_name("function", word)
    check_name("predicate", word)


def test_a_type_may_not_be_called_either() -> None:
    with pytest.raises(InvalidNameError, match="reserved in PDDL"):
        check_name("type", "Either")
    check_name("object", "either")


@pytest.mark.parametrize("kind", ["type", "object", "constant"])
@pytest.mark.parametrize(
    ("name", "why"),
    [
        *(("-a", "begins with '-'"), ("--", "begins with '-'"), ("-1", "begins with '-'")),
        *(("1", "as a number"), ("+1.5", "as a number"), (".5", "as a number")),
        *(("1e9", "as a number"), ("#T", "as a number")),
    ],
)
def test_what_stands_alone_is_neither_a_dash_nor_a_number(kind: str, name: str, why: str) -> None:
    with pytest.raises(InvalidNameError, match=why):
        check_name(kind, name)
    for other in ("predicate", "function", "action", "parameter", "preference", "problem"):
        check_name(other, name)


INVISIBLE = "\u034f\u115f\u1160\u17b4\u180b\u180f\u2800\u3164\ufe0f\uffa0\U0001d159\U000e0100"


@pytest.mark.parametrize("sign", INVISIBLE, ids=lambda sign: f"U+{ord(sign):04X}")
def test_what_cannot_be_seen_is_in_no_name(sign: str) -> None:
    for name in (sign, f"{sign}a", f"a{sign}", f"a{sign}b"):
        with pytest.raises(InvalidNameError, match="which cannot be seen, at position"):
            check_name("object", name)
        # Older versions stored them, and whoever looks one up finds it.
        assert is_word(name)


@pytest.mark.parametrize("mark", ["\u0301", "\u0903", "\u20dd"])
def test_a_name_does_not_begin_with_what_joins_the_character_before_it(mark: str) -> None:
    with pytest.raises(InvalidNameError, match="which joins the character before it"):
        check_name("object", f"{mark}a")
    check_name("object", f"a{mark}")


def test_a_requirement_is_a_colon_and_a_name() -> None:
    assert all(map(is_requirement, (":strips", ":a_b", ":1", ":-x")))
    wrong = ":", "strips", ":?x", "::x", ":a b", ":a;b", ":(", ":-", ":\u3164", "", ":" + "x" * 256
    assert not any(map(is_requirement, wrong))


def test_the_message_says_which_character_is_wrong_and_where() -> None:
    with pytest.raises(InvalidNameError) as caught:
        check_name("object", "cup;1")
    assert "'cup;1' cannot name an object: it has ';' (SEMICOLON) at position 3" in str(
        caught.value
    )


def test_the_message_does_not_repeat_a_name_of_any_length() -> None:
    with pytest.raises(InvalidNameError, match="it has 1000000 characters, 255 at most") as caught:
        check_name("object", "x" * 1_000_000)
    assert len(str(caught.value)) < 300


def test_a_bad_name_is_bad_knowledge_and_a_value_error() -> None:
    assert issubclass(InvalidNameError, InvalidKnowledgeError)
    assert issubclass(InvalidNameError, ValueError)


@pytest.mark.more
def test_no_white_space_separator_or_control_character_can_be_in_a_name() -> None:
    for character in all_characters():
        must_not = (
            character.isspace()
            or character in "();?\"'`"
            or unicodedata.category(character) in ("Cc", "Cf", "Cs", "Zs", "Zl", "Zp")
        )
        assert not (must_not and is_name(f"a{character}b")), hex(ord(character))


@pytest.mark.more
def test_letters_digits_and_marks_of_every_script_can_be_in_a_name() -> None:
    for character in characters():
        if unicodedata.category(character)[0] in "LNM":
            assert is_name(f"a{character}b") or is_unseen(character), hex(ord(character))


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *(("robot", "ROBOT"), ("robot_AT", "Robot_at"), ("straße", "STRASSE"), ("ẞ", "ß")),
        *(("ẞ", "ss"), ("\u00e9", "e\u0301"), ("\u00c9", "e\u0301"), ("Å", "\u212b")),
        *(("K", "\u212a"), ("ΣΑΣ", "σας"), ("ﬁn", "FIN"), ("\u0390", "\u03b9\u0308\u0301")),
    ],
)
def test_names_that_differ_in_case_or_composition_are_the_same(one: str, other: str) -> None:
    assert fold(one) == fold(other)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        *(("a-b", "a_b"), ("e", "é"), ("\u0131", "i"), ("o", "0"), ("\u0430", "a"), ("x²", "x2")),
        ("\uff0d", "-"),
    ],
)
def test_names_that_only_look_alike_are_different(one: str, other: str) -> None:
    assert fold(one) != fold(other)


@given(st.text())
def test_normal_forms_and_foldings_of_a_name_are_the_same_name(name: str) -> None:
    decomposed = unicodedata.normalize("NFD", name)
    assert fold(decomposed) == fold(unicodedata.normalize("NFC", name))
    assert fold(decomposed.casefold()) == fold(fold(name)) == fold(name)


@pytest.mark.parametrize("mark", ["\u0301", "\u0313", "\u0321"])
def test_the_order_of_marks_that_do_not_touch_does_not_matter(mark: str) -> None:
    assert fold(f"\u0391\u0345{mark}") == fold(f"\u0391{mark}\u0345")
    assert fold(fold(f"\u0391\u0345{mark}")) == fold(f"\u0391{mark}\u0345")


@given(st.text(st.characters(codec="ascii")))
def test_ascii_names_fold_as_all_others_do(name: str) -> None:
    assert fold(name) == unicodedata.normalize("NFC", name.casefold())


@pytest.mark.more
def test_what_a_name_folds_to_can_be_stored_whatever_the_character() -> None:
    for character in characters():
        if is_name(character):
            assert fold(character).isprintable(), hex(ord(character))
