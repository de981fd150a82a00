"""The cameras' wizard in a process with played V4L2 devices, and a person who waves before them."""

from __future__ import annotations

import ctypes
import json
import mmap
import sys
from functools import partial
from pathlib import Path

from calibration.cameras import binding
from calibration.cameras.bench import LiveBench
from calibration.cameras.wizard import CameraWizard
from calibration.options import CameraOptions
from hw.v4l2.devices import list_cameras
from tams_app.config import load_config
from tams_app.runtime.clock import MonotonicClock
from tests.hw.v4l2.fake_cameras import FakeCamera
from tests.scripted_ui import ScriptedUI

STILL, ALL = 32, 64  # images of a played camera: at rest; then those with a hand


class WavingUI(ScriptedUI):
    """Waves before the camera that it is asked to; its images then have a hand."""

    def __init__(self, played: dict[str, FakeCamera]) -> None:
        super().__init__(["y"], presses=100)  # write
        self._played = played

    def print(self, text: str) -> None:
        super().print(text)
        for camera in self._played.values():
            camera.frame_count = STILL
        for view, camera in self._played.items():
            if text.startswith("Wave") and f"({view.upper()})" in text:
                camera.frame_count = ALL


def played_camera(node: Path) -> FakeCamera:
    with node.open("r+b") as file:
        return FakeCamera.from_buffer(mmap.mmap(file.fileno(), ctypes.sizeof(FakeCamera)))


def main() -> None:
    """Arguments: folders of /dev and /sys, configuration, JSON of files by view."""
    dev, sys_folder, config = (Path(argument) for argument in sys.argv[1:4])
    played = json.loads(sys.argv[4])
    binding._REST_S = 1.0
    ui = WavingUI({view: played_camera(Path(at)) for view, at in played.items()})

    settings, find = load_config(config), partial(list_cameras, dev, sys_folder)
    bench = LiveBench(settings.video, settings.arm, MonotonicClock(), find)
    code = CameraWizard(ui, CameraOptions(config=config, only="which"), bench).run()
    print("\n".join(ui.said))  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    main()
