"""The operator's window on a virtual screen without a graphics processor: its cost, its picture.

`python -m benchmarks.window cost`: processor time of the window's process, for both of GTK's ways
to draw, with three views of 640x480 at 30 frames a second and facts 10 times a second.
`python -m benchmarks.window picture`: docs/window.jpg, of a session on the simulated rig.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from argparse import ArgumentParser
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import psutil
import pytest

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.client import WINDOW, FaceClient
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.realtime import WINDOW_NICE
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window.facts import FACTS, changed
from tests.faces.window.xvfb import virtual_screen, wait_for

DOCS = Path(__file__).parent.parent / "docs"
VIEWS = Path(__file__).parent.parent / "tests" / "data" / "views"
RENDERERS = {"OpenGL in software": "gl", "cairo": "cairo"}
FPS, SETTLING_S = 30, 6.0


@dataclass(frozen=True, slots=True)
class Cost:
    """What one way to draw took."""

    drawings: float  # a second
    published: float  # frames of each view a second
    share: float  # of one core
    drawing_ms: float  # processor time of the process for each drawing, all else included


def cost(renderer: str, seconds: float, size: tuple[int, int]) -> Cost:
    """The window at `size` for `seconds`, after it has settled."""
    config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
    video = config.video
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        (folder / "state" / "tams").mkdir(parents=True)
        (folder / "state" / "tams" / "window.json").write_text(
            f'{{"width": {size[0]}, "height": {size[1]}}}'
        )
        patch.setenv("GSK_RENDERER", renderer)
        with virtual_screen(folder, patch, *size):
            block = FrameBlock(RingLayout(SHOWN, video.views, video.width, video.height))
            client, stop = FaceClient(MonotonicClock(), WINDOW), threading.Event()
            client.launch(folder)
            client.open(config, block, blind=False)
            hearing = threading.Thread(target=client.body(lambda _event: None), args=(stop,))
            hearing.start()
            try:
                assert wait_for(lambda: client.keys is not None)
                play(client, block, video.views, SETTLING_S)
                return _measured(client, block, video.views, seconds)
            finally:
                stop.set()
                hearing.join()
                client.close()
                block.close()


def _measured(
    client: FaceClient, block: FrameBlock, views: tuple[str, ...], seconds: float
) -> Cost:
    process = psutil.Process(client.pid)
    began_s, before_s, drawn = time.monotonic(), processor_s(process), _drawings(client)
    frames = play(client, block, views, seconds)
    passed_s, used_s = time.monotonic() - began_s, processor_s(process) - before_s
    drawings = _drawings(client) - drawn
    return Cost(
        drawings / passed_s, frames / passed_s, used_s / passed_s, 1000 * used_s / max(drawings, 1)
    )


def play(client: FaceClient, block: FrameBlock, views: tuple[str, ...], seconds: float) -> int:
    """Publish moving pictures, each view at its turn; how many of each."""
    pictures = {view: picture_of(view) for view in views}
    began_s, number = time.monotonic(), 0
    while time.monotonic() - began_s < seconds:
        for place, view in enumerate(views):
            due_s = began_s + (number + place / len(views)) / FPS
            time.sleep(max(0.0, due_s - time.monotonic()))
            block.put(view, number, number, np.roll(pictures[view], 4 * number, axis=1))
        if number % 3 == 0:
            client.show(changed(FACTS, t_s=time.monotonic()))
        number += 1
    return number


def picture_of(view: str) -> Image:
    """A frame of the view, as the rig gave it."""
    image = cv2.imread(str(VIEWS / f"{view}.jpg"))
    return np.asarray(cv2.resize(np.asarray(image), (640, 480)), np.uint8)


def processor_s(process: psutil.Process) -> float:
    """What its threads have used so far."""
    times = process.cpu_times()
    return float(times.user + times.system)


def _drawings(client: FaceClient) -> int:
    return 0 if client.keys is None else client.keys.drawings


def picture(path: Path, at_s: float, options: list[str]) -> None:
    """The window of a session on the simulated rig, `at_s` seconds after it was begun."""
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        folder = Path(name)
        with virtual_screen(folder, patch) as screen:
            with suppress(PermissionError):  # it stands for a screen, which needs no processor
                os.setpriority(os.PRIO_PROCESS, screen.pid, WINDOW_NICE)
            command = [sys.executable, "run_tams.py", "run", "--sim", "--out", name, *options]
            session = subprocess.Popen(command, cwd=DOCS.parent, env=dict(os.environ))
            try:
                time.sleep(at_s)
                window = _window_of(session.pid)
                window.suspend()  # half a drawing is no picture
                time.sleep(0.3)
                cv2.imwrite(str(path), screen.photograph())
                window.resume()
            finally:
                session.terminate()
                session.wait(60)


def _window_of(pid: int) -> psutil.Process:
    (found,) = (
        child
        for child in psutil.Process(pid).children()
        if "tams_app.faces.window.process" in child.cmdline()
    )
    return found


def main() -> None:
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("cost", "picture"))
    parser.add_argument("--seconds", type=float, default=20.0, help="of each measurement")
    parser.add_argument("--at", type=float, default=25.0, help="when the picture is taken [s]")
    parser.add_argument("--to", type=Path, default=DOCS / "window.jpg")
    arguments, options = parser.parse_known_args()
    if arguments.what == "picture":
        picture(arguments.to, arguments.at, options)
        return
    for size in ((1280, 720), (1920, 1080)):
        for name, renderer in RENDERERS.items():
            found = cost(renderer, arguments.seconds, size)
            print(
                f"{size[0]}x{size[1]}, {name}: {found.drawings:.1f} drawings a second of "
                f"{found.published:.1f} frames of each view, {100 * found.share:.0f} % of a core, "
                f"{found.drawing_ms:.1f} ms a drawing"
            )


if __name__ == "__main__":
    main()
