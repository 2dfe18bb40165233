"""The lexer: tokens, places, encodings, and texts that are hostile."""

from __future__ import annotations

import errno
import os
import pickle
import random
import tracemalloc
from pathlib import Path
from typing import Any

import pytest

from kant_sql import errors
from kant_sql.pddl.lexer import MAX_UNMATCHED, Blocks, Text, load, tokenize, unmatched


def places(text: str) -> list[tuple[str, int, int]]:
    """Each token with its line and column, as the lexer finds them."""
    lexed = Text("t", whole=text)
    tokens = tokenize(lexed.code)
    found = lexed.locate(lexed.offsets(0, indexes=range(len(tokens))))
    return [(token, *place) for token, place in zip(tokens, found, strict=True)]


def test_tokens_and_places() -> None:
    assert places("(a ;x\n ?b)") == [("(", 1, 1), ("a", 1, 2), ("?b", 2, 2), (")", 2, 4)]


def test_a_comment_ends_a_word() -> None:
    assert places("a;b\nc") == [("a", 1, 1), ("c", 2, 1)]


def test_places_are_those_of_a_naive_lexer() -> None:
    rng = random.Random(7)
    for _ in range(300):
        text = "".join(rng.choice("ab( )\n\t;é?") for _ in range(rng.randrange(60)))
        expected: list[tuple[str, int, int]] = []
        for number, line in enumerate(text.split("\n"), 1):
            word = ""
            code = line.split(";")[0]
            for column, character in enumerate([*code, " "], 1):
                if character in "() \t":
                    if word:
                        expected.append((word, number, column - len(word)))
                        word = ""
                    if character in "()":
                        expected.append((character, number, column))
                else:
                    word += character
        assert places(text) == expected, text


def test_the_end_has_a_place() -> None:
    text = Text("t", whole="(a\n b")
    assert text.locate(text.offsets(0, indexes=[9])) == [(2, 3)]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_line_ends(end: str) -> None:
    assert places(f"(a{end};c{end}b)")[2] == ("b", 3, 1)


def test_a_byte_order_mark_and_odd_white_space() -> None:
    assert [one[0] for one in places("\ufeff(a\u00a0b\fc\vd\te)")] == list("(abcde)")


def test_a_comment_in_another_encoding_is_remembered(tmp_path: Path) -> None:
    path = tmp_path / "latin.pddl"
    path.write_bytes(b"(a)\n; caf\xe9\n(b)")
    text = load(path)
    assert tokenize(text.code) == ["(", "a", ")", "(", "b", ")"]
    assert text.undecodable == (2, 6)
    assert text.name == str(path)


def test_code_in_another_encoding_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "latin.pddl"
    path.write_bytes(b"; \xe9\n(caf\xe9)")
    with pytest.raises(errors.PddlError) as refused:
        load(path)
    assert str(refused.value) == f"{path}:2:5: found the byte 0xE9, expected PDDL text in UTF-8"


@pytest.mark.parametrize("text", ["(a \0)", "; \0\n(a)"])
def test_nul_is_refused(text: str) -> None:
    with pytest.raises(errors.PddlError, match="found a NUL character"):
        load(text)


TEXTS = ["(a)", "", "  ", "a\nb", "a\rb", " \t(a", "\ufeff(a)", "; (a)", "x (define (domain d))"]


@pytest.mark.parametrize("text", [*TEXTS, "( DEFINE"])
def test_what_is_text(text: str) -> None:
    assert load(text).name == "<string>"


@pytest.mark.parametrize("name", ["a", "run (1)/domain.pddl", "a(b", "a;b", " a (2).pddl"])
def test_what_is_a_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text("(b)")
    named: list[str | os.PathLike[str]] = [path, str(path), name]
    assert [load(one).code for one in named] == ["(b)"] * 3


def test_a_path_object_is_never_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("(define").write_text("(b)")
    assert load(Path("(define")).code == "(b)"


@pytest.mark.parametrize(
    "source", ["nowhere.pddl", "no (1)/where.pddl", Path("(define"), Path("a\0b"), "\ud800"]
)
def test_a_file_that_is_not_there(source: str | Path) -> None:
    with pytest.raises(
        errors.SourceMissingError, match="give the path of a readable file"
    ) as missing:
        load(source)
    error = missing.value
    assert isinstance(error, FileNotFoundError)
    assert isinstance(error, errors.KantSqlError)
    assert (error.errno, error.filename) == (errno.ENOENT, str(source))
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again)) == (errors.SourceMissingError, str(error))


@pytest.mark.parametrize("source", [Path("."), "x" * 5000])
def test_a_file_that_cannot_be_read(source: str | Path) -> None:
    with pytest.raises(errors.SourceError) as refused:
        load(source)
    assert not isinstance(refused.value, FileNotFoundError)
    assert len(str(refused.value)) < 2_000


@pytest.mark.parametrize("size", [3, 100_000])
def test_blocks_are_the_tokens_of_a_list(size: int) -> None:
    elements = [f"(= (f a{number}) {number})(p (q))" for number in range(size)]
    code = f"  (:init {' '.join(elements)}) ) rest"
    end = code.index("rest")
    blocks = Blocks(code, 2, end)
    found: list[str] = []
    count = 0
    while block := blocks.next():
        depth = found.count("(") - found.count(")") if count < 20 else 1
        assert depth == (1 if found else 0)
        found += block
        count += 1
    assert found == tokenize(code[2:end])
    assert (count > 5) == (size > 1000)


def test_the_rest_behind_some_blocks() -> None:
    code = "(:init " + "(p)" * 50_000 + ")"
    blocks = Blocks(code, 0, len(code))
    first = blocks.next()
    assert first + blocks.rest() == tokenize(code)
    assert blocks.next() == []


def test_parentheses_without_counterpart() -> None:
    assert unmatched("(" * 100_000 + ")" * 100_000) is None
    for parenthesis in "()":
        assert unmatched("()" * 500 + parenthesis * MAX_UNMATCHED) is None
    assert unmatched("()" * 500 + "(" * (MAX_UNMATCHED + 1)) == (1151, MAX_UNMATCHED + 1)
    assert unmatched("()" * 100_000 + "(" * 300 + " ") == (200_300, 300)
    assert unmatched("()" * 100_000 + ")" * 300) == (200_000, 0)


def test_lexing_takes_memory_in_proportion() -> None:
    code = "(:init " + "(near place1 place2)\n" * 50_000 + ")"
    blocks = Blocks(code, 0, len(code))
    tracemalloc.start()
    while blocks.next():
        continue
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < len(code)


@pytest.mark.parametrize("source", [5, None, b"(a)", ["(a)"]])
def test_what_is_no_source_is_refused(source: Any) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="a source is a path, or a string"):
        load(source)
