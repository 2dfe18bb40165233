"""What becomes of the steps of a plan."""

from __future__ import annotations

from ..arguments import one_of, shown
from ..dto.atom_dto import atom_text
from ..errors import PlanError
from ..knowledge.plan import Step
from ..transaction import Transaction
from .interfaces import RecordedStep, StepStatus

# What a step can come to from each status; None: it was not started.
_NEXT: dict[str | None, tuple[str, ...]] = {
    None: ("started", "aborted"),
    "started": ("succeeded", "failed", "aborted"),
}
_SHOWN = {
    None: "was not started",
    "started": "is started",
    "succeeded": "has succeeded",
    "failed": "has failed",
    "aborted": "was aborted",
}
_STATUSES = tuple(filter(None, _SHOWN))


def set_status(transaction: Transaction, step: RecordedStep, status: StepStatus) -> bool:
    """Say what becomes of a step.

    Args:
        transaction: the transaction.
        step: the step.
        status: the status that it comes to.

    Returns:
        False when it has this status already.

    Raises:
        PlanError: the step is not known, or cannot come to this status from the one it has.
    """
    one_of(status, _STATUSES, "the status", PlanError)
    place = place_of(step)
    check_step(transaction, step)
    statuses = transaction.step_statuses
    before = statuses.get(place)
    if before == status:
        return False
    if status not in _NEXT.get(before, ()):
        raise PlanError(
            f"step {step.position} of plan {step.plan_id}, {step}, {_SHOWN[before]}, so it cannot "
            f"be {status!r} next"
        )
    statuses.set(place, status)
    return True


def place_of(step: RecordedStep) -> Step:
    """Give the place of a step.

    Args:
        step: the step.

    Returns:
        The id of its plan, and its position.

    Raises:
        PlanError: it is no step that was recorded.
    """
    if not isinstance(step, RecordedStep):
        raise PlanError(
            f"a step is one of a recorded plan, as kb.plans.record(plan).steps has them, not "
            f"{shown(step)}"
        )
    return step.plan_id, step.position


def check_step(transaction: Transaction, step: RecordedStep) -> None:
    """Make sure that a step is of a plan of this knowledge base.

    Args:
        transaction: the transaction.
        step: the step.

    Raises:
        PlanError: it is not.
    """
    role = f"step {step.position} of plan {step.plan_id}, {step},"
    if step.knowledge_base != transaction.name:
        raise PlanError(
            f"{role} is of knowledge base {step.knowledge_base!r}, not of {transaction.name!r}; "
            "use that one, or record the plan here"
        )
    found = transaction.step_statuses.find(place_of(step))
    if found is None:
        raise PlanError(
            f"{role} is not in knowledge base {transaction.name!r}: what recorded it was not "
            "committed, or it is of another store; record the plan first"
        )
    if found != atom_text(step.action, step.arguments):
        raise PlanError(
            f"{role} is {found} in knowledge base {transaction.name!r}: it is of another store; "
            "record the plan here"
        )


def names_in(text: str) -> tuple[str, tuple[str, ...]]:
    """Take the text of a step apart; no name has a space or a parenthesis.

    Args:
        text: the text, for example `(move rb1 wp1 wp2)`.

    Returns:
        The action's name, and those of its arguments.
    """
    action, *arguments = text[1:-1].split(" ")
    return action, tuple(arguments)
