"""A laboratory's station: the application as on hardware, and beside it what it is connected to.

Each in a process of its own, as on hardware: the arm's controller is the rig's helper, the
application has the cameras' frames from a preloaded library, and the operator's hand, moved from
here, reaches it through memory.
"""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np

from hw.lite6.report import ReportReader
from tams_app.config import CONFIG_DIRECTORY, Config, VideoConfig, load_config
from tams_app.errors import TamsError
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.shared_ring import new_block_name
from tests.hw.v4l2.fake_cameras import Machine, build_library
from tests.rig_views import stored_views
from tests.session import hardware_application
from tests.session.hardware_application import Look, Wiring
from tests.session.hardware_hand import Hand

PATIENCE_S = 60.0
AGAIN_S = 0.5  # then the operator tries once more
LOOK_S = 0.05
HAND_M_S = 0.15
HIGH_M = 0.28  # from here down again
REACH_M = 0.02
_NOISY_IMAGES = 32  # before the first comes again: more than a watch for freezes remembers
_NOISE_SIGMA = 2.0  # of 255


class Plugged:
    """What stands at a station before a session: the arm, switched on, and three cameras."""

    def __init__(self, folder: Path, fps: int, joints_deg: Sequence[float] | None = None) -> None:
        """`fps`: of the cameras. `joints_deg`: where the arm stands; None: at its ready pose."""
        self.folder = folder
        self._fps = fps
        profile = load_config(CONFIG_DIRECTORY / "lite6.yaml")
        self.library = build_library(folder)
        self.machine = Machine(folder)
        for number, view in enumerate(profile.video.views):
            images = filmed(view, profile.video)
            self.machine.plug(
                number, serial=view, port=number, rate=fps, video=profile.video, images=images
            )
        self.arm = HelperProcess(
            "rig",
            "hw.sim.rig",
            {
                "memory_name": new_block_name(),
                "seed": 0,
                "start_joints_deg": list(joints_deg or profile.arm.ready_joints_deg),
            },
            folder,
        )
        self.arm.start()
        ready = self.arm.wait_ready()
        self.ports: tuple[int, int] = ready["control_port"], ready["report_port"]
        self.hand = Hand(folder / "hand")

    def wiring(self, steamvr_runs: bool = True) -> Wiring:
        return Wiring(self.machine.dev, self.machine.sys, self.folder / "hand", steamvr_runs)

    def config(self, **overrides: Any) -> Config:
        """The hardware profile with its SET keys filled in, and the product's limits."""
        camera = {"source": "v4l2", "pixel_format": "mjpeg"}
        return load_config(
            CONFIG_DIRECTORY / "lite6.yaml",
            {
                "arm.host": "127.0.0.1",
                "arm.control_port": self.ports[0],
                "arm.report_port": self.ports[1],
                "cameras": {view: camera | {"serial": view} for view in ("eih", "gt", "gs")},
                "video.fps": self._fps,
                "recording.directory": str(self.folder),
                "headless": True,
                **overrides,
            },
        )

    def close(self) -> None:
        with ExitStack() as stack:
            stack.callback(self.arm.stop)
            stack.callback(self.hand.close)


def filmed(view: str, video: VideoConfig) -> list[bytes]:
    """JPEGs of the rig as `view` shows it, with a sensor's noise; padded to one length."""
    random, image = np.random.default_rng(5), stored_views()[view]
    image = cv2.resize(image, (video.width, video.height))
    encoded = []
    for _ in range(_NOISY_IMAGES):
        noisy = image + random.normal(0.0, _NOISE_SIGMA, image.shape)
        jpeg = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8))[1]
        encoded.append(jpeg.tobytes())
    longest = max(map(len, encoded))
    return [jpeg.ljust(longest, b"\0") for jpeg in encoded]


