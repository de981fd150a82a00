"""Who checks a driver is told of each promise that it breaks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from hw.contract import CAMERA_PROMISES, CameraBench, ContractError, check_camera
from tams_app.records import Frame
from tests.contract.camera_rigs import PatternRig

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]


class Stuttering(PatternRig):
    """Gives each frame the index of the one before."""

    def frames(self, camera: object, count: int) -> list[Frame]:
        frames = super().frames(camera, count)  # type: ignore[arg-type]
        return [replace(frame, index=frames[0].index) for frame in frames]


@contextmanager
def stuttering() -> Iterator[CameraBench]:
    rig = Stuttering()
    with rig.cleaning:
        yield rig


def test_each_promise_that_is_not_kept_is_a_line_with_what_was_seen() -> None:
    with pytest.raises(ContractError) as raised:
        check_camera(stuttering)
    broken = str(raised.value).splitlines()
    assert any(line.startswith("indices and capture times only grow: index ") for line in broken)
    assert any(line.startswith("indices are places on a fixed grid: ") for line in broken)
    assert len(broken) < len(CAMERA_PROMISES)
