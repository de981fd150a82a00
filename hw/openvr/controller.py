"""The real tracked controller, over OpenVR.

A thread of its own talks to the runtime, which may hang or die at any moment; `sample` takes the
newest reading out of a mailbox. When the thread is held up, the times of pose and buttons grow old
and the safety logic stops the arm.
"""

from __future__ import annotations

import tempfile
import threading
from concurrent.futures import Future
from concurrent.futures import TimeoutError as StartTimeout
from functools import partial
from pathlib import Path

from hw.controller import Controller
from hw.openvr import bindings as openvr_bindings
from hw.openvr.components import COMPONENTS
from hw.openvr.poller import OpenVrPoller
from tams_app.config import ControllerConfig
from tams_app.errors import DeviceError, TamsError
from tams_app.records import ControllerSample, ControllerStatus, Haptic, TakeNote
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.runtime.mailbox import BoundedQueue, Mailbox
from tams_app.runtime.worker import Worker

POLL_RATE_HZ = 250
START_TIMEOUT_S = 15.0  # the runtime's own library may wait for its server
THREAD_NAME = "openvr-poll"
_WAITING_PULSES = 8
_NOTHING = ControllerSample.released(ControllerStatus.DISCONNECTED)


class OpenVrController(Controller):
    """The controller of the configured hand; one per process.

    `note` is called with level and text for every change, in the polling thread. `failure` states
    in one sentence why that thread has ended; "" if it has not, or was requested to.
    """

    def __init__(
        self,
        config: ControllerConfig,
        clock: Clock,
        note: TakeNote,
    ) -> None:
        """ConfigError if the mapping does not fit the controllers it names."""
        for controller_type in COMPONENTS:
            openvr_bindings.bindings(controller_type, config)
        self._config, self._clock, self._note = config, clock, note
        self._readings: Mailbox[ControllerSample] = Mailbox()
        self._pulses: BoundedQueue[Haptic] = BoundedQueue(_WAITING_PULSES)
        self._worker: Worker | None = None
        self._manifest_folder: tempfile.TemporaryDirectory[str] | None = None
        self._native_id: int | None = None
        self.failure = ""

    def start(self) -> None:
        """Join the running SteamVR; DeviceError if there is none, or it does not answer."""
        if self._worker is not None and self._worker.alive:
            raise DeviceError(
                "The last connection to SteamVR is still open: close it, "
                "or restart SteamVR if it hangs."
            )
        self.failure = ""
        self._pulses.take_all()
        joined: Future[None] = Future()
        poller = OpenVrPoller(self._config, self._manifest(), self._note)
        body = partial(self._run, poller, joined)
        self._worker = Worker(THREAD_NAME, body, partial(self._on_death, joined))
        self._worker.start()
        try:
            joined.result(START_TIMEOUT_S)
        except StartTimeout as error:
            self._worker.request_stop()
            self._forget_manifest()
            raise DeviceError(
                f"SteamVR has not answered for {START_TIMEOUT_S:g} s: restart it, then try again."
            ) from error
        except TamsError:
            self._forget_manifest()
            raise

    def sample(self, now_ns: int) -> ControllerSample:
        return self._readings.latest() or _NOTHING

    def pulse(self, haptic: Haptic) -> None:
        self._pulses.put(haptic)

    def close(self) -> None:
        """Disconnect from SteamVR; TamsError if it hangs and holds the thread."""
        try:
            if self._worker is not None:
                self._worker.stop()
        finally:
            self._disconnect()
            self._forget_manifest()

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        """Kernel id of the polling thread; empty before it runs."""
        return {} if self._native_id is None else {THREAD_NAME: self._native_id}

    def _manifest(self) -> Path:
        """The committed manifest, or one for a mapping of the configuration's own."""
        if not self._config.mapping:
            return openvr_bindings.COMMITTED_DIRECTORY / openvr_bindings.MANIFEST_NAME
        if self._manifest_folder is None:
            self._manifest_folder = tempfile.TemporaryDirectory(prefix="tams-steamvr-")
        return openvr_bindings.write(Path(self._manifest_folder.name), self._config)

    def _forget_manifest(self) -> None:
        if self._manifest_folder is not None:
            self._manifest_folder.cleanup()
            self._manifest_folder = None

    def _run(self, poller: OpenVrPoller, joined: Future[None], stop: threading.Event) -> None:
        self._native_id = threading.get_native_id()
        try:
            poller.connect()
        except TamsError as error:
            joined.set_exception(error)
            return
        try:
            self._readings.put(poller.step(self._clock.now_ns()))
            joined.set_result(None)
            rate = FixedRate(self._clock, POLL_RATE_HZ)
            while not stop.is_set():
                now_ns = self._clock.now_ns()
                for haptic in self._pulses.take_all():
                    poller.play(haptic, now_ns)
                reading = poller.step(now_ns)
                if not stop.is_set():  # a step that hung must not come after `close`
                    self._readings.put(reading)
                rate.wait()
        finally:
            poller.close()

    def _on_death(self, joined: Future[None], name: str, failure: BaseException) -> None:
        self.failure = f"The thread {name} ended ({failure}); please report this error."
        self._disconnect()
        if joined.done():
            self._note("error", self.failure)
        else:
            joined.set_exception(DeviceError(self.failure))

    def _disconnect(self) -> None:
        """From now on give no pose, everything released, the times as they were."""
        last = self._readings.latest() or _NOTHING
        self._readings.put(
            ControllerSample.released(
                ControllerStatus.DISCONNECTED, None, last.pose_ns, last.buttons_ns
            )
        )
