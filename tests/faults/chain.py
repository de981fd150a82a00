"""The real video chain for faults: synthetic cameras, senders, relay process, receivers."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from hw.camera import Camera
from tams_app.config import Network, load_config
from tams_app.errors import TamsError
from tams_app.records import Frame, Image, Record, ShownFrame
from tams_app.robot.control import Signals
from tams_app.robot.ground import LiveGround
from tams_app.robot.senders import Capture, FrameRates, Senders
from tams_app.robot.status import StatusBoard
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.parts import Ending, Parts
from tams_app.runtime.worker import Worker
from tams_app.session.local_operator import LocalOperator
from tams_app.station.fresh_video import Displays
from tams_app.station.receivers import Receivers
from tams_app.station.screen import Screen
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S
from tams_app.video.live.receiver import VideoReceiver
from tests.faults.applications import until
from tests.faults.bench import ACROSS, PERIOD_S
from tests.faults.virtual_bench import VirtualBench
from tests.session.exchange import Unkept

WIDTH, HEIGHT, FPS = 320, 240, 30
VIEWS = ("eih", "gt", "gs")
FRESH_NS = 400_000_000  # younger than any age that slows the arm
PATIENCE_S = 40.0
_SWING_S = 0.5


class PatternCamera(Camera):
    """A moving pattern at 30 frames a second, until it is `frozen`."""

    def __init__(self, view: str) -> None:
        self.view = view
        self.frozen = False
        self._canvas = np.random.default_rng(len(view)).integers(
            0, 255, (HEIGHT // 8, WIDTH // 4, 3), dtype=np.uint8
        )
        self._start_ns = time.monotonic_ns()
        self._index = -1

    def start(self) -> None:
        """Nothing to open."""

    def next_frame(self, timeout_s: float) -> Frame | None:
        if self.frozen:
            time.sleep(timeout_s)
            return None
        newest = (time.monotonic_ns() - self._start_ns) * FPS // NS_PER_S
        self._index = max(newest, self._index + 1)
        due_ns = self._start_ns + self._index * NS_PER_S // FPS
        time.sleep(max(0.0, (due_ns - time.monotonic_ns()) / NS_PER_S))
        return Frame(self.view, self._index, time.monotonic_ns(), self._frame())

    def close(self) -> None:
        """Nothing to close."""

    def _frame(self) -> Image:
        rolled = np.roll(self._canvas, self._index % (WIDTH // 4), axis=1)
        return np.ascontiguousarray(np.repeat(np.repeat(rolled, 8, axis=0), 4, axis=1))


class NoLog(Unkept):
    """Keeps nothing, and has something done with each frame that is shown."""

    def __init__(
        self, clock: Clock, on_shown: Callable[[ShownFrame], None] = lambda _shown: None
    ) -> None:
        super().__init__(clock)
        self._on_shown = on_shown

    def keep(self, item: Record) -> None:
        if isinstance(item, ShownFrame):
            self._on_shown(item)


class Chain:
    """Three views from camera to mailbox over one link; ages are those of this machine's clock."""

    def __init__(
        self,
        network: Network,
        logs: Path,
        epoch_ns: int | None = None,
        on_shown: Callable[[ShownFrame], None] = lambda shown: None,
    ) -> None:
        config = load_config(
            overrides={"video.width": WIDTH, "video.height": HEIGHT, "video.fps": FPS}
        )
        self.failures: list[tuple[str, BaseException]] = []
        # Of the primary view, as the control loop asked for them:
        self.ages_ns: list[int] = []
        self.are_damaged: list[bool] = []
        clock = MonotonicClock()
        log = NoLog(clock, on_shown)
        self._parts = Parts(logs, lambda sentence: self._fail("parts", TamsError(sentence)), 0)
        self._parts.on_failure = self._fail  # type: ignore[method-assign]
        ground = LiveGround(config, clock, log, Signals(), self._parts, Ending(clock))
        board = StatusBoard(config, log.newest)
        self.uplink = uplink = Senders(ground, network, board, epoch_ns=epoch_ns)
        identify = {view: frames.find for view, frames in uplink.sent.items()}
        self._receivers = Receivers(
            config.video,
            uplink.rule,
            uplink.feedback,
            clock,
            identify,
            Screen(config.video, self._parts, log, {}),
            Displays(),
        )
        hand: Any = None  # nothing is held
        self.operator = LocalOperator(hand, self._receivers, config)
        self._rates = FrameRates(VIEWS, clock, log)
        self.cameras = {view: PatternCamera(view) for view in VIEWS}
        self._stack = ExitStack()

    def __enter__(self) -> Chain:
        with self._stack:
            self._stack.callback(self._parts.stack.close)
            self._stack.callback(self._receivers.close)
            entrances = self.uplink.enter_network(self._receivers.ports)
            self._receivers.start(entrances)
            self.uplink.start(entrances)
            for view, camera in self.cameras.items():
                capture = Capture(camera, self._rates, self.uplink)
                worker = Worker(f"capture-{view}", capture.run, self._fail)
                self._stack.callback(worker.stop, 10.0)
                worker.start()
            until(self.is_fresh, "the first frames")
            self._stack = self._stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def relay_pid(self) -> int:
        return self._parts.pids["relay"]

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """As `Operator.age_ns`, but at this moment, whatever the bench's clock says."""
        age = self.operator.age_ns(view, time.monotonic_ns())
        self.ages_ns.append(1 << 62 if age is None else age)
        return age

    def is_damaged(self, view: str) -> bool:
        self.are_damaged.append(self.operator.is_damaged(view))
        return self.are_damaged[-1]

    def is_fresh(self) -> bool:
        """Whether every view shows a young frame."""
        now_ns = time.monotonic_ns()
        ages = [self.operator.age_ns(view, now_ns) for view in VIEWS]
        return all(age is not None and age < FRESH_NS for age in ages)

    def receiver(self, view: str) -> VideoReceiver:
        """The one of that view."""
        return self._receivers._receivers[view]

    def poll(self) -> str:
        """The first failure of either end."""
        return self.uplink.poll() or self._receivers.poll()

    def _fail(self, name: str, failure: BaseException) -> None:
        self.failures.append((name, failure))


class StreamedBench:
    """A virtual bench steered by streamed frames, so in real time; its hand swings to and fro."""

    def __init__(self, chain: Chain, folder: Path) -> None:
        self.chain = chain
        self.bench = VirtualBench(folder, chain)
        self.bench.arm_it()
        self._engage()

    def _engage(self) -> None:
        """Press the trigger: the frames are fresh."""
        self.bench.hand.trigger = 1.0
        self.run_until(
            lambda: self.bench.outputs[-1].arming is ArmingState.ENGAGED, "the arm to engage"
        )

    def run_until(self, condition: Callable[[], bool], what: str) -> None:
        """Tick at the loop's rate until `condition` holds."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"waited for {what} in vain"
            sign = 1 if int(time.monotonic() / _SWING_S) % 2 else -1
            self.bench.hand.velocity = sign * 0.2 * ACROSS
            self.bench.tick()
            time.sleep(PERIOD_S)

    def run(self, seconds: float) -> None:
        """Tick for so long of real time."""
        end_s = time.monotonic() + seconds
        self.run_until(lambda: time.monotonic() >= end_s, "time to pass")
