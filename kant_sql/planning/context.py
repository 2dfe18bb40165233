"""What the parts of a conversion to unified-planning share: its elements by their PDDL names."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..dto.formula import Derived
from ..dto.name import fold
from ..errors import UnsupportedConstructError
from .names import Names
from .up_types import Types

if TYPE_CHECKING:
    from unified_planning.environment import Environment
    from unified_planning.model import Fluent, FNode, Object, Problem, Variable


@dataclass(frozen=True, slots=True)
class Scope:
    """The variables that a formula may mention.

    Attributes:
        bound: what each stands for, by its folded name.
        names: what unified-planning's parameters and variables around the formula are called.
    """

    bound: dict[str, FNode] = field(default_factory=dict)
    names: frozenset[str] = frozenset()

    def fresh(self, name: str) -> str:
        """Give a name that no variable around has, so that none is hidden.

        Args:
            name: the name in PDDL.

        Returns:
            That name, with a number appended when it is taken.
        """
        candidate, number = name, 2
        while candidate in self.names:
            candidate, number = f"{name}_{number}", number + 1
        return candidate

    def bind(self, name: str, node: FNode) -> Scope:
        """Let a variable stand for something.

        Args:
            name: the variable's name in PDDL.
            node: what it stands for.

        Returns:
            The scope within.
        """
        taken = self.names | {variable.name for variable in _variables(node)}
        return Scope({**self.bound, fold(name): node}, taken)


def _variables(node: FNode) -> list[Variable]:
    if node.is_parameter_exp():
        return [node.parameter()]
    return [node.variable()] if node.is_variable_exp() else []


@dataclass
class Context:
    """A conversion under way.

    Attributes:
        environment: unified-planning's environment.
        problem: the problem that is built.
        names: what the elements are called.
        types: the hierarchy of types.
        fluents: predicates and functions, by category and folded name.
        objects: the objects, by folded name.
        rules: the rules of derived predicates, by folded name.
        static: the folded names of the functions that nothing changes.
        integers: whether all numbers are integers, and fluents may be so too.
        costed: whether `total-cost` is the actions' cost and no fluent.
        where: what is being converted, for messages.
    """

    environment: Environment
    problem: Problem
    names: Names
    types: Types
    fluents: dict[tuple[str, str], Fluent] = field(default_factory=dict)
    objects: dict[str, Object] = field(default_factory=dict)
    rules: dict[str, list[Derived]] = field(default_factory=dict)
    static: frozenset[str] = frozenset()
    integers: bool = False
    costed: bool = False
    where: str = ""

    @contextmanager
    def at(self, where: str) -> Iterator[None]:
        """Say what is being converted, and turn unified-planning's refusals into ours.

        Args:
            where: what it is: "action move", "the goal" ...

        Yields:
            Nothing.

        Raises:
            UnsupportedConstructError: unified-planning refused what it was given.
        """
        from unified_planning.exceptions import UPException

        outer, self.where = self.where, where
        try:
            yield
        except UPException as error:
            reason = " ".join(" ".join(map(str, error.args)).split())
            raise UnsupportedConstructError(
                f"unified-planning refuses {where}: {reason or type(error).__name__}"
            ) from error
        finally:
            self.where = outer

    def unsupported(self, construct: object, reason: str) -> UnsupportedConstructError:
        """Make the error for a construct without a counterpart.

        Args:
            construct: the construct, as PDDL text.
            reason: why it has none, and what to do.

        Returns:
            The error, which says where the construct is.
        """
        text = " ".join(str(construct).split())
        shown = text if len(text) <= 120 else text[:117] + "..."
        return UnsupportedConstructError(
            f"unified-planning cannot express {shown} in {self.where}: {reason}"
        )
