"""Looks whether a Lite 6 answers at an address, without moving, stopping or configuring it.

Plain requests on a short-lived connection of our own: the SDK would wait for minutes for a silent
controller, and its connecting is a write.
"""

from __future__ import annotations

import re

from hw.arm import FoundArm
from hw.lite6.commands import standing_error_sentence
from hw.lite6.protocol import AXES, LITE6_TYPE, Register, ReplyBit, State, UxbusClient
from hw.lite6.report import StatusReport, read_status
from hw.lite6.settings import dotted, foreign_refusal, other_settings, unfitness
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError

PROBE_TIMEOUT_S = 1.0

# axes, type, serial numbers of arm and control box, firmware (SDK x3/base.py, `_check_version`)
_VERSION = re.compile(r"(\d+),(\d+),(.*),(.*),.*?[vV]*(\d+)\.(\d+)\.(\d+)")


def find_arm(config: ArmConfig, timeout_s: float = PROBE_TIMEOUT_S) -> FoundArm:
    """Ask what answers at the configured address; takes a few `timeout_s` at most."""
    host = config.host
    try:
        problem, facts = _ask(config, timeout_s)
    except DeviceError as error:
        return FoundArm(str(error), f"{host}: {error}")
    return FoundArm(problem, f"{host}: {facts}. {problem}" if problem else f"{host}: {facts}")


def _ask(config: ArmConfig, timeout_s: float) -> tuple[str, str]:
    """The problem and what the arm is, in one line; DeviceError if that cannot be determined."""
    host, control_port = config.host, config.control_port
    client = UxbusClient(host, control_port)
    client.connect(timeout_s)
    try:
        version_status, version = client.request(Register.GET_VERSION, b"", timeout_s)
        _, state = client.request(Register.GET_STATE, b"", timeout_s)
        _, error_codes = client.request(Register.GET_ERROR, b"", timeout_s)
    except OSError as error:
        raise DeviceError(
            f"Something at {host}:{control_port} answers, but not like an arm; see arm.host."
        ) from error
    finally:
        client.close()
    found = _VERSION.match(version.decode("ascii", "replace"))
    if found is None or version_status & ReplyBit.INVALID or not state or not error_codes:
        raise DeviceError(f"The arm at {host} does not say what it is; update its firmware.")
    axes, kind, *numbers = (int(number) for number in found.group(1, 2, 5, 6, 7))
    try:
        status = read_status(host, config.report_port)
        problem = unfitness(axes, kind, tuple(numbers)) or foreign_refusal(status)
        notes = _notes(config, status)
    except DeviceError as silence:
        problem, notes = str(silence), ""
    problem = problem or standing_error_sentence(error_codes[0])
    what = "Lite 6" if (axes, kind) == (AXES, LITE6_TYPE) else f"{axes} axes, type {kind}"
    known = state[0] in State.__members__.values()
    doing = State(state[0]).name.lower() if known else f"state {state[0]}"
    named = f"{what} {found.group(3).strip()}, firmware {dotted(tuple(numbers))}"
    return problem, f"{named}, {doing}{notes}"


def _notes(config: ArmConfig, status: StatusReport) -> str:
    """What else the operator may want to know of it."""
    others = ", ".join(other_settings(config, None, status))
    replaced = f"; connecting replaces its {others}" if others else ""
    opened = "; a stop switches its gripper off" if status.clears_outputs else ""
    return f", motors at most {max(status.temperatures_c)} °C{replaced}{opened}"
