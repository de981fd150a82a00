"""Which tests need not have the machine to themselves.

`make test` runs three heaps, one after the other:

| heap | what is in it | how it runs |
|---|---|---|
| untimed | computes, or waits for what it wants as long as it takes | as many at a time as cores |
| waiting | all others: a process, a socket or a thread, most of the time asleep | three at a time |
| timed | whole sessions, and what has to keep up with real time | one after another |

A module is untimed if a pattern names it and nothing in its text speaks of what keeps time; what it
uses under another name is for the one who adds the pattern to look at. The patient ones start
processes or read a clock, and are untimed all the same.
"""

from __future__ import annotations

import re
from enum import StrEnum
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent


class Pace(StrEnum):
    """The heaps; the names are pytest's markers."""

    UNTIMED = "untimed"
    WAITING = "waiting"
    TIMED = "timed"


UNTIMED = (
    "calibration/*",
    "console/test_confirmations.py",
    "console/test_devices.py",
    "console/test_report.py",
    "console/test_status.py",
    "console/test_table.py",
    "faults/test_controller_*",
    "faults/test_host_stalls.py",
    "faults/test_video_freeze.py",
    "hw/sim/*",
    "hw/test_boundary.py",
    "hw/test_capture_*",
    "hw/test_lite6_codes.py",
    "hw/test_lite6_kinematics.py",
    "hw/test_make_camera.py",
    "hw/test_openvr_*",
    "hw/test_v4l2_controls.py",
    "hw/test_v4l2_devices.py",
    "mutation/*",
    "policy/*",
    "session/test_home_run.py",
    "session/test_homing.py",
    "session/test_observer.py",
    "session/test_recorded_hand.py",
    "session/test_status.py",
    "study/*",
    "test_*_benchmark.py",
    "test_capacity.py",
    "test_config.py",
    "test_hardware_profile.py",
    "test_house.py",
    "test_lite6_errors.py",
    "test_operator_calibration.py",
    "test_safety_document.py",
    "test_summary*.py",
    "test_pace.py",
    "video/lockstep/*",
    "video/test_frame_identity.py",
    "video/test_link.py",
    "video/test_loss.py",
    "video/test_networks.py",
    "video/test_packets.py",
    "video/test_picture_ring.py",
    "video/test_quality.py",
    "video/test_repair.py",
    "video/test_source_drop.py",
    "video/test_spare_pace.py",
    "video/test_ssim.py",
    "video/test_trace*",
)
PATIENT = (
    "calibration/test_cameras_latency.py",
    "calibration/test_cameras_wizard.py",
    "session/virtual/*",
    "study/test_cli.py",
    "study/test_unattended.py",
    "video/lockstep/test_against_rtpsession.py",  # under a stepped clock
    "video/lockstep/test_video.py",
)
TIMED = (
    "console/test_home.py",
    "console/test_trial.py",
    "console/test_windows.py",
    "faults/test_host_parts.py",
    "faults/test_host_processes.py",
    "faults/test_video_chain.py",
    "session/test_hardware.py",
    "test_cut_short.py",
    "test_end_to_end.py",
)
_THE_MACHINES_OWN = re.compile(
    r"^\s*(?:import|from) (?:socket|subprocess|threading|multiprocessing)\b"
    r"|\btime\.(?:sleep|monotonic|perf_counter)"
    r"|\b(?:MonotonicClock|HelperProcess|LossyLink|WiredBench)\b",
    re.MULTILINE,
)


@cache
def pace_of(module: Path) -> Pace:
    """Which heap the tests of this file are in."""
    if not module.is_relative_to(TESTS):
        return Pace.WAITING
    name = str(module.relative_to(TESTS))
    if _among(name, TIMED):
        return Pace.TIMED
    if _among(name, PATIENT):
        return Pace.UNTIMED
    if _among(name, UNTIMED) and not keeps_time(module.read_text(encoding="utf-8")):
        return Pace.UNTIMED
    return Pace.WAITING


def keeps_time(source: str) -> bool:
    """Whether the text of a module speaks of a process, a socket, a thread or a real clock."""
    return _THE_MACHINES_OWN.search(source) is not None


def _among(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatch(name, pattern) for pattern in patterns)
