"""What the import contracts of pyproject.toml cannot say; `make check` runs those themselves."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent


def test_a_session_with_real_devices_loads_no_simulator():
    load = (
        "import sys; sys.modules['mujoco'] = None\n"  # importing it raises ImportError
        "import tams_app.console.app, tams_app.robot.build, tams_app.robot.devices\n"
        "import tams_app.console.home, tams_app.robot.dry_run\n"
        "import hw.openvr.controller, hw.make_camera\n"
    )
    subprocess.run([sys.executable, "-c", load], cwd=ROOT, check=True, timeout=100)


def test_the_control_loop_imports_little():
    """What it works with is handed in: by it alone an arm moves, so that little may be read."""
    load = (
        "import sys, tams_app.robot.control\n"
        "ours = [name for name in sys.modules if name.startswith(('hw.', 'tams_app.'))]\n"
        "print(sum(not hasattr(sys.modules[name], '__path__') for name in ours))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", load], cwd=ROOT, check=True, timeout=100, capture_output=True
    )
    assert int(done.stdout) <= 40


@pytest.mark.parametrize("root", ["tams_app", "hw", "calibration"])
def test_what_a_package_names_as_public_can_be_imported(root):
    packages = [path.parent for path in sorted((ROOT / root).rglob("__init__.py"))]
    named = 0
    for package in packages:
        name = ".".join(package.relative_to(ROOT).parts)
        module = importlib.import_module(name)
        for public in getattr(module, "__all__", ()):
            named += 1
            if not hasattr(module, public):
                importlib.import_module(f"{name}.{public}")
    assert named
