"""`run_tams.py calibrate show` and `undo`: what counts now, and what counted before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.store import CalibrationSet, InForce
from calibration.ui import WizardUI
from tams_app.config import load_config
from tams_app.config.calibrated import KEYS_BY_KIND


def show_in_force(config_path: Path | None, ui: WizardUI | None = None) -> None:
    """Print each kind's file with its origin and figures; ConfigError if there is no set."""
    ui, store = ui or WizardUI(), _set_of(config_path)
    in_force = {one.kind: one for one in store.all_in_force()}
    ui.print(f"In force from {store.folder}:")
    for kind in KEYS_BY_KIND:
        ui.print(
            f"\n{_described(in_force[kind])}" if kind in in_force else f"\n{kind}: not calibrated"
        )


def undo_last(config_path: Path | None, ui: WizardUI | None = None) -> None:
    """Take the last calibration back and print what counts instead; TamsError if there is none."""
    ui, store = ui or WizardUI(), _set_of(config_path)
    undone = store.undo()
    now = store.in_force(undone.kind)
    instead = f"{now.name} counts again" if now else f"no {undone.kind} calibration counts any more"
    ui.print(
        f"Taken back: {undone.path.name}, which is kept; {instead}.\n"
        f"To use it after all, write `{undone.kind}: {undone.path.name}` into "
        f"{store.index}."
    )


def _set_of(config_path: Path | None) -> CalibrationSet:
    return CalibrationSet.of(config_path, load_config(config_path))


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
    """How far off what was measured of a part may be, such as of a view; "" if that is not said."""
    known = figures.items() if isinstance(figures, dict) else ()
    said = [f"{key} {value}" for key, value in known if "_error" in str(key)]
    return f"  {name}: {', '.join(said)}" if said else ""
