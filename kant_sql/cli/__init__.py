"""The command line `kant-sql`, one module for each topic.

What needs SQLAlchemy is imported by the functions that use it: `kant-sql check` and the help run
without it.
"""

from __future__ import annotations
