"""The arm's emergency stop: its own connection, and a thread that repeats until acknowledged."""

from __future__ import annotations

import itertools
import threading

from hw.lite6.protocol import Register, ReplyBit, StateCommand, UxbusClient
from tams_app.errors import DeviceError
from tams_app.runtime.worker import Worker

RETRY_PAUSE_S = 0.01
# A lost request to connect is repeated by the kernel after a second, by a new attempt at once;
# every fourth waits longer, for a network that is merely slow.
RECONNECT_TIMEOUTS_S = (0.05, 0.05, 0.05, 0.2)
KEEPALIVE_PERIOD_S = 0.5  # also how long a dead connection may go unnoticed
KEEPALIVE_MISSES = 2
LONGEST_REPLY_TIMEOUT_S = 1.0


class Lite6StopChannel:
    """Sends controller state 4 when asked, again and again until the controller acknowledges it.

    A request during a stop is sent after it. A connection that is broken, or stays silent, is made
    anew: after one missed reply to a stop, after two missed keep-alives. Between stops these show
    whether the channel would work: see `failure`.
    """

    def __init__(self, host: str, port: int, reply_timeout_s: float, name: str) -> None:
        self._client = UxbusClient(host, port)
        self._where = f"{host}:{port}"
        self._reply_timeout_s = reply_timeout_s
        self._reconnect_timeouts_s = itertools.cycle(RECONNECT_TIMEOUTS_S)
        self._wake = threading.Condition()
        self._requested = 0
        self._acknowledged = 0
        self.failure = ""  # why a stop would not get through at the moment, in one sentence
        self.native_id: int | None = None  # of the thread, for real-time scheduling
        self._worker = Worker(name, self._run, self._on_death)

    def start(self) -> None:
        """Connect and start the thread; DeviceError if the arm does not answer."""
        self._client.connect()
        try:
            self._client.request(Register.GET_STATE, b"", timeout_s=1.0)
        except OSError as error:
            self._client.close()
            raise DeviceError(
                f"The arm at {self._where} accepts connections but does not answer; "
                "restart its control box."
            ) from error
        self._worker.start()

    @property
    def pending(self) -> bool:
        """A stop was asked for and is not acknowledged yet."""
        return self._acknowledged < self._requested

    def request_stop(self) -> None:
        """Stop the arm; does not block, may be called from any thread and any number of times."""
        with self._wake:
            self._requested += 1
            self._wake.notify_all()

    def wait_acknowledged(self, timeout_s: float) -> bool:
        """Wait until every stop asked for so far is acknowledged; False if `timeout_s` passed."""
        with self._wake:
            return self._wake.wait_for(lambda: not self.pending, timeout_s)

    def close(self) -> None:
        """End the thread and disconnect; may be called twice."""
        self._worker.request_stop()
        with self._wake:
            self._wake.notify_all()
        self._worker.stop()
        self._client.close()

    def _run(self, stop: threading.Event) -> None:
        self.native_id = threading.get_native_id()
        misses = 0
        while not stop.is_set():
            with self._wake:
                self._wake.wait_for(lambda: self.pending or stop.is_set(), KEEPALIVE_PERIOD_S)
            if self.pending:
                self._stop_until_acknowledged(stop)
            elif not stop.is_set():
                answers = self._answers(Register.GET_STATE, b"", self._reply_timeout_s)
                misses = 0 if answers else misses + 1
                self.failure = self._sentence() if misses >= KEEPALIVE_MISSES else ""
                if misses >= KEEPALIVE_MISSES:
                    self._client.close()

    def _stop_until_acknowledged(self, stop: threading.Event) -> None:
        requested = self._requested
        timeout_s = self._reply_timeout_s
        while not self._answers(Register.SET_STATE, bytes([StateCommand.STOP]), timeout_s):
            self.failure = self._sentence()
            self._client.close()  # it may be open and dead: only a new one gets through
            timeout_s = min(2 * timeout_s, LONGEST_REPLY_TIMEOUT_S)  # or alive and slow
            if stop.wait(RETRY_PAUSE_S):
                return
        self.failure = ""
        with self._wake:
            self._acknowledged = requested
            self._wake.notify_all()

    def _answers(self, register: int, payload: bytes, timeout_s: float) -> bool:
        """One attempt at a request, over a new connection if the old one is gone."""
        try:
            if not self._client.connected:
                self._client.connect(next(self._reconnect_timeouts_s))
            status, _ = self._client.request(register, payload, timeout_s)
        except (OSError, DeviceError):  # the caller repeats, and `failure` is set meanwhile
            return False
        return not status & ReplyBit.INVALID

    def _sentence(self) -> str:
        return (
            f"The stop connection to the arm at {self._where} does not answer; "
            "use the emergency stop button and check the network."
        )

    def _on_death(self, name: str, failure: BaseException) -> None:
        self.failure = f"The thread {name} ended ({failure}); use the emergency stop button."
