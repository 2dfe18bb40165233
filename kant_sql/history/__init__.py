"""The past: revisions, their changes, and their verification."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for

if TYPE_CHECKING:
    from ..dao.interfaces import Progress
    from ..moment_text import When
    from . import anchors as anchors
    from . import archive as archive
    from . import audit as audit
    from . import diff as diff
    from . import follow as follow
    from . import log as log
    from . import overview as overview
    from . import replication as replication
    from . import restore as restore
    from . import timeline as timeline
    from . import verify as verify
    from . import versions as versions
    from .anchors import Anchor, AnchoredHead, parse_anchor
    from .archive.archive import Archived
    from .elements import Element
    from .revisions import LogEntry, Revision, RunningStep
    from .verify.findings import Finding
    from .verify.verify import Verification
    from .versions import Version
else:
    __getattr__ = asked_for(
        __name__,
        {
            "..dao.interfaces": ("Progress",),
            "..moment_text": ("When",),
            ".anchors": ("Anchor", "AnchoredHead", "parse_anchor"),
            ".archive.archive": ("Archived",),
            ".elements": ("Element",),
            ".revisions": ("LogEntry", "Revision", "RunningStep"),
            ".verify.findings": ("Finding",),
            ".verify.verify": ("Verification",),
            ".versions": ("Version",),
        },
    )

__all__ = [
    "Anchor",
    "AnchoredHead",
    "Archived",
    "Element",
    "Finding",
    "LogEntry",
    "Progress",
    "Revision",
    "RunningStep",
    "Verification",
    "Version",
    "When",
    "parse_anchor",
]
