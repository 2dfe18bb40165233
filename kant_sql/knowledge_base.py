"""The front door: a knowledge base, with a DAO for each PDDL element."""

from __future__ import annotations

from typing import Self

from typing_extensions import override

from . import html
from .arguments import expect
from .dao.interfaces import forwarding
from .documents.interfaces import Exchange
from .errors import InvalidArgumentError
from .factory import Connection, DaoFactory, Daos, create_dao_factory
from .history.interfaces import History
from .moment_text import When
from .reasoning.interfaces import Reasoning

# Revisions that a notebook shows of a knowledge base.
_LATEST = 5


@forwarding(factory=Connection, _exchange=Exchange, _history=History, _reasoning=Reasoning)
class KnowledgeBase(Daos, Exchange, History, Reasoning, Connection):
    """A robot's knowledge: its present state, its history, and its documents.

    Threads may share it. Use it as a context manager, or call `close`.

    Attributes:
        factory: the factory of the DAOs.
    """

    def __init__(self, factory: DaoFactory) -> None:
        """Create the DAOs.

        Args:
            factory: the factory; the knowledge base owns it.
        """
        self.factory = expect(factory, DaoFactory, "the factory", InvalidArgumentError)
        self._exchange = factory.create_exchange()
        self._history = factory.create_history()
        self._reasoning = factory.create_reasoning()
        self._create(factory)

    @override
    def at(self, when: When) -> Self:
        return type(self)(self.factory.at(when))

    @override
    def branch(
        self,
        name: str | None = None,
        *,
        at: When | None = None,
        url: str | None = None,
    ) -> Self:
        return type(self)(self.factory.branch(name, at=at, url=url))

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.factory.label}>"

    def _repr_html_(self) -> str:
        return html.guarded(self._shown)

    def _shown(self) -> str:
        """Write what the state holds, and who changed it last."""
        head = self.revision
        last = [each._html_row_() for each in self.revisions(after=max(0, head - _LATEST))][::-1]
        latest = html.heading("The latest revisions") + html.table(last) if last else ""
        counts = {"revision": head, **self._overview()._asdict()}
        return html.heading(self.factory.label) + html.fields(counts) + latest

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def connect(
    url: str,
    *,
    knowledge_base: str = "default",
    actor: str | None = None,
    read_only: bool = False,
) -> KnowledgeBase:
    """Open a knowledge base.

    Args:
        url: the database URL: `sqlite:///robot.db` for a file, `sqlite://` for a store in memory,
            `postgresql://user@host/database` for a server.
        knowledge_base: the knowledge base's name; the first write creates it.
        actor: who writes, by default.
        read_only: whether the database is to refuse all writes of these connections; each raises
            `ReadOnlyError`. Nothing is created then, so that the store has to exist.

    Returns:
        The knowledge base. A new SQLite file, or a store in memory, is created.

    Raises:
        InvalidUrlError: the URL is not valid, or no DAO family supports it.
        SchemaMissingError: the database has no kant_sql tables.
        SchemaOutdatedError: migrations are pending.
        SchemaTooNewError: the tables are of a newer version of the library.
        StoreError: the database cannot be opened.

    Examples:
        The examples of this reference continue from here.

        >>> import kant_sql
        >>> from kant_sql import PddlObjectDto, PddlPredicateDto, PddlPropositionDto, PddlTypeDto
        >>> robot, wp = PddlTypeDto("robot"), PddlTypeDto("wp")
        >>> robot_at = PddlPredicateDto("robot_at", [robot, wp])
        >>> rb1 = PddlObjectDto(robot, "rb1")
        >>> wp1, wp2 = PddlObjectDto(wp, "wp1"), PddlObjectDto(wp, "wp2")
        >>> kb = kant_sql.connect("sqlite://", knowledge_base="tiago", actor="perception")
        >>> kb.propositions.save(PddlPropositionDto(robot_at, [rb1, wp1]))
        True
        >>> kb.revision
        1
    """
    return KnowledgeBase(
        create_dao_factory(url, knowledge_base=knowledge_base, actor=actor, read_only=read_only)
    )
