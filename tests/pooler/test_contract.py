"""Contract tests through PgBouncer: those of what a session keeps for several statements.

All others run there with its URL in `KANT_SQL_TEST_URLS`.
"""

from __future__ import annotations

from tests.contract.test_dao_bulk import *  # noqa: F403
from tests.contract.test_dao_programs import *  # noqa: F403
from tests.contract.test_dao_transactions import *  # noqa: F403
from tests.contract.test_limits import *  # noqa: F403
