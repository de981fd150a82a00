"""A process that has played V4L2 devices preloaded, and the cameras in it."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.managers import BaseManager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hw.gstreamer.camera import GstCamera
from hw.v4l2.devices import CameraInfo, list_cameras
from hw.v4l2.source import V4l2Source
from tams_app.config import CameraConfig, VideoConfig
from tams_app.runtime.clock import MonotonicClock
from tests.hw.v4l2.fake_cameras import SMALL, Machine, build_library


class NotedCamera(GstCamera):
    """A V4L2 camera that keeps its notes."""

    def __init__(
        self, dev: Path, sys: Path, config: CameraConfig, view: str, video: VideoConfig
    ) -> None:
        self._noted: list[tuple[str, str]] = []
        source = V4l2Source(view, config, video, lambda: list_cameras(dev, sys))
        note = lambda level, text: self._noted.append((level, text))  # noqa: E731
        super().__init__(view, source, video, MonotonicClock(), note)

    def notes(self) -> list[tuple[str, str]]:
        return self._noted


class _Manager(BaseManager):
    pass


_Manager.register("camera", NotedCamera, exposed=("start", "next_frame", "close", "notes"))
_Manager.register("list_cameras", list_cameras)


class CameraProcess:
    def __init__(self, machine: Machine, manager: BaseManager) -> None:
        self.machine = machine
        self._manager: Any = manager

    def cameras(self) -> list[CameraInfo]:
        found = self._manager.list_cameras(self.machine.dev, self.machine.sys)
        return list(found._getvalue())

    def camera(self, config: CameraConfig, view: str = "gt") -> Any:
        """A `NotedCamera` over there."""
        return self._manager.camera(self.machine.dev, self.machine.sys, config, view, SMALL)


@contextmanager
def camera_process(folder: Path, machine: Machine | None = None) -> Iterator[CameraProcess]:
    """A process with the cameras of `machine`, by default one without any."""
    machine = machine or Machine(folder)
    preloaded = {"LD_PRELOAD": str(build_library(folder)), "TAMS_FAKE_V4L2": str(machine.dev)}
    manager = _Manager(ctx=multiprocessing.get_context("spawn"))
    with patch.dict(os.environ, preloaded, G_DEBUG="fatal-warnings"):
        manager.start()
    with manager:
        yield CameraProcess(machine, manager)
