"""The files of what was measured: dated, one for each calibration, never changed or lost."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import yaml

from calibration.kit import WizardUI
from tams_app import __version__
from tams_app.config import Config, load_config
from tams_app.config.calibrated import (
    IN_FORCE,
    KEYS_BY_KIND,
    files_in_force,
    overstepping_key,
    set_folder,
)
from tams_app.config.yaml_file import DEFAULT_CONFIG, read_yaml
from tams_app.errors import ConfigError, TamsError
from tams_app.outputs import made_folder, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Draw: TypeAlias = "Callable[[], Figure | None]"
_HEADER = (
    "# Written by `run_tams.py calibrate {kind}`. in-force.yaml beside it says which file counts.\n"
)
_INDEX_HEADER = "# Which calibration counts, by kind. Name an older file here to go back to it.\n"


def utc_now() -> datetime:
    """The wall time of this moment."""
    return datetime.now(UTC)


def _no_figure() -> Figure | None:
    return None


def _draw_beside(path: Path, draw: Draw) -> None:
    """The figure beside a calibration file; TamsError if the disk refuses."""
    if (figure := draw()) is not None:
        from tams_app.report.plots import save_figure  # `show` and `undo` need no matplotlib

        save_figure(figure, path.with_suffix(".png"))


def write_text(path: Path, text: str) -> None:
    """Write a whole file or none, and its folder if need be; TamsError if the disk refuses."""
    made_folder(path.parent)
    write_file(path, text)


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a wizard found out, and how good it is."""

    kind: str  # of `KEYS_BY_KIND`
    changes: Mapping[str, Any]  # a part of the configuration, nested as there
    source: str  # what it was made from, in words
    quality: Mapping[str, float | int | str | list[Any] | dict[str, Any] | None]  # units in keys
    simulated: bool = False  # it comes in part from a simulated person or rig, or a log of one
    unfounded: str = ""  # why its figures do not support it, a sentence; "": they do


@dataclass(frozen=True, slots=True)
class InForce:
    """A calibration file that counts, and where it comes from; None for what it does not say."""

    kind: str
    path: Path
    origin: Mapping[str, Any]  # its part `calibration`

    @property
    def replaced(self) -> str | None:
        """The file of its kind that counted before."""
        return self.origin.get("replaces")

    def made_index(self, names: Mapping[str, str]) -> bool:
        """Whether an index with these `names` is the one that putting it in force has made."""
        if "index_before" not in self.origin:  # of an earlier version
            return False
        return _names(self.origin["index_before"]) | {self.kind: self.path.name} == names


