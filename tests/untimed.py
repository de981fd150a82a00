"""Which tests need not have the machine to themselves.

A test is untimed if it only computes: nothing that the machine does at its own pace (another
process, a socket, a thread, a real clock) has a say in its outcome. `make test` runs these side by
side, as many as there are cores, and all others one after another. A module is untimed if a pattern
names it and nothing in its text speaks of such a thing; what it uses under another name is for the
one who adds the pattern to look at. So are the patient ones, which start processes or read a clock
but wait for what they want as long as it takes.
"""

from __future__ import annotations

import re
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

TESTS = Path(__file__).parent
UNTIMED = (
    "calibration/*",
    "faults/test_controller_*",
    "faults/test_host_stalls.py",
    "faults/test_video_freeze.py",
    "hw/sim/*",
    "hw/test_boundary.py",
    "hw/test_capture_*",
    "hw/test_lite6_kinematics.py",
    "hw/test_openvr_*",
    "mutation/*",
    "policy/*",
    "study/*",
    "test_capacity.py",
    "test_config.py",
    "test_hardware_profile.py",
    "video/lockstep/*",
    "video/test_frame_identity.py",
    "video/test_link.py",
    "video/test_loss.py",
    "video/test_picture_ring.py",
    "video/test_quality.py",
    "video/test_ssim.py",
    "video/test_trace*",
)
TIMED_AMONG_THEM = (
    "hw/sim/test_published_world.py",  # a rig process
    "study/test_dask_pool.py",  # worker processes
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
_THE_MACHINES_OWN = re.compile(
    r"^\s*(?:import|from) (?:socket|subprocess|threading|multiprocessing)\b"
    r"|\btime\.(?:sleep|monotonic|perf_counter)"
    r"|\b(?:MonotonicClock|HelperProcess|LossyLink|WiredBench)\b",
    re.MULTILINE,
)


@cache
def is_untimed(module: Path) -> bool:
    """Whether the tests of this file may run beside others."""
    if not module.is_relative_to(TESTS):
        return False
    name = str(module.relative_to(TESTS))
    if any(fnmatch(name, pattern) for pattern in TIMED_AMONG_THEM):
        return False
    if any(fnmatch(name, pattern) for pattern in PATIENT):
        return True
    named = any(fnmatch(name, pattern) for pattern in UNTIMED)
    return named and not keeps_time(module.read_text(encoding="utf-8"))


def keeps_time(source: str) -> bool:
    """Whether the text of a module speaks of a process, a socket, a thread or a real clock."""
    return _THE_MACHINES_OWN.search(source) is not None
