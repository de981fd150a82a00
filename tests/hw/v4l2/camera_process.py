"""The side of `fake_cameras.CameraProcess` that has the played V4L2 devices preloaded."""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any

from hw.gstreamer.camera import GstCamera
from hw.v4l2.devices import CameraInfo, list_cameras
from hw.v4l2.source import V4l2Source
from tams_app.config import CameraConfig, VideoConfig
from tams_app.errors import TamsError
from tams_app.runtime.clock import MonotonicClock


class Server:
    """Cameras by number, each with the notes it has made."""

    def __init__(self, dev: Path, sys: Path) -> None:
        self._dev, self._sys = dev, sys
        self._cameras: list[GstCamera] = []
        self._notes: list[list[tuple[str, str]]] = []

    def answer(self, kind: str, *arguments: Any) -> Any:
        return getattr(self, f"_{kind}")(*arguments)

    def _list(self) -> list[CameraInfo]:
        return list_cameras(self._dev, self._sys)

    def _make(self, view: str, config: CameraConfig, video: VideoConfig) -> int:
        notes: list[tuple[str, str]] = []
        source = V4l2Source(view, config, video, self._list)
        note = lambda level, text: notes.append((level, text))  # noqa: E731
        self._cameras.append(GstCamera(view, source, video, MonotonicClock(), note))
        self._notes.append(notes)
        return len(self._cameras) - 1

    def _do(self, number: int, name: str, arguments: tuple[Any, ...]) -> Any:
        return getattr(self._cameras[number], name)(*arguments)

    def _notes_of(self, number: int) -> list[tuple[str, str]]:
        return self._notes[number]


def main() -> None:
    server = Server(Path(sys.argv[1]), Path(sys.argv[2]))
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            answer: tuple[str, Any] = ("", server.answer(*request))
        except TamsError as error:
            answer = (type(error).__name__, str(error))
        pickle.dump(answer, sys.stdout.buffer)
        sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
