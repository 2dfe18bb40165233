"""A day of three robots of one fleet, with fixed times."""

from __future__ import annotations

import kant_sql
from tests.audit.story import Clock, at

DOMAIN = """
(define (domain doors)
  (:requirements :strips :typing)
  (:types robot door)
  (:predicates (open ?d - door) (passed ?r - robot ?d - door))
  (:action go
    :parameters (?r - robot ?d - door)
    :precondition (and (open ?d))
    :effect (and (passed ?r ?d))))
"""
BOLD = DOMAIN.replace("(and (open ?d))", "(and)")
ROBOTS = "tiago", "pepper", "rosie"
D1, D2, PASSED = "(open d1)", "(open d2)", "(passed r1 d3)"
OBJECTS = {D1: ["d1 - door"], D2: ["d2 - door"], PASSED: ["r1 - robot", "d3 - door"]}
# When, who, whether it began, and what.
SEEN = (
    *(("09:00", "tiago", True, D1), ("09:05", "rosie", True, D2), ("09:10", "pepper", True, D1)),
    *(("09:20", "pepper", True, D2), ("10:30", "tiago", True, D2), ("11:00", "pepper", False, D1)),
    *(("12:30", "tiago", True, PASSED), ("13:30", "rosie", True, PASSED)),
)


def write_fleet(url: str) -> str:
    """Write what the robots saw; give the URL."""
    clock = Clock()
    with clock.ruling(), kant_sql.open_store(url) as store:
        kbs = {name: store.knowledge_base(name) for name in ROBOTS}
        clock.moment = at("08:00")
        for kb in kbs.values():
            with kb.transaction(actor="loader", reason="deployed"):
                kb.load_domain(DOMAIN)
        for time, name, has_begun, fact in SEEN:
            clock.moment, dao = at(time), kbs[name].propositions
            with kbs[name].transaction(actor="perception", reason="saw it"):
                kbs[name].objects.save_all(OBJECTS[fact])
                assert (dao.save if has_begun else dao.delete)(fact)
        clock.moment = at("13:00")
        with kbs["tiago"].transaction(actor="loader", reason="deployed"):
            kbs["tiago"].load_domain(BOLD, mode="replace")
        for name in ("tiago", "pepper"):
            assert kbs[name].store.verify(keep=True).is_kept
    return url
