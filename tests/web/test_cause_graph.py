"""The graph on the page of a fact: what it goes back to, and what it led to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit
from xml.etree import ElementTree

import pytest

from kant_sql import KnowledgeBase
from kant_sql.web.cause_graph import GAP, WIDTH
from kant_sql.web.pages.elements import CAUSES
from tests.web.conftest import Filled

DOMAIN = """
(define (domain ward) (:requirements :typing :derived-predicates) (:types robot place)
  (:predicates (at ?r - robot ?p - place) (door ?a ?b - place) (way ?a ?b - place)
    (seen ?p - place))
  (:derived (way ?a ?b - place) (door ?a ?b))
  (:action move :parameters (?r - robot ?a ?b - place) :precondition (and (at ?r ?a) (way ?a ?b))
    :effect (and (not (at ?r ?a)) (at ?r ?b)))
  (:action look :parameters (?r - robot ?p - place) :precondition (at ?r ?p) :effect (seen ?p)))
"""
PROBLEM = """
(define (problem night) (:domain ward) (:objects rb1 - robot hall lab - place)
  (:init (at rb1 hall) (door hall lab)) (:goal (seen lab)))
"""


class Graph(NamedTuple):
    """What is drawn: the boxes, each by its lines, and where they lead and what they join.

    Attributes:
        columns: the boxes of each column, from the left, by their first lines.
        lines: the lines of each box, by the first two.
        links: where the lines of boxes lead, by their text.
        joined: which boxes are joined, from what made something to what used it.
    """

    columns: list[list[str]]
    lines: dict[str, list[str]]
    links: dict[str, str]
    joined: set[tuple[str, str]]


def read(page: str) -> Graph:
    """Read the drawing of a page, which is well-formed."""
    start = page.index('<svg class="causes"')
    # The drawing ends behind its boxes, which are elements of the same name.
    end = page.index("</svg></div>", start) + len("</svg>")
    svg = ElementTree.fromstring(page[start:end])
    boxes = {}
    for box in svg.findall("svg"):
        text = ["".join(one.itertext()) for one in box.iter("text")]
        boxes[" ".join(text[:2])] = box, text
    by_column: dict[float, list[str]] = {}
    for name, (box, _) in boxes.items():
        by_column.setdefault(float(box.get("x", "")), []).append(name)
    return Graph(
        [sorted(by_column[x]) for x in sorted(by_column)],
        {name: text for name, (_, text) in boxes.items()},
        {
            "".join(text.itertext()): link.get("href", "")
            for link in svg.iter("a")
            for text in link.iter("text")
        },
        {*_joined(svg, {name: box for name, (box, _) in boxes.items()})},
    )


def _joined(
    svg: ElementTree.Element, boxes: dict[str, ElementTree.Element]
) -> Iterator[tuple[str, str]]:
    """Find the boxes at both ends of each line."""

    def at(x: float, y: float) -> str:
        return next(
            name
            for name, box in boxes.items()
            if abs(float(box.get("x", "")) - x) < 3
            and float(box.get("y", "")) < y < float(box.get("y", "")) + float(box.get("height", ""))
        )

    for path in svg.iter("path"):
        numbers = path.get("d", "").split("M")[1].replace("C", " ").split()
        x, y, *_, end, to = map(float, numbers)
        assert end - x < GAP
        yield at(x - WIDTH, y), at(end, to)


def graph(filled: Filled, text: str) -> Graph:
    """The graph on the page of a fact."""
    return read(filled[1].get("/fact", params={"kb": "courier", "text": text}).text)


def work(kb: KnowledgeBase) -> None:
    """Go to the laboratory by a door that a camera has seen, and look around."""
    kb.load_domain(DOMAIN)
    kb.load_problem(PROBLEM)
    with kb.transaction(actor="camera"):
        kb.propositions.save("(door lab hall)")
    kb.apply("(move rb1 hall lab)")
    kb.apply("(look rb1 lab)")
    kb.apply("(move rb1 lab hall)")
    kb.apply("(move rb1 hall lab)")
    kb.apply("(move rb1 lab hall)")


def test_boxes_stand_by_how_far_they_are_and_lead_to_their_pages(filled: Filled) -> None:
    kb, _ = filled
    work(kb)
    first, look, *_ = [one.id for one in [*kb.executions.get_all()][::-1]]
    found = graph(filled, "(seen lab)")
    assert found.columns[-1] == ["this (seen lab)"]
    looked = f"execution {look} by filler (look rb1 lab)"
    moved = f"execution {first} by filler (move rb1 hall lab)"
    assert found.columns[-3:-1] == [[moved], [looked]]
    assert found.joined >= {(looked, "this (seen lab)"), (moved, looked)}
    links = {text: urlsplit(address) for text, address in found.links.items()}
    acted = links[f"execution {look} by filler"]
    assert (acted.path, dict(parse_qsl(acted.query))) == ("/act", {"id": look, "kb": "courier"})
    made = links["→ (at rb1 lab)"]
    assert made.path == "/fact"
    assert dict(parse_qsl(made.query)) == {"text": "(at rb1 lab)", "kb": "courier"}
    assert links["document by filler"].path == "/revision"
    assert filled[1].get(found.links["→ (at rb1 lab)"]).status_code == 200
    led = graph(filled, "(door lab hall)")
    assert led.columns[0] == ["observation by camera → (door lab hall)"]
    assert led.columns[1] == ["this (door lab hall)"]
    assert ("this (door lab hall)", "derived fact → (way lab hall)") in led.joined
    absent = next(text for text in led.links if text.startswith("→ (not "))
    assert dict(parse_qsl(urlsplit(led.links[absent]).query))["text"] == absent[7:-1]


def test_what_has_no_version_has_a_page_of_its_causes(filled: Filled) -> None:
    kb, client = filled
    kb.load_domain(DOMAIN.replace("(at ?r ?p) :effect", "(not (door ?p ?p)) :effect"))
    kb.load_problem(PROBLEM)
    kb.apply("(look rb1 lab)")
    # A list links both without the `not`.
    for text, why in (("(way hall lab)", "Rules derive it."), ("(door lab lab)", "its absence")):
        page = client.get("/fact", params={"kb": "courier", "text": text})
        assert page.status_code == 200
        assert why in page.text
        assert 'class="causes"' in page.text
    found = client.get("/fact", params={"kb": "courier", "text": "(door lab hall)"})
    assert found.status_code == 404


@pytest.mark.more
def test_a_line_comes_from_the_version_that_was_used(filled: Filled) -> None:
    """The robot was in the laboratory twice; each time it went on because of that."""
    kb, _ = filled
    work(kb)
    acts = [one.id for one in [*kb.executions.get_all()][::-1]]
    found = graph(filled, "(door hall lab)")

    def named(number: int, text: str) -> str:
        return f"execution {acts[number]} by filler {text}"

    there, back = "(move rb1 hall lab)", "(move rb1 lab hall)"
    steps = {line for line in found.joined if "execution" in line[0]}
    assert steps == {
        (named(0, there), named(1, "(look rb1 lab)")),
        (named(0, there), named(2, back)),
        (named(3, there), named(4, back)),
    }


@pytest.mark.more
def test_it_is_bounded_and_text_is_but_text(filled: Filled) -> None:
    kb, client = filled
    work(kb)
    with kb.transaction(actor="<b>&\u202e'"):
        for _ in range(CAUSES):
            kb.apply("(move rb1 hall lab)")
            kb.apply("(move rb1 lab hall)")
    page = client.get("/fact", params={"kb": "courier", "text": "(door hall lab)"}).text
    found = read(page)
    assert sum(map(len, found.columns)) <= 2 * CAUSES + 1
    assert any("by <b>&\\u202e'" in one for boxes in found.columns for one in boxes)
    assert "<b>&" not in page
    kb.propositions.save("(seen hall)")
    before = client.get("/fact", params={"kb": "courier", "text": "(seen hall)", "before": 2}).text
    assert 'class="causes"' not in before
    assert "Causes, as a graph" not in before
