"""The command line `kant-sql`, one module for each topic.

Functions import SQLAlchemy when they need it: `kant-sql check` and the help run without it.
"""

from __future__ import annotations
