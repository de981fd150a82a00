"""`config`, `network`, `phases` and `allocate`: commands that need neither an arm nor a session."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

from tams_app.config import load_config
from tams_app.console.options import (
    ConfigOption,
    JsonOption,
    Override,
    network_names,
    overriding,
)
from tams_app.errors import ConfigError, not_one_of
from tams_app.outputs import write_file
from tams_app.policy.allocation import make_strategy

MAX_KBPS = 1e9


def _kbps(text: str) -> float:
    """The argument of an option that takes a rate."""
    try:
        rate = float(text)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not a number") from None
    if not 0 <= rate <= MAX_KBPS:
        name = "NaN" if math.isnan(rate) else "infinity" if math.isinf(rate) else text
        raise typer.BadParameter(f"{name} is not a rate: give 0 to {MAX_KBPS:.0f} kbit/s")
    return rate


def config(
    explain: Annotated[
        str, typer.Option(metavar="KEY", help="A key or a section, such as link; all: every key.")
    ],
) -> None:
    """Print what a key means, its default and what it may be."""
    from tams_app.config.reference import explain as explained

    typer.echo(explained(explain), nl=False)


def _actions() -> list[str]:
    from tams_app.video.live.netem import ACTIONS

    return list(ACTIONS)


def network(
    name: Annotated[
        str,
        typer.Argument(
            help="A network of the configuration: s1, s2, s3.", autocompletion=network_names
        ),
    ],
    interface: Annotated[str, typer.Option(help="The network interface to shape.")],
    action: Annotated[
        str,
        typer.Option(
            help="print, apply, rate (apply the rate only), show or remove.",
            autocompletion=_actions,
        ),
    ] = "print",
    config: ConfigOption = None,
) -> None:
    """Emulate a network condition on an interface with `tc`.

    With `robot` the video crosses that interface. With `run` it stays on loopback, and
    `run --network` emulates its link.
    """
    from tams_app.video.live.netem import run_network

    run_network(load_config(config), name, interface, action, typer.echo)


@overriding(
    "file out no_smoothing v_eps_mm_s vz_min_mm_s align_dwell_s pre_release_dwell_s preset config",
    {
        name: Override(f"policy.phases.{name}")
        for name in ("v_eps_mm_s", "vz_min_mm_s", "align_dwell_s", "pre_release_dwell_s")
    },
)
def phases(
    overrides: dict[str, Any],
    file: Annotated[Path, typer.Argument(metavar="FILE.csv")],
    out: Annotated[Path | None, typer.Option(help="Default: standard output.")] = None,
    no_smoothing: Annotated[
        bool, typer.Option("--no-smoothing", help="The speeds are already smoothed.")
    ] = False,
    config: ConfigOption = None,
) -> None:
    """Label the task phases in a table of speeds (Algorithm 1).

    Its columns: t_s, vx_mm_s, vy_mm_s, vz_mm_s, gripper (0 open, 1 closed).
    """
    from tams_app.policy.offline import label_phases

    settings = load_config(config, overrides).policy.phases
    if out is not None and out.exists() and file.exists() and out.samefile(file):
        raise ConfigError(f"--out: {out} is the table that is read: give another file")
    smoothing_s = 0.0 if no_smoothing else settings.smoothing_ms / 1000
    labelled = label_phases(_read(file), str(file), settings, smoothing_s)
    if out is None:
        typer.echo(labelled, nl=False)
    else:
        write_file(out, labelled)


def _phases() -> list[str]:
    from tams_app.records import Phase

    return [phase.word for phase in Phase]


@overriding(
    "phase budget_kbps floor_kbps strategy preset as_json config",
    {
        "floor_kbps": Override(
            "policy.allocation.floor_kbps",
            "Minimum for each view.",
            parser=_kbps,
            metavar="KBPS",
        )
    },
)
def allocate(
    overrides: dict[str, Any],
    phase: Annotated[
        str,
        typer.Option(
            help="Reach, Align, Grasp, Transport, Pre-release or Release.",
            autocompletion=_phases,
        ),
    ],
    budget_kbps: Annotated[
        float,
        typer.Option(parser=_kbps, metavar="KBPS", help="The budget B, after the safety factor."),
    ],
    as_json: JsonOption = False,
    config: ConfigOption = None,
) -> None:
    """Print the bitrate that a strategy gives each view in a phase."""
    from tams_app.records import Phase

    settings = load_config(config, overrides)
    name = phase.strip().upper().replace("-", "_").replace(" ", "_")
    if name not in Phase.__members__:
        raise ConfigError(f"--phase: {not_one_of(phase, _phases())}")
    chosen = make_strategy(settings.strategy, settings.policy)
    floor = settings.policy.allocation.floor_kbps
    targets = chosen.targets(Phase[name], budget_kbps)
    if budget_kbps < len(targets) * floor:
        typer.echo(
            f"tams: note: {budget_kbps:g} kbit/s are less than the floor of {floor:g} kbit/s for "
            f"each of {len(targets)} views: the floor is not kept",
            err=True,
        )
    if as_json:
        typer.echo(json.dumps(targets))
    else:
        for view, kbps in targets.items():
            typer.echo(f"{view}  {kbps} kbit/s")


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text") from error
