"""The metric: the DAO."""

from __future__ import annotations

from ..dto.formula import Metric
from ..dto.node import shown
from ..errors import InvalidKnowledgeError
from ..knowledge.definitions import Definitions
from ..knowledge.formula import METRIC
from ..transaction import Transaction
from .base import SqlDao
from .formula import make_formula, read_formula, read_formulas
from .formula_interfaces import MetricDao


class SqlMetricDao(SqlDao, MetricDao):
    """The metric in an SQL store."""

    def get(self) -> Metric | None:
        """Read the metric."""

        def work(definitions: Definitions) -> Metric | None:
            stored = read_formulas(definitions, METRIC)
            return read_formula(definitions, stored[0]) if stored else None  # type: ignore[return-value]

        return self._store.read_definitions(work, self._at)

    def set(self, metric: Metric | None) -> bool:
        """Let plans be measured by a metric."""
        self._check_writable()
        if metric is not None and not isinstance(metric, Metric):
            raise InvalidKnowledgeError(
                f"the metric is a node Metric of kant_sql.pddl, or None, not "
                f"{type(metric).__name__}: {shown(metric)}"
            )
        return self._store.write(lambda transaction: put_metric(transaction, metric))


def put_metric(transaction: Transaction, metric: Metric | None) -> bool:
    """Let plans be measured by a metric, instead of another.

    Args:
        transaction: the transaction.
        metric: the metric, or None for none.

    Returns:
        Whether that is a change.
    """
    made = None if metric is None else make_formula(transaction, METRIC, metric)
    changed = False
    for stored in read_formulas(transaction.definitions, METRIC):
        if made is None or stored.id != made.id:
            transaction.undefine("formula", stored.id)
            changed = True
    return (made is not None and transaction.define("formula", made)) or changed
