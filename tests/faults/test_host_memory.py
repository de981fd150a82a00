"""A /dev/shm of any size, as containers have: a session fits, or is refused before it starts.

Memory that was promised and is not there would end the application by SIGBUS while the arm moves.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tams_app.config import load_config
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.session.folder import session_bytes
from tests.faults.applications import FPS, configuration_file

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.verify,
    pytest.mark.timeout(300),
]
SETTINGS = {
    "headless": True,
    "rig.enabled": True,
    "rig.operator.kind": "seeing",
    "seconds": 25.0,
    "video.fps": FPS,
    "recording.min_free_mb": 1.0,
}
WITH_OWN_MEMORY = 'mount -t tmpfs -o size="$0" tmpfs /dev/shm && exec "$@"'


def started(folder: Path, size: int) -> subprocess.Popen[str]:
    """A session whose /dev/shm has `size` bytes."""
    path = configuration_file(folder, SETTINGS | {"recording.directory": str(folder / "logs")})
    session = [sys.executable, "run_tams.py", "run", "--config", str(path)]
    inside = ["unshare", "--map-root-user", "--mount", "sh", "-c", WITH_OWN_MEMORY, str(size)]
    return subprocess.Popen(
        [*inside, *session],
        cwd=PROJECT_DIRECTORY,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.mark.parametrize("size_mb", [16, 48, 64])
def test_a_session_without_room_is_refused_in_one_sentence_before_it_starts(
    tmp_path: Path, size_mb: int
) -> None:
    process = started(tmp_path, size_mb << 20)
    _, words = process.communicate()
    assert process.returncode == 1
    (sentence,) = words.splitlines()
    assert sentence.startswith("tams: /dev/shm has no room for ")
    assert not (tmp_path / "logs").exists()


def test_a_session_runs_in_as_much_as_it_asks_for(tmp_path: Path) -> None:
    asked = session_bytes(load_config(None, SETTINGS))
    process = started(tmp_path, -(-asked // 1_000_000) * 1_000_000)
    used = 0
    while process.poll() is None:
        time.sleep(0.1)
        try:
            found = os.statvfs(Path("/proc", str(process.pid), "root", "dev", "shm"))
        except OSError:  # it has ended
            continue
        if found.f_blocks * found.f_frsize < 2 * asked:  # else it is still ours
            used = max(used, (found.f_blocks - found.f_bfree) * found.f_frsize)
    _, words = process.communicate()
    assert (process.returncode, words) == (0, "")
    assert 0.8 * asked < used <= asked