class Station:
    """A session that runs at a station, and the operator who works there."""

    def __init__(self, plugged: Plugged, config: Config, wiring: Wiring, dry_run: bool) -> None:
        """TamsError if the session cannot start."""
        self._hand = plugged.hand
        self.failure: str | None = None  # of the session, once it was closed
        context = multiprocessing.get_context("spawn")
        self._requests, theirs = context.Pipe()
        self._process = context.Process(
            target=hardware_application.run, args=(theirs, config, wiring, dry_run)
        )
        library, devices = str(plugged.library), str(wiring.devices)
        with patch.dict(os.environ, LD_PRELOAD=library, TAMS_FAKE_V4L2=devices):
            self._process.start()
        theirs.close()
        answer = self._requests.recv()
        if isinstance(answer, TamsError):
            self._process.join(PATIENCE_S)
            raise answer
        self.folder: Path = answer
        self.notes: list[str] = []
        self.seen = self.look()

    def look(self) -> Look:
        self._requests.send(("look",))
        self.seen = self._requests.recv()
        self.notes += self.seen.notes
        return self.seen

    @property
    def arming(self) -> str:
        return self.seen.state.arming

    @property
    def tcp_height_m(self) -> float:
        tcp_mm = self.seen.state.tcp_mm
        assert tcp_mm is not None
        return tcp_mm[2] / 1000.0

    def press(self, action: str, value: float) -> None:
        self._requests.send(("press", action, value))

    def quit_steamvr(self) -> None:
        self._requests.send(("quit SteamVR",))

    def until(self, holds: Callable[[], bool], what: str) -> None:
        """Look again and again until `holds`."""
        give_up_s = time.monotonic() + PATIENCE_S
        self.look()
        while not holds():
            assert time.monotonic() < give_up_s, f"not {what}, but {self.seen}"
            assert not self.seen.ended, self.seen.failure
            time.sleep(LOOK_S)
            self.look()

    def confirm_until(self, holds: Callable[[], bool], what: str) -> None:
        """Confirm again and again: while the devices are being found one may not count."""
        next_s = 0.0

        def confirmed() -> bool:
            nonlocal next_s
            if holds():
                return True
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + AGAIN_S
                self._requests.send(("confirm",))
            return False

        self.until(confirmed, what)

    def await_frames(self) -> None:
        """Until every view is shown."""
        views = self.seen.state.views
        self.until(
            lambda: all(self.seen.state.views[view].age_ms is not None for view in views),
            "frames",
        )

    def make_ready(self) -> None:
        self.confirm_until(lambda: self.arming == "ready", "ready")

    def reach(self) -> float:
        """Press, raise or lower the hand, release; how far [m] the arm reports to have followed.

        Ends early at a hold or a fault.
        """
        before_m = self.tcp_height_m
        self.press("trigger", 1.0)
        self.until(lambda: self.arming in ("engaged", "holding", "fault"), "engaged")
        self._hand.move(HAND_M_S if before_m < HIGH_M else -HAND_M_S)
        self.until(
            lambda: abs(self.tcp_height_m - before_m) > REACH_M or self.arming != "engaged",
            "the arm follows",
        )
        followed_m = abs(self.tcp_height_m - before_m)
        self._hand.move(0.0)
        self.press("trigger", 0.0)
        self.until(lambda: self.arming in ("ready", "fault"), "ready again")
        return followed_m

    def close(self) -> None:
        """End the session as the operator does; may be called twice."""
        if self.failure is None:
            self._requests.send(("close",))
            self.failure = self._requests.recv()
            self._process.join(PATIENCE_S)
            assert self._process.exitcode == 0


def station(there: Plugged, config: Config, dry_run: bool = False) -> closing[Station]:
    """A session that runs; TamsError if it cannot start."""
    return closing(Station(there, config, there.wiring(), dry_run))


@contextmanager
def witness(there: Plugged) -> Iterator[ReportReader]:
    """Reads beside the application what the arm's controller reports to everybody."""
    reports = ReportReader("127.0.0.1", there.ports[1], MonotonicClock())
    reports.start()
    try:
        assert reports.wait_for(lambda: reports.motion is not None, PATIENCE_S)
        yield reports
    finally:
        reports.close()
