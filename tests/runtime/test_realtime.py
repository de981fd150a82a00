"""Priorities of what was started with less than others, by a user who may not raise them."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.waiting

_UNPRIVILEGED = """
import os, resource
from tams_app.runtime.realtime import use_nice, use_ordinary
resource.setrlimit(resource.RLIMIT_NICE, (0, 0))
if os.geteuid() == 0:
    os.setresgid(65534, 65534, 65534)
    os.setresuid(65534, 65534, 65534)
"""


def printed(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", _UNPRIVILEGED + code], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("nicer", [0, 5, 15])
def test_a_process_may_be_started_nicer_than_it_would_be(nicer: int) -> None:
    code = f"given = os.nice({nicer}); use_nice(-10, 5); print(os.nice(0) == max(given, 5))"
    assert printed(code) == "True"


@pytest.mark.parametrize("policy", ["SCHED_IDLE", "SCHED_BATCH", "SCHED_OTHER"])
def test_a_policy_that_is_not_real_time_is_kept(policy: str) -> None:
    code = f"""
os.sched_setscheduler(0, os.{policy}, os.sched_param(0))
use_ordinary()
print(os.sched_getscheduler(0) == os.{policy})
"""
    assert printed(code) == "True"


# Pages that the kernel provides for 50 times three images of 1.2 MB, which are then let go.
COUNT = """
import resource
import numpy as np
from tams_app.runtime.realtime import keep_freed_memory

def images():
    return [np.ones((480, 640), np.float32) for _ in range(3)]

{prepare}
images()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(50):
    images()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def new_pages(prepare: str) -> int:
    program = COUNT.format(prepare=prepare)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True)
    return int(done.stdout)


def test_images_take_the_memory_of_those_before_them() -> None:
    assert new_pages("keep_freed_memory()") < 900  # one set of three; without: one each time
    assert new_pages("") > 10 * 900
