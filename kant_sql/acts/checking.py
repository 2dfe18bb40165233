"""Checks of acts to record: steps of PDDL, and reports of components without PDDL."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Literal

from ..arguments import shown, storable_text
from ..dto.elements import atom_text
from ..dto.lexical import decimal_text
from ..errors import PlanError
from ..knowledge.definitions import ActionDefinition, Definitions, ObjectDefinition
from ..pddl.cursor import hint
from ..pddl.document import EXECUTABLE
from ..planning import Plan, PlanStep
from ..sql.executions import ExecutionDefinition, quoted


def check_steps(
    definitions: Definitions, revision: int, plan: Plan
) -> tuple[ExecutionDefinition, ...]:
    """Find the actions and objects of a plan's steps, at the revision of its state."""
    return tuple(
        _StepCheck(definitions, revision, position, step).read()
        for position, step in enumerate(plan.steps)
    )


class _StepCheck:
    """Checks one step against the state that its plan was made from."""

    def __init__(
        self, definitions: Definitions, revision: int, position: int, step: PlanStep
    ) -> None:
        self._definitions = definitions
        self._revision = revision
        self._step = step
        words = shown(atom_text(step.action, step.arguments))
        self._role = f"step {position} of the plan, {words}"

    def read(self) -> ExecutionDefinition:
        action = self._action()
        objects = self._objects(action)
        return ExecutionDefinition(
            self._seconds(self._step.start, "start"),
            self._seconds(self._step.duration, "duration"),
            action.id,
            None,
            tuple(object_.id for object_ in objects),
            atom_text(action.name, [object_.name for object_ in objects]),
        )

    def _unknown(self, kind: Literal["action", "object"], name: str) -> PlanError:
        known = [one.name for one in self._definitions.elements(kind)]
        return PlanError(
            f"{self._role}: {kind} {shown(name)} is not known at revision {self._revision}, the "
            f"state that it was planned from{hint(name, known)}; give the plan the revision of the "
            "state that has it"
        )

    def _action(self) -> ActionDefinition:
        action = self._definitions.actions.named(self._step.action)
        if action is None:
            raise self._unknown("action", self._step.action)
        if action.kind not in EXECUTABLE:
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
            raise self._unknown("object", name)
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
        text = None if number is None else decimal_text(number)
        if text is not None and text.startswith("-"):
            raise PlanError(f"{self._role}: its {role} is {text}, expected 0 seconds or more")
        return text


def reported(
    definitions: Definitions, name: str, arguments: Sequence[str], duration: str | None = None
) -> ExecutionDefinition:
    """Make an execution from a component's report: known names become references."""
    objects = [definitions.objects.named(one) for one in arguments]
    action = definitions.actions.named(name)
    if action is not None and (None in objects or len(objects) != len(action.parameters)):
        action = None
    pairs = [*zip(arguments, objects, strict=True)]
    words = (quoted(one) if object_ is None else object_.name for one, object_ in pairs)
    return ExecutionDefinition(
        None,
        duration,
        None if action is None else action.id,
        name if action is None else None,
        tuple(one if object_ is None else object_.id for one, object_ in pairs),
        f"({' '.join((quoted(name) if action is None else action.name, *words))})",
    )


def check_words(name: object, arguments: object) -> tuple[str, tuple[str, ...]]:
    """Check the name and the arguments of a reported act."""
    role = "the name of the act"
    text = _word(name, role)
    if isinstance(arguments, str) or not isinstance(arguments, Iterable):
        raise PlanError(f"the arguments of {shown(text)} are {shown(arguments)}, expected a list")
    found = (
        _word(one, f"argument {number} of {shown(text)}") for number, one in enumerate(arguments, 1)
    )
    return text, tuple(found)


def _word(given: object, role: str) -> str:
    # A DTO of an object has its name.
    named = getattr(given, "name", given)
    if not isinstance(named, str):
        raise PlanError(f"{role} is {shown(given)}, expected a text or an object")
    if not named.strip():
        raise PlanError(f"{role} is empty; say what it is")
    storable_text(named, role, PlanError)
    return named
