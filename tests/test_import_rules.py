"""What the import contracts of pyproject.toml cannot say; `make check` runs those themselves.

What breaks a rule of shape today is in `sizes.toml`, in lists that may only shrink.
"""

import ast
import importlib
import subprocess
import sys
import tomllib
from collections import Counter
from functools import cache
from pathlib import Path

import pytest

pytestmark = pytest.mark.untimed

ROOT = Path(__file__).parent.parent
PRODUCT = ("tams_app", "hw", "calibration")
ALLOWED = tomllib.loads((ROOT / "sizes.toml").read_text("utf-8"))["allowed"]
MOST_PARAMETERS = 8
SHORT_LINES = 60


@cache
def trees() -> dict[str, ast.Module]:
    """The product's modules, parsed, by their dotted names."""
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): ast.parse(path.read_text("utf-8"))
        for folder in PRODUCT
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path.name not in ("__init__.py", "__main__.py")
    }


def loaded(*names: str) -> set[str]:
    """Modules that a new process has once it imported these."""
    load = f"import sys, {', '.join(names)}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", load], cwd=ROOT, check=True, timeout=100, capture_output=True
    )
    return set(done.stdout.decode().split())


def test_no_two_classes_of_the_product_have_one_name():
    classes = (node for tree in trees().values() for node in tree.body)
    counts = Counter(node.name for node in classes if isinstance(node, ast.ClassDef))
    assert sorted(name for name, n in counts.items() if n > 1) == ALLOWED["class_names"]


def test_no_function_takes_more_than_eight_parameters():
    found = []
    for name, tree in trees().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                taken = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                if sum(one.arg not in ("self", "cls") for one in taken) > MOST_PARAMETERS:
                    found.append(f"{name}.{node.name}")
    assert sorted(found) == ALLOWED["many_parameters"]


def test_a_short_module_has_at_least_two_importers():
    importers = Counter()
    for tree in trees().values():
        named = set()
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                named |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                named |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        importers.update(named)
    short = [
        name
        for name in trees()
        if len((ROOT / name.replace(".", "/")).with_suffix(".py").read_text().splitlines())
        < SHORT_LINES
    ]
    assert [name for name in short if importers[name] < 2] == ALLOWED["short_modules"]


def test_a_session_with_real_devices_loads_nothing_of_the_simulated_rig_and_no_simulator():
    found = loaded(
        "tams_app.session.run", "tams_app.session.robot", "tams_app.session.operate",
        "tams_app.robot.devices", "tams_app.console.home", "tams_app.robot.dry_run",
        "tams_app.console.app", "tams_app.robot.build", "hw.openvr.controller", "hw.make_camera",
    )  # fmt: skip
    assert not [name for name in found if name.startswith("hw.sim") or name == "mujoco"]


def test_neither_side_loads_viewers_or_the_console():
    found = loaded("tams_app.robot.side", "tams_app.station.hand", "tams_app.station.receivers")
    above = ("tams_app.telemetry", "tams_app.console")
    assert not [name for name in found if name.startswith(above)]


def test_a_session_with_a_window_loads_nothing_that_only_some_sessions_need():
    found = loaded("tams_app.console.app", "tams_app.faces.session_face")
    others = (
        "tams_app.study", "tams_app.summary", "tams_app.report", "tams_app.console.report",
        "tams_app.link", "tams_app.prediction", "tams_app.ros2", "tams_app.export",
        "tams_app.recording.reader", "tams_app.recording.reference", "tams_app.telemetry.gate",
        "tams_app.robot.dry_run", "tams_app.robot.episode_keeper", "tams_app.robot.trial",
        "tams_app.task.judge", "tams_app.station.rig_operator", "calibration",
    )  # fmt: skip
    assert not [name for name in found if name.startswith(others)]


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


@pytest.mark.parametrize("name", ["run", "robot", "operate", "virtual/trial"])
def test_a_session_is_a_short_composition(name):
    """Of two sides or one; what makes it long belongs into a side."""
    lines = (ROOT / "tams_app" / "session" / f"{name}.py").read_text().splitlines()
    imports = [line for line in lines if line.startswith(("from tams_app", "from hw"))]
    classes = [line for line in lines if line.startswith("class ")]
    assert len(lines) <= 120
    assert len(imports) <= 12
    assert not [line for line in classes if "(" in line], "composed, not inherited"


@pytest.mark.parametrize("root", PRODUCT)
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
