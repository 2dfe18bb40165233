"""A PDDL action, durative or not."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

from .dto import NamedDto
from .name import fold
from .pddl_condition_effect_dto import PddlConditionEffectDto
from .pddl_object_dto import PddlObjectDto

DEFAULT_DURATION = 10


@dataclass(init=False, eq=False)
class PddlActionDto(NamedDto):
    """An action: what it needs, what it changes, and for a durative one how long it takes.

    Equal by name. Its text is a `:durative-action`, or an `:action`.

    Attributes:
        name: the action's name.
        parameters: the parameters, in order.
        conditions: the literals that must hold, in order.
        effects: the literals that it brings about, in order.
        durative: whether it is a durative action (PDDL 2.1, section 5).
        duration: how long a durative action takes, in the planner's units of time; not used
            otherwise.
    """

    name: str
    parameters: list[PddlObjectDto]
    conditions: list[PddlConditionEffectDto]
    effects: list[PddlConditionEffectDto]
    durative: bool
    duration: int | float

    _kind: ClassVar[str] = "action"

    def __init__(
        self,
        name: str,
        parameters: Iterable[PddlObjectDto] | None = None,
        conditions: Iterable[PddlConditionEffectDto] | None = None,
        effects: Iterable[PddlConditionEffectDto] | None = None,
        durative: bool = True,
        *,
        duration: int | float = DEFAULT_DURATION,
    ) -> None:
        self.name = name
        self.parameters = list(parameters or ())
        self.conditions = list(conditions or ())
        self.effects = list(effects or ())
        self.durative = durative
        self.duration = duration

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
        self.parameters = list(parameters or ())

    def get_conditions(self) -> list[PddlConditionEffectDto]:
        """Give the conditions.

        Returns:
            The literals that must hold, in order.
        """
        return self.conditions

    def set_conditions(self, conditions: Iterable[PddlConditionEffectDto] | None) -> None:
        """Set the conditions.

        Args:
            conditions: the literals that must hold; copied. `None` means none.
        """
        self.conditions = list(conditions or ())

    def get_effects(self) -> list[PddlConditionEffectDto]:
        """Give the effects.

        Returns:
            The literals that it brings about, in order.
        """
        return self.effects

    def set_effects(self, effects: Iterable[PddlConditionEffectDto] | None) -> None:
        """Set the effects.

        Args:
            effects: the literals that it brings about; copied. `None` means none.
        """
        self.effects = list(effects or ())

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
        self.durative = durative

    def get_duration(self) -> int | float:
        """Give the duration.

        Returns:
            The duration, in the planner's units of time.
        """
        return self.duration

    def set_duration(self, duration: int | float) -> None:
        """Set the duration.

        Args:
            duration: the duration, in the planner's units of time.
        """
        self.duration = duration

    def __str__(self) -> str:
        names = {fold(parameter.name) for parameter in self.parameters}
        return action_text(
            self.name,
            [(parameter.name, parameter.type.name) for parameter in self.parameters],
            [literal.text(names) for literal in self.conditions],
            [literal.text(names) for literal in self.effects],
            number_text(self.duration) if self.durative else None,
        )


def number_text(number: int | float) -> str:
    """Write a number as PDDL does: digits with a decimal point, never an exponent.

    Args:
        number: the number.

    Returns:
        Its shortest exact text, for example `10` or `2.5`.
    """
    if isinstance(number, int):
        return str(number)
    # The point tells a float from an int when it is read back; the sum has no negative zero.
    text = format(Decimal(repr(float(number) + 0.0)), "f")
    return text if "." in text else f"{text}.0"


def action_text(
    name: str,
    parameters: Iterable[tuple[str, str]],
    conditions: Iterable[str],
    effects: Iterable[str],
    duration: str | None,
) -> str:
    """Write an action.

    Args:
        name: the action's name.
        parameters: name and type name of each parameter, in order.
        conditions: the text of each condition, in order.
        effects: the text of each effect, in order.
        duration: the duration's text; `None` for an action that is not durative.

    Returns:
        The PDDL text, lines broken by a line feed and indented by tabs.
    """
    durative = duration is not None
    lines = [
        f"(:{'durative-action' if durative else 'action'} {name}",
        f"\t:parameters ({''.join(f' ?{name} - {type_}' for name, type_ in parameters)})",
        *([f"\t:duration (= ?duration {duration})"] if durative else []),
        f"\t:{'condition' if durative else 'precondition'} (and",
        *(f"\t\t{text}" for text in conditions),
        "\t)",
        "\t:effect (and",
        *(f"\t\t{text}" for text in effects),
        "\t)",
        ")",
    ]
    return "\n".join(lines)
