"""How old a frame is when the window has drawn it, on a virtual screen without graphics processor.

`python -m benchmarks.window_delay`: three views of 640x480 at 30 frames a second, which another
process puts into the frames' memory. Everything runs in this process and its children, so that
`chrt -r 1` gives them a machine that others use as well.
"""

from __future__ import annotations

import multiprocessing
import time
from argparse import ArgumentParser
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.window import FPS, RENDERERS, picture_of
from tams_app.faces.messages import Facts
from tams_app.faces.window.size_memory import Size
from tams_app.faces.window.toolkit import load
from tams_app.faces.window.window import OperatorWindow
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.shared_ring import open_block
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, FrameReader, RingLayout
from tests.faces.window.facts import FACTS, OPENING, changed
from tests.faces.window.xvfb import virtual_screen

SETTLING_S = 4.0
FACTS_NS = NS_PER_S // 10
SIZE = Size(1280, 720, False)


class PlayedFacts:
    """Facts of a session in full swing, ten times a second."""

    def __init__(self) -> None:
        self._told_ns = 0

    def newer(self) -> Facts | None:
        now_ns = time.monotonic_ns()
        if now_ns - self._told_ns < FACTS_NS:
            return None
        self._told_ns = now_ns
        facts = changed(FACTS, t_s=now_ns / NS_PER_S, now_ns=now_ns, heard_ns=now_ns)
        return replace(facts, reported_ns=now_ns)


class NotedWindow(OperatorWindow):
    """Keeps of each frame of the large picture when it was put and when it was drawn [ns]."""

    drawn: list[tuple[int, int]]

    def _painted(self) -> None:
        if self._put_ns:
            self.drawn.append((self._put_ns, time.monotonic_ns()))
        super()._painted()


def play(block: FrameBlock) -> None:
    """Publish moving pictures, each view at its turn, until this process is ended."""
    views = block.layout.views
    pictures = {view: picture_of(view) for view in views}
    began_s, number = time.monotonic(), 0
    while True:
        for place, view in enumerate(views):
            due_s = began_s + (number + place / len(views)) / FPS
            time.sleep(max(0.0, due_s - time.monotonic()))
            image = np.roll(pictures[view], 4 * number, axis=1)
            block.put(view, number, time.monotonic_ns(), image)
        number += 1


def drawn(block: FrameBlock, seconds: float) -> np.ndarray:
    """Of each frame of the large picture that was drawn, when it was put and drawn [ns]."""
    GLib, memory = load().GLib, open_block(block.name)
    frames = {view: FrameReader(memory, block.layout, view) for view in block.layout.views}
    window = NotedWindow(
        OPENING, frames, PlayedFacts(), lambda _event: None, MonotonicClock(), SIZE
    )  # type: ignore[arg-type]  # of the facts it asks for the newest alone
    window.drawn = []
    window.present()
    arrivals = Worker("arrivals", window.arrivals.run)
    arrivals.start()
    loop = GLib.MainLoop()
    GLib.timeout_add(round(SETTLING_S * 1000), window.drawn.clear)
    GLib.timeout_add(round((SETTLING_S + seconds) * 1000), loop.quit)
    loop.run()
    arrivals.stop()
    return np.array(window.drawn, dtype=np.int64).reshape(-1, 2)


def told(times_ns: np.ndarray, seconds: float) -> str:
    """The figures in one line."""
    put_ns, drawn_ns = times_ns.T
    delay_ms, gap_ms = (drawn_ns - put_ns) / NS_PER_MS, np.diff(drawn_ns) / NS_PER_MS
    age_ms = np.average(delay_ms[:-1] + gap_ms / 2, weights=gap_ms)
    return (
        f"drawn p50 {np.percentile(delay_ms, 50):.1f}, p95 {np.percentile(delay_ms, 95):.1f} ms "
        f"after it was put, {len(put_ns) / seconds:.1f} times a second; on the screen "
        f"{age_ms:.0f} ms old in the mean"
    )


def main() -> None:
    parser = ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--renderer", choices=list(RENDERERS.values()), default="cairo")
    options = parser.parse_args()
    block = FrameBlock(RingLayout(SHOWN, OPENING.views, 640, 480))
    block.create()
    feeding = multiprocessing.get_context("fork").Process(target=play, args=(block,), daemon=True)
    feeding.start()  # before anything makes a thread
    with TemporaryDirectory() as name, pytest.MonkeyPatch.context() as patch:
        patch.setenv("GSK_RENDERER", options.renderer)
        with virtual_screen(Path(name), patch, SIZE.width, SIZE.height):
            print(told(drawn(block, options.seconds), options.seconds))
    feeding.terminate()
    feeding.join()
    block.close()


if __name__ == "__main__":
    main()
