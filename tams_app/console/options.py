"""Options that several commands take, each with one meaning, and what they lay over the file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.policy.allocation import STRATEGIES

STRATEGY_HELP = f"One of {', '.join(STRATEGIES)}."

SimOption = Annotated[bool, typer.Option("--sim", help="The rig's devices, not the config's.")]
StrategyOption = Annotated[str | None, typer.Option(help=STRATEGY_HELP)]
BudgetOption = Annotated[str | None, typer.Option(help="feedback, sender or oracle.")]
SecondsOption = Annotated[float | None, typer.Option(help="End after this many seconds.")]
SeedOption = Annotated[int | None, typer.Option(help="Of scene, noise and losses.")]
FpsOption = Annotated[
    int | None, typer.Option(help="Frames a second of each view, kept also if it is too much.")
]
HeadlessOption = Annotated[bool, typer.Option("--headless", help="No windows.")]
ArmOption = Annotated[bool, typer.Option("--arm", help="Arm without asking; simulated rig only.")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Everything but motion of the arm.")]
ReferenceOption = Annotated[
    bool, typer.Option("--record-reference", help="Keep lossless captures too.")
]
OutOption = Annotated[Path | None, typer.Option(help="Where session folders are made.")]
KeyOption = Annotated[
    Path | None,
    typer.Option("--key", help="The key file of both computers; none needed on loopback."),
]


def arm_overrides(
    *,
    sim: bool,
    strategy: str | None,
    network: str | None,
    budget: str | None,
    seconds: float | None,
    seed: int | None,
    fps: int | None,
    record_reference: bool,
    out: Path | None,
) -> dict[str, Any]:
    """What the options of a command with an arm lay over the configuration file."""
    return {
        "rig.enabled": True if sim else None,
        "strategy": strategy,
        "network": network,
        "policy.budget.mode": budget,
        "seconds": seconds,
        "seed": seed,
        "video.fps": fps,
        "rig.fixed_fps": None if fps is None else True,
        "recording.record_reference": True if record_reference else None,
        "recording.directory": str(out) if out else None,
    }


def check_arm_at_once(arm: bool, settings: Config) -> None:
    """ConfigError for an arm that would move without being confirmed."""
    if arm and not settings.rig.enabled:
        raise ConfigError("--arm works on the simulated rig only: confirm by hand on hardware")
