"""ROS 2: a node with KANT's and PlanSys2's services, and tools that need no ROS.

`kant-sql ros` starts the node. `import_bag` converts a recording of it to revisions; `follow`
delivers each revision to your node.
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
