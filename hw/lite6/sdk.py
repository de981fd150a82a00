"""UFACTORY's SDK made fit for an application: quiet, leaving no traces, on a port of our own.

What the SDK does unasked, and is kept from here (FINDINGS 8): on import it prints and makes
~/.UFACTORY; on every connect it prints. Its own port (hw/lite6/control_port.py takes its place)
sets the default time-out of all new sockets of the process and prefers a Unix socket in the
temporary folder, which anybody on the host could make.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import io
import logging
import os
import socket
import struct
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

from hw.lite6.codes import Code, Mode, Register
from hw.lite6.control_port import ControlPort
from hw.lite6.uxbus import UxbusFrame
from tams_app.errors import DeviceError, SetupError

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
