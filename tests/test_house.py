"""The rules of the house: who may know whom."""

import ast
from pathlib import Path

import pytest

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
PURE_ROOMS = ("tams_app/teleop", "tams_app/policy")
FORBIDDEN_IN_PURE_ROOMS = {
    "threading",
    "time",
    "socket",
    "subprocess",
    "os",
    "pathlib",
    "random",
    "hw",
    "gi",
}
# room -> what its modules must never import
WALLS = {
    "tams_app/teleop": ("tams_app.policy", "tams_app.video", "tams_app.session", "hw"),
    "tams_app/policy": ("tams_app.teleop", "tams_app.video", "tams_app.session", "hw"),
    "tams_app/video": ("tams_app.teleop", "tams_app.policy", "tams_app.session", "hw"),
    "tams_app/recording": ("tams_app.session", "tams_app.console", "hw"),
    "tams_app/summary": ("tams_app.session", "tams_app.console", "hw"),
    "tams_app/study": ("tams_app.session", "tams_app.console", "hw"),
    "tams_app/session": ("tams_app.console", "calibration"),
    "hw": ("tams_app.session", "tams_app.teleop", "tams_app.policy", "tams_app.video"),
}


def imports(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def modules(room):
    found = sorted((ROOT / room).rglob("*.py"))
    assert found, f"{room} is empty"
    return found


@pytest.mark.parametrize("room", PURE_ROOMS)
def test_pure_rooms_know_no_threads_files_hardware_or_wall_clock(room):
    for path in modules(room):
        used = {name.split(".")[0] for name in imports(path)} & FORBIDDEN_IN_PURE_ROOMS
        assert not used, f"{path} imports {used}"


@pytest.mark.parametrize("room", WALLS)
def test_no_room_imports_one_further_out(room):
    for path in modules(room):
        for name in imports(path):
            for wall in WALLS[room]:
                through = name == wall or name.startswith(wall + ".")
                assert not through, f"{path} imports {name}"


def test_threads_are_made_by_the_session_the_drivers_and_worker_only():
    allowed = ("tams_app/session/", "tams_app/runtime/worker.py", "tams_app/runtime/process.py")
    for path in modules("tams_app"):
        relative = path.relative_to(ROOT).as_posix()
        if not relative.startswith(allowed):
            text = path.read_text(encoding="utf-8")
            assert "threading.Thread(" not in text, relative
