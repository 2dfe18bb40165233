"""Backups, roles, views and migrations of a whole store, and what `kb.store` returns."""

from __future__ import annotations

from .history.anchors import Anchor, AnchoredHead, parse_anchor
from .history.archive.archive import Archived
from .history.erasure.erase import Erased
from .history.erasure.preview import ErasurePreview, Mention
from .history.erasure.retention import RetentionRule
from .history.replication.push import Pushed
from .history.verify.sides import Finding
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
    "Erased",
    "ErasurePreview",
    "Finding",
    "Inventory",
    "Mention",
    "PredicateView",
    "Pushed",
    "RetentionRule",
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
