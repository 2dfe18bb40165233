"""Knowledge bases with the DAOs of a server; all other questions go to its store."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import kant_sql
from kant_sql import DaoFactory, KnowledgeBase
from kant_sql.web.tokens import TokenFile
from tests.support.reading import SameStore
from tests.support.serving import running

# The actor of the DAO tests.
ACTOR = "test"


class Served(NamedTuple):
    """A store that a server writes to, and the server's address."""

    url: str
    address: str
    tokens: TokenFile
    secret: str

    def at(self, name: str, secret: str | None = None) -> str:
        """Return the URL of a knowledge base, with a token."""
        return f"{self.address.replace('://', f'://:{secret or self.secret}@')}/{name}"


@contextmanager
def served(url: str, folder: Path, certificate: Path | None = None) -> Iterator[Served]:
    """Serve a store, with a token for all of it, until the block ends."""
    tokens = TokenFile(folder / "tokens.json")
    secret = tokens.add(ACTOR, ["*"], ["read", "write"])
    with running(url, tokens=tokens, certificate=certificate) as address:
        yield Served(url, address, tokens, secret)


class _MixedFactory(SameStore):
    """The DAOs of a server, on its store; tests that need missing methods are skipped."""

    remote: DaoFactory

    def transaction(self, **said: Any) -> Any:
        return self.remote.transaction(**said)

    def at(self, *moments: Any, **named: Any) -> Any:
        past = super().at(*moments, **named)
        past.remote = self.remote.at(*moments, **named)
        return past

    def close(self) -> None:
        self.remote.close()


for _name in DaoFactory.__abstractmethods__ - {"__init__", "create_plan_dao"}:
    setattr(_MixedFactory, _name, lambda self, name=_name: getattr(self.remote, name)())


def beside(server: Served, first: KnowledgeBase, name: str) -> KnowledgeBase:
    """Return a knowledge base of a server; `first` is another one of the same store."""
    mixed = _MixedFactory(first.store.factory, name, ACTOR)
    mixed.remote = kant_sql.create_dao_factory(server.at(name.replace(" ", "%20")))
    return KnowledgeBase(mixed)
