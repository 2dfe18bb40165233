"""Tokens of programs and their rights, in a file that keeps only their hashes."""

from __future__ import annotations

import fcntl
import hashlib
import hmac
import json
import logging
import os
import secrets
import stat
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from ..arguments import one_of, shown
from ..errors import InvalidArgumentError, UnknownNameError, printable
from ..knowledge.canonical import make_metadata, time_text

logger = logging.getLogger("kant_sql.web")

SCOPES = ("read", "write", "apply", "verify")
ALL = "*"
# With 256 bits, even a hash without salt and work factor allows no guessing.
_SECRET_BYTES = 32
# Bytes of a token's id: its first characters, which are no secret; a dot follows.
_ID_BYTES = 4


@dataclass(frozen=True)
class Token:
    """The rights of a program.

    Attributes:
        id: its name in the log and for `revoke`; the beginning of the token.
        actor: the actor of its writes.
        knowledge_bases: the names of its knowledge bases; `*` for all.
        scopes: `read`, `write`, `apply`, `verify`.
        sha256: the hash of the whole token.
        created_at: when it was created.
        revoked_at: when it was revoked; None if it is valid.
    """

    id: str
    actor: str
    knowledge_bases: tuple[str, ...]
    scopes: tuple[str, ...]
    sha256: str
    created_at: str
    revoked_at: str | None = None

    @property
    def is_for_all(self) -> bool:
        """Whether it is for all knowledge bases of a store."""
        return ALL in self.knowledge_bases

    def is_for(self, name: str) -> bool:
        """Return whether it is for a knowledge base."""
        return self.is_for_all or name in self.knowledge_bases


class TokenFile:
    """The tokens of a file, which is read again when it changes. Threads may share it."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        self._lock = threading.Lock()
        self._seen: tuple[int, ...] | None = None
        self._tokens: dict[str, Token] = {}

    def tokens(self) -> list[Token]:
        """Return all tokens, including revoked ones, the oldest first.

        Raises:
            InvalidArgumentError: the file is not a file of tokens.
            OSError: the file cannot be read.
        """
        return [*self._by_id().values()]

    def _by_id(self) -> dict[str, Token]:
        with self._lock:
            stat = self._path.stat()
            seen = stat.st_mtime_ns, stat.st_size, stat.st_ino
            if seen != self._seen:
                self._tokens = {one.id: one for one in _read(self._path)}
                self._seen = seen
            return self._tokens

    def find(self, given: str) -> Token | None:
        """Return the token of a request; None if it is unknown or revoked.

        If the file cannot be read, no token is known.
        """
        token = self.made(given)
        # Older releases accepted an empty name, which gives no rights to check.
        if token is None or token.revoked_at is not None or not all(token.knowledge_bases):
            return None
        return token

    def made(self, given: str) -> Token | None:
        """Return the token of a request, even a revoked one."""
        token = self._known().get(given.partition(".")[0])
        expected = "" if token is None else token.sha256
        return token if hmac.compare_digest(_hash(given), expected) else None

    def has(self, token: Token) -> bool:
        """Return whether a token still has the rights that it had."""
        return self._known().get(token.id) == token

    def _known(self) -> dict[str, Token]:
        try:
            return self._by_id()
        except (OSError, InvalidArgumentError) as error:
            logger.error("no token is accepted: %s", error)
            return {}

    def add(self, actor: str, knowledge_bases: Iterable[str], scopes: Iterable[str]) -> str:
        """Create a token.

        Args:
            actor: the actor of its writes.
            knowledge_bases: the names of its knowledge bases; `*` for all.
            scopes: `read`, `write`, `apply`, `verify`.

        Returns:
            The token, which is never shown again.

        Raises:
            InvalidArgumentError: there is no such scope, none is given, or a name is empty.
        """
        make_metadata(actor, None, None)
        names = tuple(knowledge_bases)
        chosen = tuple(one_of(scope, SCOPES, "a scope") for scope in dict.fromkeys(scopes))
        if not (names and all(names) and chosen and actor):
            raise InvalidArgumentError(
                "a token needs an actor, a knowledge base (* for all) and a scope: "
                + ", ".join(SCOPES)
            )
        id_ = secrets.token_hex(_ID_BYTES)
        secret = f"{id_}.{secrets.token_urlsafe(_SECRET_BYTES)}"
        made = Token(id_, actor, names, chosen, _hash(secret), time_text(datetime.now(UTC)))
        with self._changing() as folder:
            self._write(folder, [*(self.tokens() if self._path.exists() else ()), made])
        return secret

    def revoke(self, id: str) -> Token:
        """Revoke a token from now on; running servers see this at the next request.

        Raises:
            UnknownNameError: there is no token with this id.
        """
        with self._changing() as folder:
            tokens = self.tokens()
            found = next((one for one in tokens if one.id == id), None)
            if found is None:
                raise UnknownNameError(
                    f"{self._path} has no token {shown(id)}; 'kant-sql tokens list' shows the ids"
                )
            now = found.revoked_at or time_text(datetime.now(UTC))
            revoked = replace(found, revoked_at=now)
            self._write(folder, [revoked if one is found else one for one in tokens])
        return revoked

    @contextmanager
    def _changing(self) -> Iterator[int]:
        """Let one process at a time change the file, so none undoes another's revocation."""
        folder = os.open(self._path.resolve().parent, os.O_RDONLY)
        try:
            fcntl.flock(folder, fcntl.LOCK_EX)
            yield folder
        finally:
            os.close(folder)

    def _write(self, folder: int, tokens: Iterable[Token]) -> None:
        """Write the file in one step; only the owner may read a new one."""
        # A link stays a link: servers may know the file by its other name.
        path = self._path.resolve()
        beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
        text = json.dumps({"tokens": [asdict(one) for one in tokens]}, indent=2)
        try:
            with open(beside, "x", opener=lambda path, flags: os.open(path, flags, 0o600)) as file:
                if path.exists():
                    _share_alike(path, file.fileno())
                file.write(f"{text}\n")
                file.flush()
                os.fsync(file.fileno())
            beside.replace(path)
            # Without this, a power cut can bring a revoked token back.
            os.fsync(folder)
        finally:
            beside.unlink(missing_ok=True)


