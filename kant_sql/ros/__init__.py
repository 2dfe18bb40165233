"""ROS 2: a node that answers KANT's and PlanSys2's services, and what needs no ROS around it.

`kant-sql ros` starts the node. `import_bag` makes revisions of a recording of it; `follow` gives a
node of yours each revision.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..later import asked_for

if TYPE_CHECKING:
    from .bags import Imported, import_bag
    from .listener import Follower, follow
else:
    __getattr__ = asked_for(
        __name__,
        {".bags": ("Imported", "import_bag"), ".listener": ("Follower", "follow")},
    )

__all__ = ["Follower", "Imported", "follow", "import_bag"]
