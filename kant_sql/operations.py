"""What operates a store: verification, anchors, archives, replication, exports, roles, views."""

from __future__ import annotations

from . import history
from .binding import Front, reads, writes
from .factory import DaoFactory
from .history.anchors import Anchor, AnchoredHead, parse_anchor
from .history.archive.archive import Archived
from .history.replication.push import Pushed
from .history.verify.findings import Finding
from .history.verify.verify import Verification
from .sql.catalog import Backup, backup
from .sql.dialects.base import Roles
from .sql.inventory import Inventory, knowledge_bases
from .sql.predicate_views import PredicateView, drop_views, update_views
from .sql.schema import create_roles, downgrade

__all__ = [
    "Anchor",
    "AnchoredHead",
    "Archived",
    "Backup",
    "Finding",
    "Inventory",
    "Operations",
    "PredicateView",
    "Pushed",
    "Roles",
    "Verification",
    "backup",
    "create_roles",
    "downgrade",
    "drop_views",
    "knowledge_bases",
    "parse_anchor",
    "update_views",
]


class Operations(Front):
    """`kb.store`: what operates the store of a knowledge base.

    The functions of this module take the URL of a whole store.
    """

    revisions = reads(lambda: history.log.revisions)
    verify = reads(lambda: history.verify.verify.verify)
    anchor = reads(lambda: history.anchors.anchor)
    archive = writes(lambda: history.archive.archive.archive)
    push = writes(lambda: history.replication.calls.push)
    promote = writes(lambda: history.replication.promote.promote)
    to_arrow = reads(lambda: history.audit.to_arrow)

    @property
    def factory(self) -> DaoFactory:
        """The factory of the DAOs: the family of the store, its address and its name."""
        return self._factory
