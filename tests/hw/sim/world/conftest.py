"""Memory of a rig of each test's own."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hw.sim.world.rig_memory import FrameWriter, remove_memory
from tams_app.runtime.shared_ring import new_block_name


@pytest.fixture
def name() -> Iterator[str]:
    name = new_block_name()
    yield name
    remove_memory(name)


@pytest.fixture
def writer(name: str) -> Iterator[FrameWriter]:
    writer = FrameWriter(name)
    yield writer
    writer.close()
