"""A runtime of each test's own, on which the real binding runs."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.hw.openvr.fake_openvr import FakeRuntime


@pytest.fixture
def fake() -> Iterator[FakeRuntime]:
    with FakeRuntime().in_place_of_the_library() as fake:
        yield fake
