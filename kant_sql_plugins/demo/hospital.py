"""A hospital with an incident to solve: a wrong fact led to an act."""

from __future__ import annotations

from collections.abc import Sequence

from kant_sql import KnowledgeBase

from .stories import Connect, Step, World

DOMAIN = """
(define (domain hospital)
  (:requirements :strips :typing :constraints)
  (:types robot place patient medicine)
  (:predicates
    (robot_at ?r - robot ?p - place)
    (holding ?r - robot ?m - medicine)
    (in_store ?m - medicine)
    (lies_in ?x - patient ?p - place)
    (prescribed ?m - medicine ?x - patient)
    (brought ?m - medicine ?x - patient)
    (took ?x - patient ?m - medicine))
  (:action fetch
    :parameters (?r - robot ?m - medicine)
    :precondition (and (robot_at ?r pharmacy) (in_store ?m))
    :effect (and (not (in_store ?m)) (holding ?r ?m)))
  (:action move
    :parameters (?r - robot ?from ?to - place)
    :precondition (robot_at ?r ?from)
    :effect (and (not (robot_at ?r ?from)) (robot_at ?r ?to)))
  (:action hand_over
    :parameters (?r - robot ?m - medicine ?x - patient ?p - place)
    :precondition (and (robot_at ?r ?p) (lies_in ?x ?p) (holding ?r ?m) (prescribed ?m ?x))
    :effect (and (not (holding ?r ?m)) (brought ?m ?x)))
  (:constants pharmacy - place))
"""
PROBLEM = """
(define (problem afternoon)
  (:domain hospital)
  (:objects rb1 - robot room1 room2 room4 - place ada omar noor - patient
    aspirin heparin insulin - medicine)
  (:init (robot_at rb1 pharmacy) (in_store aspirin) (in_store heparin) (in_store insulin)
    (lies_in ada room1) (lies_in omar room2) (lies_in noor room4)
    (prescribed aspirin ada) (prescribed heparin noor) (prescribed insulin omar))
  (:goal (and (took ada aspirin) (took noor heparin) (took omar insulin))))
"""
RULE = """(forall (?x - patient ?m - medicine)
  (always (not (and (took ?x ?m) (not (prescribed ?m ?x))))))"""
WRONG, HARM, ACT = "(lies_in noor room2)", "(took omar heparin)", "(brought heparin noor)"


def fill(connect: Connect) -> None:
    """Write the story of an afternoon."""
    ward, executive, nurse = connect("ward"), connect("executive"), connect("nurse")
    ward.load_domain(DOMAIN)
    ward.load_problem(PROBLEM)
    with ward.transaction(reason="nobody takes what is prescribed to others"):
        ward.rules.save("own_medicine", RULE)
    round_of(executive, "aspirin", "ada", "room1")
    seen(nurse, "(took ada aspirin)", "I watched her take it")
    beds = connect("bed_list")
    with beds.transaction(reason="the list of 13:10", source={"file": "beds.csv", "line": 12}):
        beds.propositions.delete("(lies_in noor room4)")
        beds.propositions.save(WRONG)
    round_of(executive, "heparin", "noor", "room2")
    seen(nurse, HARM, "he found it on his table")
    round_of(executive, "insulin", "omar", "room2")
    wrong = nurse.blame(WRONG)
    assert wrong is not None
    reason = "line 12 was about a visitor: noor was in room4 all day"
    with nurse.transaction(reason=reason, valid_from=wrong.since.committed_at):
        nurse.propositions.delete(WRONG)
        nurse.propositions.save("(lies_in noor room4)")
    seen(nurse, "(took omar insulin)", "checked twice")


def round_of(executive: KnowledgeBase, medicine: str, patient: str, room: str) -> None:
    """Bring a medicine to a patient, as far as the robot knows where that is."""
    with executive.transaction(reason=f"{medicine} for {patient}"):
        executive.apply(f"(fetch rb1 {medicine})")
    executive.apply(f"(move rb1 pharmacy {room})")
    with executive.transaction(reason=f"{patient} lies in {room}"):
        executive.apply(f"(hand_over rb1 {medicine} {patient} {room})")
    executive.apply(f"(move rb1 {room} pharmacy)")


def seen(nurse: KnowledgeBase, fact: str, reason: str) -> None:
    """Save what the nurse has seen."""
    with nurse.transaction(reason=reason):
        nurse.propositions.save(fact)


def steps(kb: KnowledgeBase) -> Sequence[Step]:
    """Make the steps of the page."""
    harm = next(iter(kb.history(HARM))).since.number
    return (
        Step(
            "What went wrong?",
            "The ward keeps a rule: nobody takes what is prescribed to somebody else. The page "
            "says which revision broke it, and who wrote that: a nurse, who saw that omar took "
            "heparin.",
            *("/rules", {}, "rules --kept"),
            "[(one.rule, one.revision.actor) for one in kb.rules.standing().violated]",
        ),
        Step(
            "What had the robot done?",
            "Every act is on record. The robot handed heparin over in room2, to noor, as it "
            "believed; omar lies in that room.",
            *("/acts", {"object": "heparin"}, "acts --object heparin"),
            '[(str(act), act.outcome) for act in kb.executions.get_all(object="heparin")]',
        ),
        Step(
            "Why did it go to that room?",
            "The graph shows the facts that the act used, and on the left the origin of each. "
            f"{WRONG} is not an effect of the robot. It comes from the bed list.",
            *("/fact", {"text": ACT}, f"origins '{ACT}' --depth 3"),
            f'[(one.text, one.revision.actor) for one in kb.origins("{ACT}", depth=3)]',
        ),
        Step(
            "Who said so?",
            "The page of the fact names who asserted it, why, and from which line of which file; "
            "and that the nurse has retracted it.",
            *("/fact", {"text": WRONG}, f"history '{WRONG}'"),
            f'[(one.since.actor, one.since.source) for one in kb.history("{WRONG}")]',
        ),
        Step(
            "What else came of it?",
            "The same page, further down: the acts that used the wrong fact, and those that used "
            "their effects. There was only one; you need to check nothing else.",
            *("/fact", {"text": WRONG}, f"consequences '{WRONG}' --depth 3"),
            f'[(one.text, one.made) for one in kb.consequences("{WRONG}", depth=3)]',
        ),
        Step(
            "What did the robot know, and what was true?",
            "As far as the robot knew, noor lay in room2. The nurse's correction is about that "
            "time; the page has the earlier belief, and her saying.",
            *("/corrections", {}, "corrections"),
            f'[state.query("(lies_in noor ?p)").to_dicts() for state in (kb.at({harm}), kb)]',
        ),
        Step(
            "Can anybody have changed the record?",
            "Press 'Verify now': the hash of every revision is recomputed, and the chain checked. "
            "Then hand over the report, one file that opens without a server.",
            *("/verify", {}, f"report --fact '{WRONG}' --out incident.html"),
            "kb.store.verify().is_intact",
        ),
    )


WORLD = World(
    "hospital",
    "an incident to solve: which wrong fact led to an act, and who said it",
    "A robot brings medicine from the pharmacy to patients. This afternoon a patient took what was "
    "prescribed to another one. Find out what happened, from the record alone.",
    fill,
    steps,
)
