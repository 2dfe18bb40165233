"""The values of functions that a transaction touches."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from .backends import Row
from .dto.pddl_function_value_dto import value_text
from .fluents import Fluent, FluentCache, FluentKey, FluentValue, HeldValue, read_value, version_row
from .knowledge.changes import ASSERTED, RETRACTED, VALUE, Change
from .knowledge.function_value import FIND, OPEN, VERSIONS
from .knowledge.rows import table_of
from .tables import FunctionValueArgumentRow, FunctionValueRow

if TYPE_CHECKING:
    from .transaction import Transaction

_Values = dict[int, FluentValue | None]


class PendingFunctionValues:
    """The values of functions that a transaction has touched; None stands for no value.

    Attributes:
        pending: fluent id -> what it is to be, of what is not written yet.
    """

    def __init__(self, transaction: Transaction, cache: FluentCache) -> None:
        self._transaction = transaction
        self._cache = cache
        self._cached = cache.at(transaction.head.revision)
        self._known: dict[FluentKey, Fluent] = {}
        self._fluents: dict[int, Fluent] = {}
        self._new: dict[int, Fluent] = {}
        # What a fluent was before this revision, and what the tables say, where it is not that.
        self._origin: _Values = {}
        self._written: _Values = {}
        self.pending: _Values = {}

    @property
    def is_untouched(self) -> bool:
        """Whether no fluent came to be in the transaction so far."""
        return not self._known

    def find(self, keys: Collection[FluentKey]) -> dict[FluentKey, Fluent]:
        """Find the identities of fluents, with one statement for each function at most.

        Args:
            keys: what to find.

        Returns:
            Those that were ever known.
        """
        found: dict[FluentKey, Fluent] = {}
        missing: dict[int, list[str]] = {}
        for key in keys:
            fluent = self._known.get(key) or self._cache.identities.get(key)
            if fluent is not None:
                found[key] = fluent
            # A function that is new in this transaction has no fluents but those that are known.
            elif key.function_id < self._transaction.head.next_id:
                missing.setdefault(key.function_id, []).append(key.arguments)
        session, assign = self._transaction.session, self._transaction.assign
        for function_id, arguments in missing.items():
            rows = session.rows(
                FIND,
                kb=self._transaction.kb_id,
                function=function_id,
                arguments=session.list_value(arguments),
            )
            for id_, text_arguments, text, held, object_id in rows:
                fluent = Fluent(id_, FluentKey(function_id, text_arguments), text)
                found[fluent.key] = fluent
                assign(self._known, fluent.key, fluent)
                if id_ not in self._origin:
                    assign(self._origin, id_, _value(fluent, held, object_id))
        return found

    def look_at(self, fluents: Iterable[Fluent]) -> None:
        """Read what fluents are, in one statement for all of them.

        Args:
            fluents: the fluents.
        """
        unknown: dict[int, Fluent] = {}
        for fluent in fluents:
            if fluent.id not in self._origin:
                if fluent.id in self._cached:
                    value = self._cached[fluent.id]
                    self._transaction.assign(self._origin, fluent.id, value)
                else:
                    unknown[fluent.id] = fluent
        if unknown:
            session = self._transaction.session
            ids = session.list_value([*unknown])
            for id_, held, object_id in session.rows(OPEN, kb=self._transaction.kb_id, ids=ids):
                value = _value(unknown[id_], held, object_id)
                self._transaction.assign(self._origin, id_, value)

    def value(self, fluent: Fluent) -> FluentValue | None:
        """Give what a fluent is, as changed so far.

        Args:
            fluent: the fluent, as `find` gave it.

        Returns:
            Its value; None when it has none.
        """
        self.look_at((fluent,))
        return self._now(fluent.id)

    def _now(self, id_: int) -> FluentValue | None:
        for values in (self.pending, self._written):
            if id_ in values:
                return values[id_]
        return self._origin[id_]

    def set(self, fluent: Fluent, value: FluentValue | None) -> bool:
        """Let a fluent be something else.

        Args:
            fluent: the fluent.
            value: its new value; None for none.

        Returns:
            Whether that is a change.
        """
        now = self.value(fluent)
        if now is None if value is None else value.is_same(now):
            return False
        origin = self._origin[fluent.id]
        # What is set back is what it was, down to the spelling.
        return self.put(fluent, origin if value and value.is_same(origin) else value)

    def put(self, fluent: Fluent, value: FluentValue | None) -> bool:
        """Let a fluent be something in just this spelling: 10.0 instead of 10.

        Args:
            fluent: the fluent.
            value: its new value; None for none.

        Returns:
            Whether that is a change.
        """
        if self.value(fluent) == value:
            return False
        self._transaction.assign(self._fluents, fluent.id, fluent)
        self._transaction.assign(self.pending, fluent.id, value)
        return True

    def _add_all(self, values: Mapping[FluentKey, tuple[str, FluentValue]]) -> None:
        """Give fluents their first values ever, and make their identities."""
        ids = self._transaction.allocate_many(len(values))
        texts = (text for text, _ in values.values())
        fluents = dict(zip(ids, map(Fluent, ids, values, texts), strict=True))
        for part, entries in (
            (self._known, dict(zip(values, fluents.values(), strict=True))),
            (self._fluents, fluents),
            (self._new, fluents),
            (self._origin, dict.fromkeys(ids)),
            (self.pending, dict(zip(ids, (each for _, each in values.values()), strict=True))),
        ):
            self._transaction.assign_all(part, entries)

    def set_many(
        self,
        values: Collection[tuple[FluentKey, str, FluentValue]],
        old: Collection[FluentKey] | None = None,
    ) -> int:
        """Give fluents their values, with statements only for each function.

        Args:
            values: what makes each fluent the one that it is, its canonical PDDL text without the
                value, and the value; of one fluent, the last one counts.
            old: the fluents that the tables may know; None for all.

        Returns:
            How many of them were changes.
        """
        found = self.find({key for key, _, _ in values} if old is None else old)
        self.look_at(found.values())
        changed = 0
        new: dict[FluentKey, tuple[str, FluentValue]] = {}
        for key, text, value in values:
            fluent = found.get(key)
            if fluent is not None:
                changed += self.set(fluent, value)
            elif key not in new or not value.is_same(new[key][1]):
                new[key] = text, value
                changed += 1
        self._add_all(new)
        return changed

    def unset(self, held: Iterable[HeldValue]) -> None:
        """Let fluents have no value any more.

        Args:
            held: the fluents with their values, as the tables have them.
        """
        for fluent, value in held:
            if fluent.id not in self._origin:
                self._transaction.assign(self._origin, fluent.id, value)
            self._transaction.assign(self._known, fluent.key, fluent)
            self.set(fluent, None)

    def changes(self) -> Iterator[Change]:
        """Give what the transaction has changed so far.

        Yields:
            The changes, in no order.
        """
        for id_, fluent in self._fluents.items():
            before, now = self._origin[id_], self._now(id_)
            if before != now:
                for sign, value in ((RETRACTED, before), (ASSERTED, now)):
                    if value is not None:
                        yield Change(sign, VALUE, value_text(fluent.text, value.text))

    def write(self) -> None:
        """Write what is pending."""
        transaction = self._transaction
        kb, number, session = transaction.kb_id, transaction.number, transaction.session
        self._write_identities()
        inserts: list[Row] = []
        closed: list[int] = []
        unmade: list[int] = []
        reopened: list[int] = []
        for id_, now in self.pending.items():
            origin = self._origin[id_]
            before = self._written.get(id_, origin)
            if now == before:
                continue
            if before is not None and before == origin:
                closed.append(id_)
            elif before is not None:
                unmade.append(id_)
            if now is not None and now == origin:
                reopened.append(id_)
            elif now is not None:
                inserts.append(version_row(kb, number, self._fluents[id_], now))
            self._written[id_] = now
        session.run_for(VERSIONS.close, closed, kb=kb, at=number)
        session.run_for(VERSIONS.unmake, unmade, kb=kb)
        session.run_for(VERSIONS.reopen, reopened, kb=kb, at=number)
        session.insert(VERSIONS.table, inserts)
        self.pending.clear()

    def _write_identities(self) -> None:
        session, kb = self._transaction.session, self._transaction.kb_id
        new = self._new.values()
        session.insert(
            table_of(FunctionValueRow),
            [(kb, id_, key.function_id, key.arguments, text) for id_, key, text in new],
        )
        session.insert(
            table_of(FunctionValueArgumentRow),
            [
                (kb, id_, position, int(object_id))
                for id_, key, _ in new
                for position, object_id in enumerate(key.arguments.split())
            ],
        )
        self._new.clear()

    def state(self) -> list[dict[Any, Any]]:
        """Give the parts of the state, for the transaction to undo."""
        return [
            self._known,
            self._fluents,
            self._new,
            self._origin,
            self._written,
            self.pending,
        ]

    def publish(self, revision: int) -> None:
        """Let later transactions know what this one has learned, once it has ended well.

        Args:
            revision: the head after it.
        """
        cache, head = self._cache, self._transaction.head
        made = revision != head.revision
        # Without a revision, the ids that it gave out are nobody's.
        cache.know(
            {key: each for key, each in self._known.items() if made or each.id < head.next_id}
        )
        news = {
            id_: self._now(id_) if made else origin
            for id_, origin in self._origin.items()
            if made or id_ < head.next_id
        }
        cache.learn(self._cached, head.revision, revision, news)


def _value(fluent: Fluent, held: str | None, object_id: int | None) -> FluentValue | None:
    """Read a value from its canonical text, which is between that of its fluent and the end."""
    return None if held is None else read_value(fluent.text, held, object_id)