class CalibrationSet:
    """The calibrations of one configuration file, in a folder beside it."""

    def __init__(
        self, config_path: Path | None, config: Config, now: Callable[[], datetime] = utc_now
    ) -> None:
        """The set that `config`, read from `config_path`, names; ConfigError if it names none.

        ConfigError also for a session's own configuration, which no calibration is laid over.
        """
        path = config_path or DEFAULT_CONFIG
        if read_yaml(path).get("calibrated_by"):
            raise ConfigError(
                f"{path}: is what a session ran with and stays so: give the configuration file "
                "that the session was started with"
            )
        if config.calibration is None:
            raise ConfigError(
                f"{path}: names no calibration: add `calibration: my-lab` (any name) at its top"
            )
        self.folder = set_folder(path, config.calibration)
        self._config_path, self._now = path, now

    @property
    def index(self) -> Path:
        """The file that names the calibrations in force."""
        return self.folder / IN_FORCE

    def in_force(self, kind: str) -> Path | None:
        """The file of a kind that counts now; None if nothing of that kind was calibrated."""
        return files_in_force(self.folder).get(kind)

    def all_in_force(self) -> list[InForce]:
        """Every file that counts now, the last made first; ConfigError if one cannot be read."""
        found = [
            InForce(kind, path, _origin(path)) for kind, path in files_in_force(self.folder).items()
        ]
        names = {one.kind: one.path.name for one in found}

        def when(one: InForce) -> tuple[str, bool]:
            return str(one.origin.get("made")), one.made_index(names)

        return sorted(found, key=when, reverse=True)

    def undo(self) -> InForce:
        """Let count again what counted before the last calibration, which stays as a file.

        Returns:
            The calibration that no longer counts.

        Raises:
            TamsError: There is none, or the disk refuses.
            ConfigError: The configuration would not be valid without it; nothing has changed.
        """
        in_force = self.all_in_force()
        if not in_force:
            raise TamsError(f"nothing to undo: no calibration in {self.folder} is in force")
        last, names = in_force[0], {one.kind: one.path.name for one in in_force}
        index = last.origin.get("index_before")
        if not last.made_index(names):  # else byte for byte
            del names[last.kind]
            if last.replaced is not None:
                names[last.kind] = last.replaced
            index = _index(names) if names else None
        self._put_in_force(index, f"without {last.path.name}")
        return last

    def check_before(self, ui: WizardUI, yes: bool, simulated: bool) -> None:
        """Before anything is measured: whether the result may and can be written.

        ConfigError for what is `simulated` where there are real devices; TamsError if the folder
        could not be written and, by `propose`, would be.
        """
        self._refuse_simulated(simulated)
        if not yes and not ui.attended:
            return
        there = self.folder
        while not os.path.lexists(there):
            there = there.parent
        if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
            raise TamsError(
                f"{self.folder}: cannot be written: nothing that is measured could be kept; put "
                "the configuration where you may write"
            )

    def propose(
        self,
        ui: WizardUI,
        calibration: Calibration,
        yes: bool,
        draw: Draw = _no_figure,
        accept_unfounded: bool | None = None,
    ) -> Path | None:
        """Show what would be written, ask, and write it; the file, None if nothing was written.

        `yes`: write without asking; what is unfounded is then kept, but not in force, and refused
        with TamsError, unless `accept_unfounded` (None: only a person can accept it). Unattended,
        nothing is written. If the question is never answered (Ctrl-C, a closed terminal), or the
        figure that `draw` makes, beside the file before that counts, is not finished, the file is
        kept, but not in force.
        """
        self._refuse_simulated(calibration.simulated)
        before = self.in_force(calibration.kind)
        ui.print(
            f"\nThe new {calibration.kind} calibration:\n{_dump(calibration.changes).rstrip()}"
        )
        ui.print(
            f"It would replace {before.name}, which is kept." if before else "It is the first."
        )
        if accept_unfounded and calibration.unfounded:
            ui.print(f"Note: {calibration.unfounded}.")
        if not yes and not ui.attended:
            ui.print("Nothing is written, for there is no terminal to ask at; --yes writes it.")
            return None
        unfounded = "" if accept_unfounded else calibration.unfounded
        if yes and unfounded:
            self.keep(ui, calibration, draw)
            remedy = "start it without --yes"
            if accept_unfounded is not None:
                remedy = "add --accept-unfounded"
            raise TamsError(
                f"{unfounded}; that is not put in force unasked: measure more, or {remedy}"
            )
        try:
            wanted = yes or ui.yes(
                f"{unfounded}. Write it all the same?" if unfounded else "Write it?"
            )
        except (KeyboardInterrupt, TamsError):
            self.keep(ui, calibration, draw)
            raise
        if not wanted:
            ui.print("Nothing is written.")
            return None
        try:
            path = self.write(calibration, draw)
        except (KeyboardInterrupt, TamsError) as error:
            if not isinstance(error, ConfigError):  # what does not fit is no use
                self.keep(ui, calibration)
            raise
        ui.print(
            f"Written: {path}\nEvery command with --config {self._config_path} uses it now; "
            "`calibrate undo` takes it back."
        )
        return path

    def keep(self, ui: WizardUI, calibration: Calibration, draw: Draw = _no_figure) -> None:
        """Write it without letting it count, and say how it can be made to; then its figure."""
        path = self._new(calibration)
        ui.print(
            f"\nKept, but not in force: {path}\n"
            f"To use it, write `{calibration.kind}: {path.name}` into {IN_FORCE} beside it."
        )
        _draw_beside(path, draw)

    def write(self, calibration: Calibration, draw: Draw = _no_figure) -> Path:
        """Write it and let it count from now on; what counted before stays beside it.

        ConfigError if the configuration would not be valid with it; TamsError if the disk refuses.
        """
        path = self._new(calibration)
        try:
            _draw_beside(path, draw)
            names = {kind: file.name for kind, file in files_in_force(self.folder).items()}
            self._put_in_force(_index(names | {calibration.kind: path.name}), path.name)
        except BaseException:  # a file of `write` counts and has its figure
            path.unlink()
            raise
        return path

    def _put_in_force(self, index: str | None, what: str) -> None:
        """Replace the index; ConfigError, and nothing has changed, if `what` does not fit."""
        before = self._index_text()
        self._replace_index(index)
        try:
            load_config(self._config_path)
        except BaseException as error:  # what counted before counts again
            self._replace_index(before)
            if isinstance(error, ConfigError):
                raise ConfigError(f"{what}: does not fit the configuration: {error}") from error
            raise

    def _new(self, calibration: Calibration) -> Path:
        """A new file; what counted before still counts."""
        kind = calibration.kind
        if key := overstepping_key(calibration.changes, kind):
            raise ConfigError(f"{key}: is not for a {kind} calibration to set")
        self._refuse_simulated(calibration.simulated)
        replaced, made = self.in_force(kind), self._now()
        content = {
            "calibration": {
                "kind": kind,
                "made": made.isoformat(timespec="seconds"),
                "tams": __version__,
                "source": calibration.source,
                "simulated": calibration.simulated,
                "quality": dict(calibration.quality),
                "unfounded": calibration.unfounded or None,
                "replaces": replaced.name if replaced else None,
                "index_before": self._index_text(),  # for `undo`
            },
            "config": dict(calibration.changes),
        }
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            return self._new_file(kind, made, _HEADER.format(kind=kind) + _dump(content))
        except OSError as error:
            raise TamsError(f"{self.folder}: cannot be written: {error.strerror}") from error

    def _refuse_simulated(self, simulated: bool) -> None:
        """A real arm does not move by what a simulated hand did."""
        if simulated and not load_config(self._config_path).rig.enabled:
            raise ConfigError(
                f"{self._config_path}: has real devices, and what the simulated rig tells is never "
                "written for those: use a configuration of the rig, or measure here"
            )

    def _new_file(self, kind: str, made: datetime, text: str) -> Path:
        """A file that did not exist before, even if two are made within a second."""
        stem = f"{kind}-{made.strftime('%Y%m%dT%H%M%SZ')}"
        for number in range(1, 1000):
            path = self.folder / (f"{stem}.yaml" if number == 1 else f"{stem}-{number}.yaml")
            try:
                file = path.open("x", encoding="utf-8")
            except FileExistsError:
                continue
            try:
                with file:
                    file.write(text)
            except BaseException:  # half a file is none
                path.unlink(missing_ok=True)
                raise
            return path
        raise TamsError(f"{self.folder}: holds a thousand calibrations of this second")

    def _index_text(self) -> str | None:
        """The index as it is; None if there is none."""
        return self.index.read_bytes().decode("utf-8") if self.index.is_file() else None

    def _replace_index(self, text: str | None) -> None:
        if text is None:
            self.index.unlink()
        else:
            write_file(self.index, text)


