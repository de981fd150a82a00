"""`network` and `allocate`: an uplink's conditions on real hardware, and what a strategy gives."""

from __future__ import annotations

import json
import math
from typing import Annotated

import typer

from tams_app.config import Config
from tams_app.console.options import (
    JsonOption,
    Override,
    network_names,
    overriding,
)
from tams_app.errors import ConfigError, not_one_of
from tams_app.policy.allocation import STRATEGIES

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


def _actions() -> list[str]:
    from tams_app.video.live.netem import ACTIONS

    return list(ACTIONS)


@overriding("name interface action config")
def network(
    settings: Config,
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
) -> None:
    """Emulate a network condition on an interface with `tc`.

    With `robot` the video crosses that interface. With `run` it stays on loopback, and
    `run --network` emulates its link.
    """
    from tams_app.video.live.netem import run_network

    for line in run_network(settings, name, interface, action):
        typer.echo(line)


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
    settings: Config,
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
) -> None:
    """Print the bitrate that a strategy gives each view in a phase."""
    from tams_app.records import Phase

    name = phase.strip().upper().replace("-", "_").replace(" ", "_")
    if name not in Phase.__members__:
        raise ConfigError(f"--phase: {not_one_of(phase, _phases())}")
    chosen = STRATEGIES[settings.strategy](settings.policy)
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
