"""The packages of the extra `ros2`, which TAMS works without."""

from __future__ import annotations

from importlib.util import find_spec

from tams_app.errors import SetupError

_PACKAGES = ("cyclonedds", "rosbags")


def require_extra(what: str) -> None:
    """SetupError that names `what` unless the extra `ros2` is installed; imports nothing."""
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise SetupError(f"{what} needs {' and '.join(missing)}: pip install 'tams[ros2]'")
