"""What the tests of all faces share."""

from __future__ import annotations

import pytest

from tams_app.records import Image
from tests.rig_views import stored_views


@pytest.fixture(scope="session")
def pictures() -> dict[str, Image]:
    """A frame of each view, as the rig's cameras gave it."""
    return stored_views()
