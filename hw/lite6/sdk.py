"""UFACTORY's SDK made fit for an application: quiet, leaving no traces, on a port of our own.

What the SDK does unasked, and is kept from here (FINDINGS 8): on import it prints and makes
~/.UFACTORY; on every connect it prints. Its own port, in whose place `ControlPort` is, sets the
default time-out of all new sockets of the process, prefers a Unix socket in the temporary folder,
which anybody on the host could make, and reads replies in a thread that hands them over in a queue,
so that each command waits for two wakes.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import io
import logging
import os
import select
import socket
import struct
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from queue import Queue
from typing import Any

from hw.lite6.protocol import Code, Mode, Register, UxbusFrame
from tams_app.errors import DeviceError, SetupError

CONNECT_TIMEOUT_S = 1.0
_LENGTH = struct.Struct(">4xH")  # of what follows this header
_LEAST_BYTES = _LENGTH.size + 2  # register and status
_FEEDBACK_REGISTER = 0xFF  # unasked; the SDK's feedback thread takes it
_RECEIVE_BYTES = 4096
_FAILED = -1
_JOIN_S = 2.0
_SOCKADDR_BYTES = 16
_VELOCITY = struct.Struct("<6fBf")  # x y z [mm/s], about x y z [rad/s], frame, duration [s]
_BASE_FRAME = 0
_HEADER_BYTES, _REGISTER_AT = 4, 6  # transaction and protocol; then the length
_ANOTHER_TRANSACTION = 5  # `XCONF.UxbusState.ERR_NUM`
_LAST_TRANSACTION = 0xFFFF  # then 1 again

_log = logging.getLogger(__name__)

# The SDK finds the class of its port in a global: one connect at a time.
_lock = threading.Lock()


class _ForwardToLog(logging.Handler):
    """Carries the SDK's own log, which goes to stdout, to this module's logger at debug level."""

    def emit(self, record: logging.LogRecord) -> None:
        _log.debug("%s", record.getMessage())


class ControlPort:
    """One control connection; the thread that waits for a reply reads it.

    Requests and their replies are one thread's at a time: the SDK's lock around each command sees
    to that. Replies that come too late are left to the SDK, which knows them by their transaction.
    The methods are named, and report errors, as the SDK expects it of a port.
    """

    def __init__(self, host: str, port: int, feedback: Queue[bytes]) -> None:
        """Connect; OSError if nothing answers."""
        self.com = socket.create_connection((host, port), CONNECT_TIMEOUT_S)
        self.com.setblocking(False)
        self._readable = select.poll()
        self._readable.register(self.com, select.POLLIN)
        self._feedback = feedback
        self._received = bytearray()
        self.connected = True

    def write(self, data: bytes) -> int:
        """Send a request; 0, or -1 if it cannot be sent whole: the connection is given up then."""
        if not self.connected:
            return _FAILED
        try:
            sent = self.com.send(data)
        except OSError as error:
            self._lose(error)
            return _FAILED
        if sent < len(data):  # what followed would be read as the rest of it
            self._lose(ConnectionError(f"{sent} of {len(data)} bytes were sent"))
            return _FAILED
        return 0

    def read(self, timeout: float) -> bytes | int:
        """The next reply; -1 if none comes within `timeout` [s] or the connection is gone."""
        deadline = time.monotonic() + timeout
        while self.connected:
            frame = self._next_frame()
            if frame is not None:
                return frame
            left_ms = (deadline - time.monotonic()) * 1000.0
            if left_ms <= 0.0 or not self._readable.poll(left_ms):
                return _FAILED
            try:
                data = self.com.recv(_RECEIVE_BYTES)
            except BlockingIOError:
                continue
            except OSError as error:
                self._lose(error)
            else:
                self._received += data
                if not data:
                    self._lose(ConnectionResetError("the arm closed the connection"))
        return _FAILED

    def flush(self) -> int:
        """Nothing waits here but what the SDK passes over by itself."""
        return 0 if self.connected else _FAILED

    def close(self) -> None:
        """Disconnect; may be called twice, also while another thread reads."""
        self.connected = False
        with contextlib.suppress(OSError):  # it was not connected any more
            self.com.shutdown(socket.SHUT_RDWR)
        self.com.close()

    def join(self) -> None:
        """There is no thread to wait for."""

    def _next_frame(self) -> bytes | None:
        """The first whole reply of what was received."""
        received = self._received
        while len(received) >= _LENGTH.size:
            end = _LENGTH.size + _LENGTH.unpack_from(received)[0]
            if end < _LEAST_BYTES:
                self._lose(ConnectionError(f"a reply of {end} bytes"))
                return None
            if len(received) < end:
                return None
            frame = bytes(received[:end])
            del received[:end]
            if frame[_REGISTER_AT] != _FEEDBACK_REGISTER:
                return frame
            self._feedback.put(frame)
        return None

    def _lose(self, error: OSError) -> None:
        self.connected = False
        _log.debug("The arm's connection is lost: %s", error)


def connect_sdk(host: str, control_port: int) -> Any:
    """A connected `XArmAPI` in radians; DeviceError if the controller does not play along.

    Reports are read elsewhere (hw/lite6/report.py), so the SDK's own report thread, which polls
    every millisecond, stays off. The caller has seen that the controller answers: the SDK would
    ask a silent one for its version for minutes.
    """
    with _lock:
        arm_api, base = _load()
        api = arm_api(
            _address(host),
            is_radian=True,
            do_not_open=True,
            enable_report=False,
            timed_comm=False,  # hw/lite6/sender.py has its own keep-alive
            check_is_pause=False,  # would block for ever in state 3
            check_cmdnum_limit=False,  # would ask for the queue length before each call
        )
        try:
            with _own_port(base, host, control_port):
                api.connect()
        except Exception as error:  # the SDK raises nothing more precise
            disconnect_sdk(api)
            raise DeviceError(
                f"The arm at {host}:{control_port} broke off the connection ({error}); "
                "restart its control box."
            ) from error
    api._arm._is_sync = True  # without its report thread `set_servo_angle` would wait for this
    return api


def disconnect_sdk(api: Any) -> None:
    """Disconnect and end the SDK's threads."""
    if api._arm._stream is None:
        return
    api.disconnect()
    feedback = api._arm._feedback_thread
    if feedback is not None:
        api._arm._feedback_que.put(bytes(16))  # it looks up from its queue once a second only
        feedback.join(_JOIN_S)


