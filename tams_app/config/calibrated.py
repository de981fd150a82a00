"""The calibration of a setup: the measured files that are laid over a configuration.

A set is a folder `calibration/<name>/` beside the configuration file. Its `in-force.yaml` names one
file for each kind; each file holds where it comes from (`calibration`) and a part of a
configuration (`config`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tams_app.config.yaml_file import read_yaml, writable_directory
from tams_app.errors import ConfigError, not_one_of

FOLDER = "calibration"
IN_FORCE = "in-force.yaml"
# What a calibration may change: nothing that bounds the motion of the arm.
KEYS_BY_KIND: dict[str, tuple[str, ...]] = {
    "cameras": ("cameras",),
    "frame": ("hand.rotation", "hand.translation_scale", "controller.mapping"),
    "phases": ("policy.phases",),
    "weights": ("policy.weights",),
}
_ADVICE = "correct it, or run `run_tams.py calibrate {kind}` again"


@dataclass(frozen=True, slots=True)
class Calibrated:
    """The changes of a file in force, and whether any part of it was simulated."""

    file: Path
    changes: dict[str, Any]
    simulated: bool


def set_folder(config_path: Path, name: str) -> Path:
    """The folder of the set `name` of the configuration at `config_path`."""
    return writable_directory(config_path) / FOLDER / name


def files_in_force(folder: Path) -> dict[str, Path]:
    """The files of a set by kind, none if nothing was calibrated; ConfigError if one is gone."""
    index = folder / IN_FORCE
    if not index.is_file():
        return {}
    files = {}
    for kind, name in read_yaml(index).items():
        if kind not in KEYS_BY_KIND:
            raise ConfigError(f"{index}: {not_one_of(kind, KEYS_BY_KIND)}")
        if not isinstance(name, str) or Path(name).name != name:
            raise ConfigError(f"{index}: {kind}: must be the name of a file in this folder")
        path = folder / name
        if not path.is_file():
            raise ConfigError(f"{index}: {kind}: there is no {name}: {_ADVICE.format(kind=kind)}")
        files[kind] = path
    return files


def read_calibrated(path: Path, kind: str) -> Calibrated:
    """The changes in a calibration file; ConfigError if it oversteps."""
    content = read_yaml(path)
    changes = content.get("config")
    if not isinstance(changes, dict) or not changes:
        raise ConfigError(f"{path}: config: must hold what was calibrated")
    if key := overstepping_key(changes, kind):
        raise ConfigError(f"{path}: config.{key}: is not for a {kind} calibration to set")
    origin = content.get("calibration")
    simulated = isinstance(origin, dict) and origin.get("simulated") is True
    return Calibrated(path, changes, simulated)


def overstepping_key(changes: Mapping[str, Any], kind: str) -> str:
    """The first dotted key of `changes` that a calibration of this kind may not set, or ""."""
    allowed = KEYS_BY_KIND[kind]
    for key in _dotted(changes, ""):
        if not any(key == one or key.startswith(one + ".") for one in allowed):
            return key
    return ""


def sets(changes: Mapping[str, Any], key: str) -> bool:
    """True if `changes` hold the dotted `key`, a part of it, or what it is a part of."""
    return any(
        set_key == key or set_key.startswith(key + ".") or key.startswith(set_key + ".")
        for set_key in _dotted(changes, "")
    )


def _dotted(part: Mapping[str, Any], prefix: str) -> Iterator[str]:
    for name, value in part.items():
        key = f"{prefix}{name}"
        if isinstance(value, Mapping) and value:
            yield from _dotted(value, key + ".")
        else:
            yield key
