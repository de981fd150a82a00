"""A configuration of the rig whose set of calibrations is `lab`, and the files of that set."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from tams_app.config import load_config


def write_lab(folder: Path, **more: object) -> Path:
    """The configuration, with `more` keys; its path."""
    path = folder / "lab.yaml"
    content = {"version": 1, "include": ["networks.yaml", "weights.yaml"], "calibration": "lab"}
    path.write_text(yaml.safe_dump(content | more))
    return path


def files(path: Path, kind: str) -> list[Path]:
    """All calibrations of a kind that were kept for the configuration at `path`."""
    return sorted((path.parent / "calibration/lab").glob(f"{kind}-*.yaml"))


def in_force(path: Path) -> tuple[Path, dict[str, Any]]:
    """The one calibration that the configuration at `path` uses, and what is in it."""
    (name,) = load_config(path).calibrated_by
    file = path.parent / "calibration/lab" / name
    return file, yaml.safe_load(file.read_text(encoding="utf-8"))
