"""Checking a plan against the state that it was planned from."""

from __future__ import annotations

from decimal import Decimal

from ..arguments import shown
from ..dto.atom_dto import atom_text
from ..dto.number import number_text
from ..errors import InvalidKnowledgeError, PlanError
from ..knowledge.action import ActionDefinition
from ..knowledge.definitions import Definitions
from ..knowledge.object import ObjectDefinition
from ..knowledge.plan import StepDefinition
from ..pddl.document import ACTION, DURATIVE_ACTION
from ..planning import Plan, PlanStep


def check_steps(definitions: Definitions, revision: int, plan: Plan) -> tuple[StepDefinition, ...]:
    """Find what the steps of a plan refer to.

    Args:
        definitions: what was defined in the state that it was planned from.
        revision: the revision of that state.
        plan: the plan.

    Returns:
        The steps, in order.

    Raises:
        PlanError: a step does not go with that state.
    """
    if not isinstance(plan.steps, tuple | list):
        raise PlanError(f"the plan has the steps {shown(plan.steps)}, expected a tuple")
    return tuple(
        _StepReader(definitions, revision, position, step).read()
        for position, step in enumerate(plan.steps)
    )


def check_text(text: str | None, role: str) -> str | None:
    """Check a text that a database is to keep as it is.

    Args:
        text: the text, or None.
        role: what it is, for the message.

    Returns:
        The same.

    Raises:
        PlanError: it is none, or has a NUL or half a character.
    """
    if text is None:
        return None
    if not isinstance(text, str):
        raise PlanError(f"{role} is a string or None, not {shown(text)}")
    if "\0" in text or any("\ud800" <= character <= "\udfff" for character in text):
        raise PlanError(f"{role} {shown(text)} has a NUL or half a character; leave it out")
    return text


def exact_text(number: Decimal | int | None, role: str) -> str | None:
    """Write a number so that it can be read back as it was.

    Args:
        number: the number, or None.
        role: what it is, for the message.

    Returns:
        Its decimal text.

    Raises:
        PlanError: it is none, or not finite.
    """
    if number is None:
        return None
    if isinstance(number, bool) or not isinstance(number, int | float | Decimal):
        raise PlanError(f"{role} is {shown(number)}, expected a number or None")
    try:
        return number_text(number)
    except InvalidKnowledgeError as error:
        raise PlanError(f"{role}: {error}") from error


class _StepReader:
    """Checks one step."""

    def __init__(
        self, definitions: Definitions, revision: int, position: int, step: PlanStep
    ) -> None:
        self._definitions = definitions
        self._revision = revision
        self._step = step
        role = f"step {position} of the plan"
        if not isinstance(step, PlanStep):
            raise PlanError(f"{role} is a PlanStep, not {shown(step)}")
        if not isinstance(step.arguments, tuple | list):
            raise PlanError(f"{role} has the arguments {shown(step.arguments)}, expected a tuple")
        names = (step.action, *step.arguments)
        for name in names:
            if not isinstance(name, str):
                raise PlanError(f"{role}: a name is a string, not {shown(name)}")
        self._role = f"{role}, {shown(atom_text(names[0], names[1:]))}"

    def read(self) -> StepDefinition:
        action = self._action()
        objects = self._objects(action)
        return StepDefinition(
            self._seconds(self._step.start, "start"),
            self._seconds(self._step.duration, "duration"),
            action.id,
            tuple(object_.id for object_ in objects),
            atom_text(action.name, [object_.name for object_ in objects]),
        )

    def _action(self) -> ActionDefinition:
        action = self._definitions.actions.named(self._step.action)
        if action is None:
            raise PlanError(
                f"{self._role}: action {shown(self._step.action)} is not known at revision "
                f"{self._revision}, the state that it was planned from; give the plan the revision "
                "of the state that has it"
            )
        if action.kind not in (ACTION, DURATIVE_ACTION):
            raise PlanError(
                f"{self._role}: {action.name!r} is of kind {action.kind}, which happens by itself; "
                "leave the step out"
            )
        return action

    def _objects(self, action: ActionDefinition) -> list[ObjectDefinition]:
        names = self._step.arguments
        if len(names) != len(action.parameters):
            raise PlanError(
                f"{self._role} has {len(names)} arguments, expected {len(action.parameters)} as in "
                f"{' '.join(action.text.split()):.200}"
            )
        return [self._object(action, number, name) for number, name in enumerate(names)]

    def _object(self, action: ActionDefinition, number: int, name: str) -> ObjectDefinition:
        object_ = self._definitions.objects.named(name)
        if object_ is None:
            raise PlanError(
                f"{self._role}: object {shown(name)} is not known at revision {self._revision}, "
                "the state that it was planned from; give the plan the revision of the state that "
                "has it"
            )
        allowed = action.parameters[number].type_ids
        if not self._definitions.any_fits(object_.type_ids, allowed):
            types = self._definitions.types
            wanted = " or ".join(types.live(id_).name for id_ in allowed)
            raise PlanError(
                f"{self._role}: argument {number + 1}, {object_.name!r}, is "
                f"{object_.text!r} at revision {self._revision}, expected a {wanted} as action "
                f"{action.name!r} has it; replan from the present state"
            )
        return object_

    def _seconds(self, number: Decimal | None, role: str) -> str | None:
        text = exact_text(number, f"{self._role}: its {role}")
        if text is not None and text.startswith("-"):
            raise PlanError(f"{self._role}: its {role} is {text}, expected 0 seconds or more")
        return text