def show_in_force(ui: WizardUI, config_path: Path | None) -> None:
    """Print each kind's file with its origin and figures; ConfigError if there is no set."""
    store = CalibrationSet(config_path, load_config(config_path))
    in_force = {one.kind: one for one in store.all_in_force()}
    ui.print(f"In force from {store.folder}:")
    for kind in KEYS_BY_KIND:
        here = in_force.get(kind)
        ui.print(f"\n{_described(here) if here else f'{kind}: not calibrated'}")


def undo_last(ui: WizardUI, config_path: Path | None) -> None:
    """Take the last calibration back and print what counts instead; TamsError if there is none."""
    store = CalibrationSet(config_path, load_config(config_path))
    undone = store.undo()
    now = store.in_force(undone.kind)
    instead = f"{now.name} counts again" if now else f"no {undone.kind} calibration counts any more"
    ui.print(
        f"Taken back: {undone.path.name}, which is kept; {instead}.\n"
        f"To use it after all, write `{undone.kind}: {undone.path.name}` into "
        f"{store.index}."
    )


def _described(one: InForce) -> str:
    """The file, when and from what it was made, what it replaced, its figures."""
    origin = one.origin
    lines = [
        f"{one.kind}: {one.path.name}",
        f"  made {origin.get('made')} from {origin.get('source')}",
        f"  {f'replaced {one.replaced}' if one.replaced else 'the first of its kind'}",
    ]
    if origin.get("simulated"):
        lines.append("  made with simulated data")
    if reason := origin.get("unfounded"):
        lines.append(f"  unfounded: {reason}")
    quality = origin.get("quality")
    figures = quality if isinstance(quality, dict) else {}
    more = [name for name, value in figures.items() if isinstance(value, dict | list)]
    lines += [f"  {name}: {value}" for name, value in figures.items() if name not in more]
    lines += [line for name in more if (line := _errors(name, figures[name]))]
    if more:
        lines.append(f"  in the file besides: {', '.join(more)}")
    return "\n".join(lines)


def _errors(name: str, figures: Any) -> str:
    """The errors measured of a part, such as of a view; "" if there are none."""
    known = figures.items() if isinstance(figures, dict) else ()
    errors = [f"{key} {value}" for key, value in known if "_error" in str(key)]
    return f"  {name}: {', '.join(errors)}" if errors else ""


def _origin(path: Path) -> Mapping[str, Any]:
    origin = read_yaml(path).get("calibration")
    return origin if isinstance(origin, dict) else {}


def _names(index: str | None) -> dict[str, str]:
    """The names in an index that was read before; none of what is no index."""
    names = yaml.safe_load(index) if isinstance(index, str) else None
    return names if isinstance(names, dict) else {}


def _index(names: Mapping[str, str]) -> str:
    # a line for each: people edit them
    return _INDEX_HEADER + yaml.safe_dump(dict(names), default_flow_style=False)


def _dump(content: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=None, width=100)
