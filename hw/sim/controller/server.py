"""The controller model on TCP, as the box in the cabinet: one control port, two report ports.

Threads: one that steps the model every 4 ms of real time, one that accepts, and one for each
connection, so that a client which hangs delays no other. One lock guards the model.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import threading
from dataclasses import dataclass
from functools import partial

from hw.lite6.protocol import UxbusFrame, UxbusReader
from hw.sim.controller.model import CYCLE_NS, ControllerModel, ReportKind
from tams_app.errors import DeviceError
from tams_app.runtime.clock import Clock, MonotonicClock
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_S

# Every socket has a time-out of its own: the SDK, when it lives in the same process, sets the
# global default. It bounds how long a thread overlooks the end of the server.
_SOCKET_TIMEOUT_S = 0.5
_BACKLOG = 8
_RECEIVE_BYTES = 4096

# After a standstill of the whole process this much is caught up, cycle by cycle.
_MAX_CATCH_UP_NS = NS_PER_S


@dataclass(frozen=True, slots=True)
class ServerPorts:
    """The server's ports; rich and real reports have those that follow `report`."""

    control: int
    report: int


class ControllerServer:
    """Serves `model` from `start` to `close`; ports given as 0 are chosen freely.

    For tests of faults: `reply_delay_s` delays every reply, `refuse_connections` disconnects new
    clients, `drop_connections` the present ones. `lock` is to be held for anything else that
    is done with the model meanwhile.
    """

    def __init__(
        self,
        model: ControllerModel,
        host: str = "127.0.0.1",
        control_port: int = 0,
        report_port: int = 0,
        clock: Clock | None = None,
        ended: threading.Event | None = None,
    ) -> None:
        """`ended` is set if a thread of the server dies, of `failure`."""
        self.lock = threading.Lock()
        self.reply_delay_s = 0.0
        self.refuse_connections = False
        self.failure: BaseException | None = None
        self._model = model
        self._host = host
        self._wanted = ServerPorts(control_port, report_port)
        self._clock = clock or MonotonicClock()
        self._ended = ended or threading.Event()
        self._listeners: dict[socket.socket, ReportKind | None] = {}
        self._connections: dict[socket.socket, Worker] = {}
        self._connections_lock = threading.Lock()
        self._workers: list[Worker] = []

    @property
    def ports(self) -> ServerPorts:
        """The ports in use; known after `start`."""
        by_kind = {kind: item.getsockname()[1] for item, kind in self._listeners.items()}
        if not by_kind:
            raise DeviceError("The simulated arm controller is not running; start it first.")
        return ServerPorts(by_kind[None], by_kind[ReportKind.RICH] - ReportKind.RICH.port_offset)

    def start(self) -> None:
        """Listen and run; DeviceError if a port is taken."""
        self._listeners = _listen(self._host, self._wanted)
        self._workers = [
            Worker("arm-controller-cycle", self._run_cycles, self._note_failure),
            Worker("arm-controller-accept", self._accept, self._note_failure),
        ]
        for worker in self._workers:
            worker.start()

    def close(self) -> None:
        """Disconnect, stop all threads and free the ports; may be called twice."""
        for worker in self._workers:
            worker.stop()
        self._workers = []
        self.drop_connections()
        for listener in self._listeners:
            listener.close()
        self._listeners = {}

    def drop_connections(self) -> None:
        """Disconnect every client, control and reports alike."""
        with self._connections_lock:
            connections = list(self._connections.items())
        for connection, worker in connections:
            worker.request_stop()
            with contextlib.suppress(OSError):  # the client may have disconnected already
                connection.shutdown(socket.SHUT_RDWR)
        for _, worker in connections:
            worker.stop()

    # --- the cycle ------------------------------------------------------------------------------

    def _run_cycles(self, stop: threading.Event) -> None:
        """Step the model on absolute deadlines; what was missed is caught up."""
        due_ns = self._clock.now_ns() + CYCLE_NS
        while not stop.is_set():
            self._clock.sleep_until_ns(due_ns)
            behind_ns = self._clock.now_ns() - due_ns
            if behind_ns > _MAX_CATCH_UP_NS:
                due_ns += (behind_ns - _MAX_CATCH_UP_NS) // CYCLE_NS * CYCLE_NS
            with self.lock:
                self._model.step(due_ns)
            due_ns += CYCLE_NS

    # --- connections ----------------------------------------------------------------------------

    def _accept(self, stop: threading.Event) -> None:
        with selectors.DefaultSelector() as selector:
            for listener in self._listeners:
                selector.register(listener, selectors.EVENT_READ, listener)
            while not stop.is_set():
                for key, _ in selector.select(timeout=0.1):
                    self._welcome(key.data)

    def _welcome(self, listener: socket.socket) -> None:
        try:
            connection, _ = listener.accept()
        except OSError:  # the client has already given up
            return
        if self.refuse_connections:
            connection.close()
            return
        connection.settimeout(_SOCKET_TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        kind = self._listeners[listener]
        name = "control" if kind is None else kind.name.lower()
        attend = partial(self._attend, connection, kind)
        worker = Worker(f"arm-controller-{name}", attend, self._note_failure)
        with self._connections_lock:
            self._connections[connection] = worker
        worker.start()

    def _attend(
        self, connection: socket.socket, kind: ReportKind | None, stop: threading.Event
    ) -> None:
        """Serve one client until it disconnects, sends nonsense, or the server ends."""
        try:
            with connection:
                if kind is None:
                    self._serve_control(connection, stop)
                else:
                    self._send_reports(connection, kind, stop)
        except OSError:
            return  # whatever the reason, this client is gone
        finally:
            with self._connections_lock:
                del self._connections[connection]

    def _serve_control(self, connection: socket.socket, stop: threading.Event) -> None:
        reader = UxbusReader()
        while not stop.is_set():
            try:
                received = connection.recv(_RECEIVE_BYTES)
            except TimeoutError:
                continue
            if not received:
                return
            for frame in reader.feed(received):
                if frame.is_heartbeat:
                    continue
                connection.sendall(self._answer(frame, stop))

    def _answer(self, request: UxbusFrame, stop: threading.Event) -> bytes:
        with self.lock:
            reply = self._model.handle(request.register, request.payload, self._clock.now_ns())
        if self.reply_delay_s > 0:
            stop.wait(self.reply_delay_s)
        return request.reply(reply)

    def _send_reports(
        self, connection: socket.socket, kind: ReportKind, stop: threading.Event
    ) -> None:
        period_ns = NS_PER_S // kind.rate_hz
        due_ns = self._clock.now_ns()
        while not stop.is_set():
            if not self._model.reports_frozen:
                with self.lock:
                    report = self._model.report(kind)
                connection.sendall(report)
            # a report that is late is left out, not sent twice
            due_ns += period_ns * (1 + max(0, self._clock.now_ns() - due_ns) // period_ns)
            self._clock.sleep_until_ns(due_ns)

    def _note_failure(self, name: str, failure: BaseException) -> None:
        self.failure = self.failure or failure
        self._ended.set()


def _listen(host: str, wanted: ServerPorts) -> dict[socket.socket, ReportKind | None]:
    """Listening sockets: None for the control port, else the kind of report."""
    listeners: dict[socket.socket, ReportKind | None] = {}
    try:
        listeners[_bind(host, wanted.control)] = None
        for kind, listener in _bind_reports(host, wanted.report).items():
            listeners[listener] = kind
    except OSError as error:
        for listener in listeners:
            listener.close()
        raise DeviceError(
            f"The simulated arm controller cannot listen on {host} ({error.strerror}); "
            "choose other ports or 0 for free ones."
        ) from error
    return listeners


def _bind_reports(host: str, first_port: int) -> dict[ReportKind, socket.socket]:
    """Those that follow `first_port`; with 0 wherever two in a row are free."""
    attempts = 50 if first_port == 0 else 1
    for attempt in range(1, attempts + 1):
        bound: dict[ReportKind, socket.socket] = {}
        try:
            for kind in ReportKind:
                rich = bound.get(ReportKind.RICH)
                base = rich.getsockname()[1] - ReportKind.RICH.port_offset if rich else first_port
                bound[kind] = _bind(host, base + kind.port_offset if base else 0)
            return bound
        except (OSError, OverflowError):
            for listener in bound.values():
                listener.close()
            if attempt == attempts:
                raise
    raise AssertionError("unreachable")


def _bind(host: str, port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.settimeout(_SOCKET_TIMEOUT_S)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(_BACKLOG)
    except BaseException:
        listener.close()
        raise
    return listener