def break_off(api: Any) -> None:
    """Take back what was sent and not acknowledged, and reset the connection; does not block.

    Connecting a TCP socket to no address (AF_UNSPEC, connect(2)) empties its send queue and sends a
    reset. Closing it, even with SO_LINGER 0, does that only once nothing waits on it any more.
    """
    connection = api._arm._stream.com
    number = connection.fileno()
    if number < 0:  # the SDK has closed it: it was broken
        return
    nowhere = ctypes.create_string_buffer(_SOCKADDR_BYTES)  # zeros: AF_UNSPEC
    if ctypes.CDLL(None, use_errno=True).connect(number, nowhere, _SOCKADDR_BYTES) != 0:
        _log.warning("The arm's connection is not reset: %s", os.strerror(ctypes.get_errno()))


def note_mode(api: Any, mode: Mode) -> None:
    """Give the SDK the mode it would learn from its report thread; otherwise it warns per call."""
    api._arm._mode = int(mode)


def set_collision_sensitivity(api: Any, value: int) -> int:
    """As the SDK's own, which makes the controller ready afterwards (`set_state(0)`), unasked."""
    return int(api._arm.arm_cmd.set_collis_sens(value)[0])


def set_cartesian_velocity(api: Any, speeds: Sequence[float], duration_s: float) -> int:
    """The return code of `vc_set_cartesian_velocity`, in the base frame and with a duration.

    The same frame over the same connection. The SDK's own packs and unpacks byte by byte: half of
    what a command costs, 120 times a second.
    """
    commands, register = api._arm.arm_cmd, Register.SET_CARTESIAN_VELOCITY
    payload = _VELOCITY.pack(*speeds, _BASE_FRAME, duration_s)
    with commands.lock:
        number = commands._transaction_id
        request = UxbusFrame(number, commands._protocol_identifier, register, payload).encode()
        if commands.arm_port.write(request) != 0:
            return Code.NOT_SENT
        commands._transaction_id = number % _LAST_TRANSACTION + 1
        code = _code_of_reply(commands, request, number)
    return int(api._arm._check_code(code, is_move_cmd=True, mode=Mode.CARTESIAN_VELOCITY))


def _code_of_reply(commands: Any, request: bytes, number: int) -> int:
    """The code in the reply to `request`; replies to earlier ones are passed over."""
    header, register = request[:_HEADER_BYTES], request[_REGISTER_AT]
    deadline = time.monotonic() + commands._S_TOUT
    while True:
        reply = commands.arm_port.read(deadline - time.monotonic())
        if reply == -1:
            return Code.TIMEOUT
        if reply[:_HEADER_BYTES] == header and reply[_REGISTER_AT] == register:
            return int(commands.check_private_protocol(reply))
        protocol = commands._protocol_identifier
        code = int(commands.check_protocol_header(reply, number, protocol, register))
        if code != _ANOTHER_TRANSACTION:
            return code


def _address(host: str) -> str:
    """The SDK takes anything but an IPv4 address for a serial port."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise DeviceError(f"The name {host} is unknown; set arm.host to an address.") from error


@contextlib.contextmanager
def _own_port(base: Any, host: str, control_port: int) -> Iterator[None]:
    """Let the SDK connect by a `ControlPort` to `control_port`, for which it has no option.

    To `host` as all connections to the arm: of a name, each address is tried in turn. Put back at
    once: other connections of this process keep the SDK's own.
    """
    theirs = base.SocketPort
    base.SocketPort = lambda *_, fb_que, **__: ControlPort(host, control_port, fb_que)
    try:
        yield
    finally:
        base.SocketPort = theirs


@functools.cache
def _load() -> tuple[Any, Any]:
    """`XArmAPI` and the module that connects it, imported once without traces; or SetupError."""
    try:
        with _elsewhere_at_home(), contextlib.redirect_stdout(io.StringIO()):
            from xarm.core.utils import log
            from xarm.wrapper import XArmAPI
            from xarm.x3 import base
    except ImportError as error:
        raise SetupError(
            f"The arm's SDK cannot be loaded ({error}); install xArm-Python-SDK."
        ) from error
    base.print = lambda *_, **__: None  # what it prints on connecting is in the log anyway
    log.logger.handlers[:] = [_ForwardToLog()]
    log.origin_logger.handlers[:] = [_ForwardToLog()]
    log.origin_logger.propagate = False
    return XArmAPI, base


@contextlib.contextmanager
def _elsewhere_at_home() -> Iterator[None]:
    """The SDK makes a log folder in $HOME on import, and fails where it may not."""
    home = os.environ.get("HOME")
    with tempfile.TemporaryDirectory(prefix="tams-") as directory:
        os.environ["HOME"] = directory
        try:
            yield
        finally:
            if home is None:
                del os.environ["HOME"]
            else:
                os.environ["HOME"] = home
