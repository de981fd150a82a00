"""Looks whether a Lite 6 answers at an address, without moving, stopping or configuring it.

Plain requests on a short-lived connection of our own: the SDK would wait for minutes for a silent
controller, and its connecting is a write.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from hw.lite6.codes import AXES, LITE6_TYPE, Register, ReplyBit, State
from hw.lite6.errors import standing_error_sentence
from hw.lite6.report import read_simulation_flag
from hw.lite6.uxbus import UxbusClient
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError

PROBE_TIMEOUT_S = 1.0
MIN_FIRMWARE = (1, 8, 0)  # older ones drop `duration`, the controller's own deadman

# axes, type, serial numbers of arm and control box, firmware (SDK x3/base.py, `_check_version`)
_VERSION = re.compile(r"(\d+),(\d+),(.*),(.*),.*?[vV]*(\d+)\.(\d+)\.(\d+)")


@dataclass(frozen=True, slots=True)
class ArmInfo:
    """What one address says of itself; `problem` is one sentence, "" if TAMS can use it."""

    host: str
    reachable: bool
    problem: str
    axes: int | None = None
    device_type: int | None = None  # 9 is the Lite 6
    serial: str = ""
    firmware: tuple[int, int, int] | None = None
    state: int | None = None
    error_code: int | None = None
    simulated: bool | None = None  # only pretends to move

    @property
    def is_lite6(self) -> bool:
        return (self.axes, self.device_type) == (AXES, LITE6_TYPE)

    @property
    def description(self) -> str:
        """In one line."""
        if not self.reachable or self.firmware is None:
            return f"{self.host}: {self.problem}"
        kind = "Lite 6" if self.is_lite6 else f"{self.axes} axes, type {self.device_type}"
        firmware = _dotted(self.firmware)
        facts = f"{self.host}: {kind} {self.serial}, firmware {firmware}, {self._standing}"
        return f"{facts}. {self.problem}" if self.problem else facts

    @property
    def _standing(self) -> str:
        if self.state is None:
            return "state unknown"
        known = self.state in State.__members__.values()
        return State(self.state).name.lower() if known else f"state {self.state}"


def find_arm(config: ArmConfig, timeout_s: float = PROBE_TIMEOUT_S) -> ArmInfo:
    """What answers at the configured address; takes a few `timeout_s` at most."""
    host, control_port, report_port = config.host, config.control_port, config.report_port
    client = UxbusClient(host, control_port)
    try:
        client.connect(timeout_s)
    except DeviceError as error:
        return ArmInfo(host, reachable=False, problem=str(error))
    try:
        version = client.request(Register.GET_VERSION, b"", timeout_s)
        state = client.request(Register.GET_STATE, b"", timeout_s)
        error_codes = client.request(Register.GET_ERROR, b"", timeout_s)
    except OSError:
        problem = f"Something at {host}:{control_port} answers, but not like an arm; see arm.host."
        return ArmInfo(host, reachable=True, problem=problem)
    finally:
        client.close()
    found = _VERSION.match(version.data.decode("ascii", "replace"))
    if found is None or version.status & ReplyBit.INVALID or not state.data or not error_codes.data:
        problem = f"The arm at {host} does not say what it is; update its firmware."
        return ArmInfo(host, reachable=True, problem=problem)
    axes, kind, serial, _, *numbers = found.groups()
    firmware = (int(numbers[0]), int(numbers[1]), int(numbers[2]))
    simulated, silence = _simulated(host, report_port)
    error_code = error_codes.data[0]
    problem = silence or unfitness(int(axes), int(kind), firmware, bool(simulated))
    if error_code and not problem:
        problem = standing_error_sentence(error_code)
    return ArmInfo(
        host=host,
        reachable=True,
        problem=problem,
        axes=int(axes),
        device_type=int(kind),
        serial=serial.strip(),
        firmware=firmware,
        state=state.data[0],
        error_code=error_code,
        simulated=simulated,
    )


def unfitness(axes: int, device_type: int, firmware: tuple[int, ...], simulated: bool) -> str:
    """Why TAMS cannot use an arm that is what it is, in one sentence; "" if it can."""
    if (axes, device_type) != (AXES, LITE6_TYPE):
        return (
            f"The arm is no Lite 6 (axes {axes}, type {device_type}); set arm.host to the Lite 6."
        )
    if firmware < MIN_FIRMWARE:
        return (
            f"The arm's firmware {_dotted(firmware)} is older than {_dotted(MIN_FIRMWARE)} and "
            "would not stop by itself when commands cease; update it with UFACTORY Studio."
        )
    if simulated:
        return "The arm only pretends to move; switch its simulation mode off in UFACTORY Studio."
    return ""


def _dotted(firmware: tuple[int, ...]) -> str:
    return ".".join(map(str, firmware))


def _simulated(host: str, report_port: int) -> tuple[bool | None, str]:
    """Whether the arm only pretends to move; None, and a sentence, if it does not report."""
    try:
        return read_simulation_flag(host, report_port), ""
    except DeviceError as error:
        return None, str(error)
