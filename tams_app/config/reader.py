"""Reading and writing a checked configuration; every error names file, key and reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from tams_app.config.calibrated import Calibrated, files_in_force, read_calibrated, set_folder, sets
from tams_app.config.section import find_problems
from tams_app.config.whole import Config, removed_keys
from tams_app.config.yaml_file import CONFIG_DIRECTORY, DEFAULT_CONFIG, read_yaml
from tams_app.errors import ConfigError


def load_config(path: Path | None = None, overrides: dict[str, Any] | None = None) -> Config:
    """Read a YAML file, lay dotted-key `overrides` that are not None over it and check everything.

    `include:` at the top of a file lists files whose keys it takes over and may replace; they are
    looked for beside it, then in CONFIG_DIRECTORY, so that a copy works anywhere. What was
    calibrated for the set that `calibration:` names is laid over the file; a configuration that
    says by what it was calibrated (a session's own) is taken as it stands. A `preset` is laid over
    both.
    Raises ConfigError with file, key and reason.
    """
    path = path or DEFAULT_CONFIG
    content = _read_with_includes(path, ())
    calibrated = [] if content.get("calibrated_by") else _lay_calibration_over(content, path)
    overrides = {key: value for key, value in (overrides or {}).items() if value is not None}
    if overrides.get("preset", content.get("preset")) == "reference":  # else the model refuses it
        _lay_over(content, read_yaml(CONFIG_DIRECTORY / "reference.yaml"))
    for dotted, value in overrides.items():
        _override(content, dotted, value, path)
    for key, instead in removed_keys(content).items():
        raise ConfigError(f"{'command line' if key in overrides else path}: {key}: {instead}")
    try:
        config = Config.model_validate(content)
    except ValidationError as error:
        raise ConfigError(_sentence(error, path, calibrated, overrides)) from error
    _refuse_simulated(config, calibrated)
    return config


def _sentence(
    error: ValidationError, path: Path, calibrated: list[Calibrated], overrides: dict[str, Any]
) -> str:
    """Each source of something wrong, and what is wrong there."""
    found: dict[str, list[str]] = {}
    for problem in find_problems(error, Config):
        key = problem.key
        over = [one.file.name for one in calibrated if key and sets(one.changes, key)]
        source = f"{path} with {over[0]} laid over it" if over else str(path)
        found.setdefault("command line" if key in overrides else source, []).append(str(problem))
    return "; ".join(f"{source}: {'; '.join(problems)}" for source, problems in found.items())


def _lay_calibration_over(content: dict[str, Any], path: Path) -> list[Calibrated]:
    """Merge the calibration in force; the keys that each file has set."""
    name = content.get("calibration")
    if not isinstance(name, str):
        return []  # none, or not a name, which the model reports
    files = files_in_force(set_folder(path, name))
    calibrated = [read_calibrated(file, kind) for kind, file in sorted(files.items())]
    for one in calibrated:
        _lay_over(content, one.changes)
    content["calibrated_by"] = [one.file.name for one in calibrated]
    return calibrated


def _refuse_simulated(config: Config, calibrated: list[Calibrated]) -> None:
    """A real arm does not move by what a simulated hand did."""
    if not config.rig.enabled and (simulated := [one.file for one in calibrated if one.simulated]):
        raise ConfigError(
            f"{simulated[0]}: was measured on the simulated rig and is never used with real "
            "devices: name another set (`calibration:`) and calibrate there"
        )


def _override(content: dict[str, Any], dotted: str, value: Any, path: Path) -> None:
    *parents, leaf = dotted.split(".")
    section = content
    for parent in parents:
        section = section.setdefault(parent, {})
        if not isinstance(section, dict):
            raise ConfigError(f"{path}: {parent}: must hold keys and values")
    section[leaf] = value


def _read_with_includes(path: Path, including: tuple[Path, ...]) -> dict[str, Any]:
    """The content of `path` over that of the files it includes; `including`: how we got here."""
    resolved = path.resolve()
    if resolved in including:
        raise ConfigError(f"{path}: include: the file includes itself")
    content = read_yaml(path)
    includes = content.pop("include", [])
    if not isinstance(includes, list) or not all(isinstance(name, str) for name in includes):
        raise ConfigError(f"{path}: include: must be a list of file names")
    merged: dict[str, Any] = {}
    for name in includes:
        _lay_over(merged, _read_with_includes(_included(path, name), (*including, resolved)))
    _lay_over(merged, content)
    return merged


def _included(path: Path, name: str) -> Path:
    """The file `name` as `path` means it: beside it, or else one of ours."""
    beside, ours = path.parent / name, CONFIG_DIRECTORY / name
    return ours if not beside.exists() and ours.exists() else beside


def _lay_over(base: dict[str, Any], top: dict[str, Any]) -> None:
    for key, value in top.items():
        if isinstance(value, dict) and isinstance(base.get(key), dict):
            _lay_over(base[key], value)
        else:
            base[key] = value


def dump_config(config: Config) -> str:
    """The effective configuration as YAML that `load_config` reads back."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)
