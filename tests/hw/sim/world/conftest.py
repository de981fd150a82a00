"""Memory of a rig of each test's own, with small frames."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hw.sim.viewpoints import VIEWS
from hw.sim.world.rig_memory import FrameShape, FrameWriter, remove_memory
from tams_app.runtime.shared_ring import new_block_name

SHAPE = FrameShape(VIEWS, 16, 8)


@pytest.fixture
def name() -> Iterator[str]:
    name = new_block_name()
    yield name
    remove_memory(name)


@pytest.fixture
def writer(name: str) -> Iterator[FrameWriter]:
    writer = FrameWriter(name, SHAPE)
    yield writer
    writer.close()
