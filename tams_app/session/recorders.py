"""Everything the session leaves behind while it runs: the log and, if wanted, lossless captures."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import psutil

from tams_app import __version__
from tams_app.config import Config
from tams_app.recording import LOG_NAME, Header, Recorder, ReferenceRecorder
from tams_app.recording.journal import Journal
from tams_app.recording.writer import DirectRecorder
from tams_app.records import ServoMode, SystemSample
from tams_app.runtime.clock import Clock
from tams_app.session.ros2_bridge import Ros2Bridge
from tams_app.session.viewing import invite_viewers, viewers_of

REFERENCE_NAME = "reference.mcap"
LOAD_INTERVAL_S = 1.0


class Recorders(Journal):
    """The log and the reference recorder of one session; nothing here blocks but `close`."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        folder: Path,
        on_failure: Callable[[str, BaseException], None],
        show: Callable[[str], None] = lambda _text: None,
        estop: Callable[[], None] = lambda: None,
    ) -> None:
        """`estop` is called when ROS 2 asks for it, in a thread of its own."""
        started_ns = clock.now_ns()
        wall_offset_ns = time.time_ns() - started_ns
        header = session_header(config, started_ns, wall_offset_ns)
        free_mb, bitstream = config.recording.min_free_mb, config.recording.bitstream
        bridge: Ros2Bridge | None = None
        reference: ReferenceRecorder | None = None
        with ExitStack() as stack:
            if config.recording.ros2 is not None:
                bridge = Ros2Bridge(config.recording.ros2, header, clock, folder / "helpers")
                stack.callback(bridge.end)
            viewers, context = viewers_of(config, header)
            for viewer in viewers:
                stack.callback(viewer.close)  # where no log comes to be, which closes them, too
            if bridge is not None:
                viewers.append(bridge)
            path = folder / LOG_NAME
            log = Recorder(path, header, clock, free_mb, on_failure, bitstream, viewers, context)
            stack.callback(log.close)
            if config.recording.record_reference:
                reference = ReferenceRecorder(
                    folder / REFERENCE_NAME, wall_offset_ns, free_mb, on_failure
                )
                stack.callback(reference.close)
                reference.start()
            log.start()
            self._stack = stack.pop_all()
        super().__init__(clock, log, show, reference)
        invite_viewers(config, self.note)
        self._recorder = log
        self._warned: set[str] = set()
        self._bridge = bridge
        if bridge is not None:
            bridge.listen(estop, self.note)
            self._stack.callback(bridge.stop_listening)

    @property
    def bridge_pid(self) -> int | None:
        """Process id of the ROS 2 bridge; None if it is not running."""
        return None if self._bridge is None else self._bridge.pid

    def poll(self) -> None:
        """Warn, once each, of what is wrong with the log or its viewers."""
        for trouble in self._recorder.troubles():
            if trouble not in self._warned:
                self._warned.add(trouble)
                self.note("warning", trouble)

    @property
    def size_mb(self) -> float:
        """Of the log so far."""
        return self._recorder.size_bytes / 1e6

    @property
    def lost(self) -> int:
        """Records that are missing from the log."""
        return self._recorder.dropped

    def close(self) -> None:
        """Write what is queued and finish the files."""
        self._stack.close()


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
) -> Iterator[Journal]:
    """The log of a session in virtual time that begins now, at `wall_start_ns` by the wall's clock.

    Each record is written in the thread that makes it; the end of the context closes the log.
    """
    keeping, now_ns = config.recording, clock.now_ns()
    header = session_header(config, now_ns, wall_start_ns - now_ns)
    viewers, context = viewers_of(config, header, live=False)
    free_mb, path = keeping.min_free_mb, folder / LOG_NAME
    log = DirectRecorder(path, header, clock, free_mb, keeping.bitstream, viewers, context)
    with closing(log):
        yield Journal(clock, log)


class LoadMonitor:
    """Samples the load of the application and its helpers once a second; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        helpers: Mapping[str, int],
        record: Callable[[SystemSample], None],
    ) -> None:
        self._clock = clock
        self._app = psutil.Process()
        self._helpers = {name: psutil.Process(pid) for name, pid in helpers.items()}
        self._record = record

    def run(self, stop: threading.Event) -> None:
        self.sample()  # the first figures of cpu_percent are meaningless
        while not stop.wait(LOAD_INTERVAL_S):
            self._record(self.sample())

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
