"""What is read of a revision."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Text, and_, cast, select

from ..tables import RevisionPlanStepRow, RevisionRow
from .loading import KB

OWN_COLUMNS: tuple[Any, ...] = (
    RevisionRow.number,
    RevisionRow.committed_at,
    RevisionRow.actor,
    RevisionRow.reason,
    # As text: what a driver makes of a JSON string looks like JSON, and is none.
    cast(RevisionRow.source, Text),
    RevisionRow.hash,
    RevisionRow.observed_at,
)
STEP_COLUMNS: tuple[Any, ...] = RevisionPlanStepRow.plan_id, RevisionPlanStepRow.position
REVISIONS = (
    select(*OWN_COLUMNS, *STEP_COLUMNS)
    .outerjoin(
        RevisionPlanStepRow,
        and_(
            RevisionPlanStepRow.kb_id == RevisionRow.kb_id,
            RevisionPlanStepRow.number == RevisionRow.number,
        ),
    )
    .where(RevisionRow.kb_id == KB)
)