def _share_alike(path: Path, made: int) -> None:
    """Give a new file the owner, group and mode of the replaced one, which a server may read."""
    before, now = path.stat(), os.fstat(made)
    try:
        if (before.st_uid, before.st_gid) != (now.st_uid, now.st_gid):
            os.fchown(made, before.st_uid, before.st_gid)
        os.fchmod(made, stat.S_IMODE(before.st_mode))
    except PermissionError as error:
        raise InvalidArgumentError(
            f"{path} belongs to another user, whose servers could not read it then; nothing was "
            "changed: run the command as that user"
        ) from error


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode("utf-8", "replace")).hexdigest()


def _read(path: Path) -> list[Token]:
    try:
        return [_token(one) for one in json.loads(path.read_bytes())["tokens"]]
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError) as error:
        raise InvalidArgumentError(
            f"{path} is not a file of tokens ({type(error).__name__}: {printable(str(error))}); "
            "make one with 'kant-sql tokens add'"
        ) from error


def _token(written: dict[str, object]) -> Token:
    texts, lists = ("id", "actor", "sha256", "created_at"), ("knowledge_bases", "scopes")
    id_, actor, sha256, created_at = (str(written[name]) for name in texts)
    names, scopes = (tuple(map(str, _list(written[name]))) for name in lists)
    revoked_at = written.get("revoked_at")
    revoked = None if revoked_at is None else str(revoked_at)
    return Token(id_, actor, names, scopes, sha256, created_at, revoked)


def _list(value: object) -> list[object]:
    # A text would count as a list of letters, one of which may be `*`.
    if not isinstance(value, list):
        raise TypeError(f"{shown(value)} is not a list")
    return value
