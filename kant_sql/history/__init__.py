"""The past: revisions, their changes, and their verification."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for

if TYPE_CHECKING:
    from ..arguments import Progress
    from ..moment_text import When
    from . import anchors as anchors
    from . import archive as archive
    from . import confirmations as confirmations
    from . import corrections as corrections
    from . import diff as diff
    from . import erasure as erasure
    from . import follow as follow
    from . import log as log
    from . import merge as merge
    from . import overview as overview
    from . import replication as replication
    from . import restore as restore
    from . import timeline as timeline
    from . import verify as verify
    from . import versions as versions
    from .elements import Element
    from .revisions import ExecutionId
else:
    __getattr__ = asked_for(
        __name__,
        {
            "..arguments": ("Progress",),
            "..moment_text": ("When",),
            ".elements": ("Element",),
            ".revisions": ("ExecutionId",),
        },
    )

__all__ = ["Element", "ExecutionId", "Progress", "When"]
