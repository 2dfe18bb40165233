"""Binds DAOs, and functions of a state, as the members of the front door and its parts."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cached_property, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

from .arguments import expect
from .dao.base import refuse_past
from .errors import InvalidArgumentError
from .factory import DaoFactory, SqlDaoFactory, daos_only
from .store.state import State

P = ParamSpec("P")
R = TypeVar("R")


class Front:
    """What users ask: a knowledge base, or one of its parts."""

    def __init__(self, factory: DaoFactory, *, state: State | None = None) -> None:
        self._factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self._state = state
        if state is None and isinstance(factory, SqlDaoFactory):
            self._state = factory.state


def factory_of(front: Front) -> DaoFactory:
    """Return the factory of the DAOs."""
    return front._factory


def state_of(front: Front) -> State:
    """Return what functions of a state are asked of.

    Raises:
        InvalidUrlError: the DAO family is not built on an SQL store, and has DAOs only.
        ClosedError: the store was closed.
    """
    state = front._state
    if state is None:
        raise daos_only(front._factory, "history, documents and reasoning")
    if state.store.is_closed:
        state.store.refuse_closed()
    return state


def creates(create: Callable[[DaoFactory], R]) -> cached_property[R]:
    """Bind a factory method: an attribute with the DAO, which is created on first use."""

    @wraps(create)
    def make(front: Front) -> R:
        return cast(R, getattr(front._factory, create.__name__)())

    make.__doc__ = (create.__doc__ or "").replace("Create the", "The")
    return cached_property(cast(Callable[[Any], R], make))


class _Question:
    """Make the method on first use, and put it in the place of this descriptor."""

    def __init__(self, make: Callable[[], Callable[..., Any]]) -> None:
        self._make = make

    def __set_name__(self, owner: type, name: str) -> None:
        self._place = owner, name

    def __get__(self, front: object, owner: type | None = None) -> Any:
        method = self._make()
        setattr(*self._place, method)
        return method.__get__(front, owner)


def _bound(
    find: Callable[[], Callable[Concatenate[State, P], R]],
    state: Callable[[Front], State],
) -> Callable[Concatenate[Front, P], R]:
    def make() -> Callable[..., R]:
        function = find()

        @wraps(function)
        def ask(self: Front, /, *args: P.args, **kwargs: P.kwargs) -> R:
            return function(state(self), *args, **kwargs)

        return _method(ask)

    return cast("Callable[Concatenate[Front, P], R]", _Question(make))


def reads(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a function of a state: a method with its docstring, arguments and defaults.

    `find` names it. Its module is imported when the method is first asked for.
    """
    return _bound(find, state_of)


def writes(
    find: Callable[[], Callable[Concatenate[State, P], R]],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a function that writes, as `reads`; views of the past refuse it."""
    return _bound(find, _present_of)


def _present_of(front: Front) -> State:
    """Return what functions that write are called on; refuse a view of the past."""
    state = state_of(front)
    if state.at is not None:
        refuse_past(state.store, state.at)
    return state


def delegates(
    method: Callable[Concatenate[DaoFactory, P], R],
) -> Callable[Concatenate[Front, P], R]:
    """Bind a method of the factory, as `reads`."""

    @wraps(method)
    def call(self: Front, /, *args: P.args, **kwargs: P.kwargs) -> R:
        return cast(Callable[P, R], getattr(self._factory, method.__name__))(*args, **kwargs)

    return call


def _method(bound: Callable[..., R]) -> Callable[..., R]:
    """Show `self` in place of the state, to `help` and to who reads annotations."""
    shown = inspect.signature(bound)
    state, *others = shown.parameters.values()
    own = state.replace(name="self", annotation=inspect.Parameter.empty)
    bound.__signature__ = shown.replace(parameters=[own, *others])  # type: ignore[attr-defined]
    hints = bound.__annotations__.items()
    bound.__annotations__ = {name: hint for name, hint in hints if name != state.name}
    return bound
