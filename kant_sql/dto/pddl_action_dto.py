"""A PDDL action, durative or not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

from ..arguments import expect_list, flag, items
from .dto import NamedDto
from .formula import Node
from .name import fold
from .number import check_number, number_text
from .pddl_condition_effect_dto import PddlConditionEffectDto
from .pddl_object_dto import PddlObjectDto

DEFAULT_DURATION = 10

Duration = int | float | Decimal | Sequence[Node]
_PARTS = (PddlConditionEffectDto, Node)


@dataclass(init=False, eq=False)
class PddlActionDto(NamedDto):
    """An action: what it needs, what it changes, and for a durative one how long it takes.

    Equal by name. Its text is a `:durative-action`, or an `:action`.

    Attributes:
        name: the action's name.
        parameters: the parameters, in order.
        conditions: what must hold, in order: literals, and nodes of formulas.
        effects: what it brings about, in order: literals, and nodes of effects.
        durative: whether it is a durative action (PDDL 2.1, section 5).
        duration: how long a durative action takes, in the planner's units of time: a number, or
            the constraints on `Variable("duration")`; not used otherwise.
    """

    name: str
    parameters: list[PddlObjectDto]
    conditions: list[PddlConditionEffectDto | Node]
    effects: list[PddlConditionEffectDto | Node]
    durative: bool
    duration: Duration

    _kind: ClassVar[str] = "action"

    def __init__(
        self,
        name: str,
        parameters: Iterable[PddlObjectDto] | None = None,
        conditions: Iterable[PddlConditionEffectDto | Node] | None = None,
        effects: Iterable[PddlConditionEffectDto | Node] | None = None,
        durative: bool = True,
        *,
        duration: Duration = DEFAULT_DURATION,
    ) -> None:
        self.name = self._checked_name(name)
        self.set_parameters(parameters)
        self.set_conditions(conditions)
        self.set_effects(effects)
        self.set_durative(durative)
        self.set_duration(duration)

    @property
    def keyword(self) -> str:
        """What it is, as PDDL says it: `action` or `durative-action`."""
        return "durative-action" if self.durative else "action"

    def get_parameters(self) -> list[PddlObjectDto]:
        """Give the parameters.

        Returns:
            The parameters, in order.
        """
        return self.parameters

    def set_parameters(self, parameters: Iterable[PddlObjectDto] | None) -> None:
        """Set the parameters.

        Args:
            parameters: the parameters in order; copied. `None` means none.
        """
        self.parameters = items(parameters, PddlObjectDto, "the parameters of an action")

    def get_conditions(self) -> list[PddlConditionEffectDto | Node]:
        """Give the conditions.

        Returns:
            What must hold, in order: literals, and nodes of formulas.
        """
        return self.conditions

    def set_conditions(self, conditions: Iterable[PddlConditionEffectDto | Node] | None) -> None:
        """Set the conditions.

        Args:
            conditions: what must hold; copied. `None` means none.
        """
        self.conditions = items(conditions, _PARTS, "the conditions of an action")

    def get_effects(self) -> list[PddlConditionEffectDto | Node]:
        """Give the effects.

        Returns:
            What it brings about, in order: literals, and nodes of effects.
        """
        return self.effects

    def set_effects(self, effects: Iterable[PddlConditionEffectDto | Node] | None) -> None:
        """Set the effects.

        Args:
            effects: what it brings about; copied. `None` means none.
        """
        self.effects = items(effects, _PARTS, "the effects of an action")

    def get_durative(self) -> bool:
        """Tell whether the action is durative.

        Returns:
            True when it is.
        """
        return self.durative

    def set_durative(self, durative: bool) -> None:
        """Say whether the action is durative.

        Args:
            durative: True when it is.
        """
        self.durative = flag(durative, "durative of an action")

    def get_duration(self) -> Duration:
        """Give the duration.

        Returns:
            The duration, in the planner's units of time, or the constraints on it.
        """
        return self.duration

    def set_duration(self, duration: Duration) -> None:
        """Set the duration.

        Args:
            duration: the duration, in the planner's units of time, or the constraints on it.
        """
        self.duration = checked_duration(duration, "the duration of an action")

    def __str__(self) -> str:
        names = {fold(parameter.name) for parameter in self.parameters}
        return action_text(
            self.keyword,
            self.name,
            [(parameter.name, parameter.type.name) for parameter in self.parameters],
            duration_text(self.duration),
            [_text(part, names) for part in self.conditions],
            [_text(part, names) for part in self.effects],
        )


class _InstantDto(PddlActionDto):
    """What is written as an action, and is never durative."""

    def __init__(
        self,
        name: str,
        parameters: Iterable[PddlObjectDto] | None = None,
        conditions: Iterable[PddlConditionEffectDto | Node] | None = None,
        effects: Iterable[PddlConditionEffectDto | Node] | None = None,
    ) -> None:
        super().__init__(name, parameters, conditions, effects, durative=False)


class PddlProcessDto(_InstantDto):
    """A process: what changes continuously while its condition holds (PDDL+, section 3).

    As an action that is not durative; its text is a `:process`.
    """

    @property
    def keyword(self) -> str:
        """What it is, as PDDL says it: `process`."""
        return "process"


class PddlEventDto(_InstantDto):
    """An event: what happens as soon as its condition holds (PDDL+, section 3).

    As an action that is not durative; its text is an `:event`.
    """

    @property
    def keyword(self) -> str:
        """What it is, as PDDL says it: `event`."""
        return "event"


def _text(part: PddlConditionEffectDto | Node, parameters: set[str]) -> str:
    return part.text(parameters) if isinstance(part, PddlConditionEffectDto) else str(part)


def checked_duration(duration: Duration, role: str) -> Duration:
    """Check the duration of an action.

    Args:
        duration: a number, or the conjuncts of a constraint.
        role: what it is, for the message.

    Returns:
        The same.

    Raises:
        InvalidKnowledgeError: it is neither a finite number nor a list of nodes.
    """
    if isinstance(duration, list | tuple):
        return expect_list(duration, Node, role)
    check_number(duration, role)
    return duration


def duration_text(duration: Duration) -> str:
    """Write the constraint on a duration (PDDL 2.1, section 5.1).

    Args:
        duration: a number, or the conjuncts of the constraint.

    Returns:
        The PDDL text, for example `(= ?duration 10)`; `()` when nothing constrains it.
    """
    if isinstance(duration, int | float | Decimal):
        return f"(= ?duration {number_text(duration)})"
    texts = [str(part) for part in duration]
    return texts[0] if len(texts) == 1 else f"(and {' '.join(texts)})" if texts else "()"


def action_text(
    keyword: str,
    name: str,
    parameters: Iterable[tuple[str, str]],
    duration: str,
    conditions: Iterable[str],
    effects: Iterable[str],
) -> str:
    """Write an action, a process or an event.

    Args:
        keyword: `action`, `durative-action`, `process` or `event`.
        name: its name.
        parameters: name and type of each parameter as text, in order.
        duration: the constraint's text; written for a durative action alone.
        conditions: the text of each condition, in order.
        effects: the text of each effect, in order.

    Returns:
        The PDDL text, lines broken by a line feed and indented by tabs.
    """
    durative = keyword == "durative-action"
    lines = [
        f"(:{keyword} {name}",
        f"\t:parameters ({''.join(f' ?{name} - {type_}' for name, type_ in parameters)})",
        *([f"\t:duration {duration}"] if durative else []),
        f"\t:{'condition' if durative else 'precondition'} (and",
        *(f"\t\t{text}" for text in conditions),
        "\t)",
        "\t:effect (and",
        *(f"\t\t{text}" for text in effects),
        "\t)",
        ")",
    ]
    return "\n".join(lines)
