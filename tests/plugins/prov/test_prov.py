"""Provenance is read by the reader of the package prov, and says what the store says."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import kant_sql
from kant_sql.errors import InvalidArgumentError
from kant_sql_plugins.prov import export_provenance

model: Any = pytest.importorskip("prov.model")
DOMAIN = """
(define (domain ward) (:predicates (open) (shut) (seen)) (:functions (battery))
  (:action look :precondition (and (open) (not (shut)) (> (battery) 5))
    :effect (and (seen) (not (open)) (decrease (battery) 1))))
"""
PROBLEM = "(define (problem night) (:domain ward) (:init (= (battery) 9)) (:goal (seen)))"


@pytest.fixture
def url(file_url: str) -> str:
    with kant_sql.connect(file_url, knowledge_base="ward", actor="executive") as kb:
        kb.load_domain(DOMAIN)
        kb.load_problem(PROBLEM)
        with kb.transaction(actor="camera", reason="frame 812"):
            kb.propositions.save_all(["(open)"])
        kb.apply("(look)", reason="the nurse called")
    return file_url


def read(folder: Path) -> Any:
    text = (folder / "knowledge_base=ward" / "provenance.json").read_text()
    return model.ProvDocument.deserialize(content=text, format="json")


def said(document: Any, kind: Any, *at: int) -> set[tuple[str, ...]]:
    """The labels of what relations of a kind are between."""
    labels = {
        str(one.identifier): str(one.label) for one in document.get_records(model.ProvElement)
    }
    rows = [
        [str(value) for _, value in one.formal_attributes] for one in document.get_records(kind)
    ]
    return {tuple(labels.get(row[place], row[place]) for place in at) for row in rows}


def test_its_reader_reads_what_was_done_because_of_what(url: str, tmp_path: Path) -> None:
    exported = export_provenance(url, to=tmp_path / "out")
    assert [(file.content, file.rows) for file in exported.files] == [("provenance", 4)]
    document = read(tmp_path / "out")
    look = "(look)"
    assert said(document, model.ProvUsage, 0, 1) == {(look, "(open)"), (look, "(= (battery) 9)")}
    made = said(document, model.ProvGeneration, 1, 0)
    assert {(look, "(seen)"), (look, "(= (battery) 8)"), ("frame 812", "(open)")} <= made
    gone = said(document, model.ProvInvalidation, 1, 0)
    assert gone == {(look, "(open)"), (look, "(= (battery) 9)")}
    agents = said(document, model.ProvAssociation, 0, 1)
    assert {("frame 812", "camera"), (look, "executive")} <= agents
    assert ("(seen)", "(open)") in said(document, model.ProvDerivation, 0, 1)


def test_a_range_names_what_began_before_it(url: str, tmp_path: Path) -> None:
    export_provenance(url, to=tmp_path / "out", knowledge_base="ward", since=4)
    document = read(tmp_path / "out")
    assert ("(look)", "(open)") in said(document, model.ProvUsage, 0, 1)
    assert ("(look)", "(open)") in said(document, model.ProvInvalidation, 1, 0)
    with pytest.raises(InvalidArgumentError, match="is whole"):
        export_provenance(url, to=tmp_path / "other", names=["open"])
    with pytest.raises(InvalidArgumentError, match=r"was known .* mcap and trajectory take it"):
        export_provenance(url, to=tmp_path / "other", clock="valid")
    assert not (tmp_path / "other").exists()


def test_a_range_without_revisions_is_an_empty_document(url: str, tmp_path: Path) -> None:
    windows: list[dict[str, Any]] = [
        {"since": datetime(2100, 1, 1, tzinfo=UTC)},
        {"until": datetime(1990, 1, 1, tzinfo=UTC)},
        {"since": datetime(1990, 1, 1, tzinfo=UTC), "until": datetime(1990, 1, 2, tzinfo=UTC)},
    ]
    for number, given in enumerate(windows):
        folder = tmp_path / str(number)
        exported = export_provenance(url, to=folder, **given)
        assert [file.rows for file in exported.files] == [0]
        assert not [*read(folder).get_records()]
