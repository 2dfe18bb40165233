"""Actions, processes and events as plain data, with their literals."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

from ..arguments import expect, expect_list, flag, items
from .elements import AtomDto, NamedDto, PddlObjectDto, PddlPredicateDto, atom_text
from .formulas import Node
from .lexical import check_number, fold, number_text


@dataclass(init=False, eq=False)
class PddlConditionEffectDto(AtomDto):
    """A literal over an action's parameters, with a time in a durative action.

    Equal by predicate, objects, time and negation. Its text is `(at start (not (robot_at ?r ?s)))`,
    without the time wrapper when it has none.

    Attributes:
        predicate: the predicate.
        objects: the terms, in order: parameters of the action, or constants.
        time: `AT_START`, `AT_END` or `OVER_ALL`; `None` in an instantaneous action.
        is_negative: whether the literal is negated.
    """

    AT_START: ClassVar[str] = "at start"
    AT_END: ClassVar[str] = "at end"
    OVER_ALL: ClassVar[str] = "over all"

    time: str | None
    is_negative: bool

    def __init__(
        self,
        predicate: PddlPredicateDto,
        objects: Iterable[PddlObjectDto] | None = None,
        time: str | None = None,
        is_negative: bool = False,
    ) -> None:
        super().__init__(predicate, objects)
        self.set_time(time)
        self.set_is_negative(is_negative)

    def get_time(self) -> str | None:
        """Return the time."""
        return self.time

    def set_time(self, time: str | None) -> None:
        """Set the time."""
        if time is not None:
            expect(time, str, "the time of a PddlConditionEffectDto")
        self.time = time

    def get_is_negative(self) -> bool:
        """Return whether the literal is negated."""
        return self.is_negative

    def set_is_negative(self, is_negative: bool) -> None:
        """Set whether the literal is negated."""
        self.is_negative = flag(is_negative, "is_negative of a PddlConditionEffectDto")

    def _identity(self) -> tuple[object, ...]:
        name, terms = fold(self.predicate.name), self._folded_objects()
        return ("literal", name, terms, self.time, bool(self.is_negative))

    def text(self, parameters: Collection[str] | None = None) -> str:
        """Write the literal.

        Args:
            parameters: the folded names of the action's parameters; other terms are constants and
                get no question mark. `None` for an unknown action: all terms are variables.

        Returns:
            The PDDL text.
        """
        names = [object_.name for object_ in self.objects]
        terms = [
            f"?{name}" if parameters is None or fold(name) in parameters else name for name in names
        ]
        text = atom_text(self.predicate.name, terms)
        if self.is_negative:
            text = f"(not {text})"
        return f"({self.time} {text})" if self.time else text

    def _text(self) -> str:
        return self.text()


DEFAULT_DURATION = 10

Duration = int | float | Decimal | Sequence[Node]
_PARTS = (PddlConditionEffectDto, Node)


@dataclass(init=False, eq=False)
class PddlActionDto(NamedDto):
    """An action: its conditions, its effects, and for a durative action its duration.

    Equal by name. Its text is a `:durative-action`, or an `:action`.

    Attributes:
        name: the action's name.
        parameters: the parameters, in order.
        conditions: the conditions, in order: literals, and nodes of formulas.
        effects: the effects, in order: literals, and nodes of effects.
        durative: whether it is a durative action (PDDL 2.1, section 5).
        duration: the duration of a durative action, in the planner's units of time: a number, or
            the constraints on `Variable("duration")`; ignored otherwise.
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
        """Its PDDL keyword: `action` or `durative-action`."""
        return "durative-action" if self.durative else "action"

    def get_parameters(self) -> list[PddlObjectDto]:
        """Return the parameters."""
        return self.parameters

    def set_parameters(self, parameters: Iterable[PddlObjectDto] | None) -> None:
        """Set the parameters."""
        self.parameters = items(parameters, PddlObjectDto, "the parameters of an action")

    def get_conditions(self) -> list[PddlConditionEffectDto | Node]:
        """Return the conditions."""
        return self.conditions

    def set_conditions(self, conditions: Iterable[PddlConditionEffectDto | Node] | None) -> None:
        """Set the conditions."""
        self.conditions = items(conditions, _PARTS, "the conditions of an action")

    def get_effects(self) -> list[PddlConditionEffectDto | Node]:
        """Return the effects."""
        return self.effects

    def set_effects(self, effects: Iterable[PddlConditionEffectDto | Node] | None) -> None:
        """Set the effects."""
        self.effects = items(effects, _PARTS, "the effects of an action")

    def get_durative(self) -> bool:
        """Return whether the action is durative."""
        return self.durative

    def set_durative(self, durative: bool) -> None:
        """Set whether the action is durative."""
        self.durative = flag(durative, "durative of an action")

    def get_duration(self) -> Duration:
        """Return the duration."""
        return self.duration

    def set_duration(self, duration: Duration) -> None:
        """Set the duration."""
        role = "the duration of an action"
        if isinstance(duration, list | tuple):
            expect_list(duration, Node, role)
        else:
            check_number(duration, role)
        self.duration = duration

    def _text(self) -> str:
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
    """A process or an event: an action in PDDL's syntax that is never durative."""

    def __init__(
        self,
        name: str,
        parameters: Iterable[PddlObjectDto] | None = None,
        conditions: Iterable[PddlConditionEffectDto | Node] | None = None,
        effects: Iterable[PddlConditionEffectDto | Node] | None = None,
    ) -> None:
        super().__init__(name, parameters, conditions, effects, durative=False)


class PddlProcessDto(_InstantDto):
    """A process: continuous change while its condition holds (PDDL+, section 3).

    It has the fields of an instantaneous action; its text is a `:process`.
    """

    @property
    def keyword(self) -> str:
        """Its PDDL keyword: `process`."""
        return "process"


class PddlEventDto(_InstantDto):
    """An event: it occurs as soon as its condition holds (PDDL+, section 3).

    It has the fields of an instantaneous action; its text is an `:event`.
    """

    @property
    def keyword(self) -> str:
        """Its PDDL keyword: `event`."""
        return "event"


# Classes of actions with their own keyword.
CLASSES: dict[str, type[PddlActionDto]] = {"process": PddlProcessDto, "event": PddlEventDto}


def _text(part: PddlConditionEffectDto | Node, parameters: set[str]) -> str:
    return part.text(parameters) if isinstance(part, PddlConditionEffectDto) else str(part)


def duration_text(duration: Duration) -> str:
    """Write the constraint on a duration (PDDL 2.1, section 5.1)."""
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
    """Write an action, a process or an event."""
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
