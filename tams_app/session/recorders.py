"""What a session leaves behind while it runs: the log and, if wanted, lossless captures."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import psutil

from tams_app import __version__
from tams_app.config import Config
from tams_app.recording import LOG_NAME, Header, Recorder
from tams_app.recording.journal import DirectRecorder, Journal
from tams_app.recording.mcap_log import McapLog
from tams_app.records import ServoMode, SystemSample
from tams_app.robot.control import Signals
from tams_app.runtime.clock import Clock
from tams_app.runtime.mailbox import Sentences
from tams_app.runtime.worker import OnFailure
from tams_app.session.viewing import invitations, viewers_of

if TYPE_CHECKING:
    from tams_app.session.ros2_bridge import Ros2Bridge
    from tams_app.station.linked_robot import Requests

REFERENCE_NAME = "reference.mcap"
LOAD_INTERVAL_S = 1.0


@contextmanager
def live_records(
    config: Config,
    clock: Clock,
    folder: Path,
    on_failure: OnFailure,
    sentences: Sentences | None = None,
    signals: Signals | Requests | None = None,
) -> Iterator[tuple[Recorder, Ros2Bridge | None]]:
    """The log of a live session, with its viewers and lossless captures, and the bridge to ROS 2.

    `sentences` gets the text of each note. `signals` gets the emergency stops that ROS 2 asks for,
    in a thread of its own. The end of the context closes everything.
    """
    sentences, signals = sentences or Sentences(), signals or Signals()
    started_ns = clock.now_ns()
    wall_offset_ns = time.time_ns() - started_ns
    header = session_header(config, started_ns, wall_offset_ns)
    keeping = config.recording
    bridge: Ros2Bridge | None = None
    with ExitStack() as stack:
        if keeping.ros2 is not None:
            from tams_app.session.ros2_bridge import Ros2Bridge

            bridge = Ros2Bridge(keeping.ros2, header, clock, folder / "helpers")
            stack.callback(bridge.end)
        viewers, context = viewers_of(config, header)
        if bridge is not None:
            viewers.append(bridge)
        path, free_mb = folder / LOG_NAME, keeping.min_free_mb
        file = McapLog(path, header, keeping.bitstream, viewers, context, free_mb)
        log = Recorder(file, clock, on_failure, sentences.note)
        stack.callback(log.close)
        if keeping.record_reference:
            from tams_app.recording.reference import ReferenceRecorder

            path = folder / REFERENCE_NAME
            log.reference = ReferenceRecorder(path, wall_offset_ns, free_mb, on_failure)
            stack.callback(log.reference.close)
            log.reference.start()
        log.start()
        for level, text in invitations(config):
            log.note(level, text)
        if bridge is not None:
            bridge.listen(signals.estop, log.note)
            stack.callback(bridge.stop_listening)
        yield log, bridge


def session_header(config: Config, started_ns: int, wall_offset_ns: int) -> Header:
    """The first message of a session's log."""
    return Header(
        version=__version__,
        name=config.name,
        seed=config.seed,
        strategy=config.strategy,
        network=config.network,
        budget_mode=config.policy.budget.mode,
        servo=ServoMode.VELOCITY.value,
        control_rate_hz=config.control.rate_hz,
        views=config.video.views,
        fps=config.video.fps,
        weights=config.policy.weights.matrix,
        started_ns=started_ns,
        wall_offset_ns=wall_offset_ns,
        config=config.model_dump(mode="json"),
    )


@contextmanager
def virtual_records(
    config: Config, folder: Path, clock: Clock, wall_start_ns: int
) -> Iterator[DirectRecorder]:
    """The log of a session in virtual time that begins now, at `wall_start_ns` by the wall's clock.

    Each record is written in the thread that makes it; the end of the context closes the log.
    """
    keeping, now_ns = config.recording, clock.now_ns()
    header = session_header(config, now_ns, wall_start_ns - now_ns)
    viewers, context = viewers_of(config, header, live=False)
    free_mb, path = keeping.min_free_mb, folder / LOG_NAME
    file = McapLog(path, header, keeping.bitstream, viewers, context, free_mb)
    with closing(DirectRecorder(file, clock)) as log:
        yield log


class LoadMonitor:
    """Samples the load of the application and its helpers once a second; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        helpers: Mapping[str, int],
        log: Journal,
    ) -> None:
        self._clock = clock
        self._app = psutil.Process()
        self._helpers = {
            name: psutil.Process(pid) for name, pid in helpers.items() if psutil.pid_exists(pid)
        }
        self._log = log

    def run(self, stop: threading.Event) -> None:
        self.sample()  # the first figures of cpu_percent are meaningless
        while not stop.wait(LOAD_INTERVAL_S):
            self._log.record(self.sample())

    def sample(self) -> SystemSample:
        """Percent of one core since the last call, and resident memory now."""
        helper_cpu: dict[str, float] = {}
        rss = self._app.memory_info().rss
        for name, process in self._helpers.items():
            try:
                helper_cpu[name] = process.cpu_percent()
                rss += process.memory_info().rss
            except psutil.NoSuchProcess:
                helper_cpu[name] = 0.0  # it died; the session's watch deals with that
        return SystemSample(
            self._clock.now_ns(), self._app.cpu_percent(), helper_cpu, rss / 1_000_000
        )
