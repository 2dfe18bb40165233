"""What tests of preserved meaning share."""

from __future__ import annotations

import pytest

from tests.meaning.material import Workshop


@pytest.fixture(scope="session")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Workshop:
    """Our text of pairs, made once each."""
    return Workshop(tmp_path_factory.mktemp("ours"))
