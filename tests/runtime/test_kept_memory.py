"""Memory kept for the next images."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.waiting

# Pages that the kernel provides for 50 times three images of 1.2 MB, which are then let go.
COUNT = """
import resource
import numpy as np
from tams_app.runtime.kept_memory import keep_freed_memory

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
