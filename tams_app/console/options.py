"""Options that several commands take, each with one meaning, and what they lay over the file."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from tams_app.config import Config, OperatorKind, load_config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError, TamsError
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.budget import BUDGETS

FOXGLOVE = "127.0.0.1:8765"
ROS2 = "0"
_BARE = {
    "--foxglove": FOXGLOVE,
    "--ros2": ROS2,
    "--episodes": "0",  # any number
}  # what an option without a value stands for


def network_names(ctx: typer.Context) -> list[str]:
    """For the shell: those of the configuration; where none fits, the shell offers files."""
    try:
        return list(load_config(ctx.params.get("config")).networks)
    except TamsError:  # it is named when the command runs
        return []


def _devices() -> list[str]:
    from hw.make_controller import DEVICES  # not for every command

    return list(DEVICES)


STRATEGY_HELP = "How views share the bitrate: equal, static, tams, tams+ or an installed one."

SimOption = Annotated[
    bool, typer.Option("--sim", help="Use the simulated arm and cameras, not the configured ones.")
]
StrategyOption = Annotated[
    str | None, typer.Option(help=STRATEGY_HELP, autocompletion=lambda: list(STRATEGIES))
]
PresetOption = Annotated[
    str | None,
    typer.Option(help="reference: the constants of the authors' nodes, over file and calibration."),
]
BudgetOption = Annotated[
    str | None,
    typer.Option(
        help="Source of the budget: feedback, sender or oracle.", autocompletion=lambda: [*BUDGETS]
    ),
]
NetworkOption = Annotated[
    str | None,
    typer.Option(help="Emulate s1, s2, s3, none or a trace file.", autocompletion=network_names),
]
OperatorOption = Annotated[
    str | None,
    typer.Option(
        help="Simulated operator: seeing or scripted.",
        autocompletion=lambda: list(get_args(OperatorKind)),
    ),
]
SecondsOption = Annotated[float | None, typer.Option(help="End after this many seconds.")]
SeedOption = Annotated[int | None, typer.Option(help="Seed of scene, noise and packet loss.")]
FpsOption = Annotated[
    int | None, typer.Option(help="Frames a second that each camera is asked for; 30 by default.")
]
HandOption = Annotated[
    str | None,
    typer.Option(
        help="What the operator holds: openvr, keyboard, sim or an installed one.",
        autocompletion=lambda: ["auto", *_devices(), "sim"],
    ),
]
HeadlessOption = Annotated[bool, typer.Option("--headless", help="Open no window.")]
ArmOption = Annotated[bool, typer.Option("--arm", help="Arm without asking; simulated rig only.")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Do everything except move the arm.")]
ReferenceOption = Annotated[
    bool, typer.Option("--record-reference", help="Also record the camera images without loss.")
]
EpisodesOption = Annotated[
    int | None,
    typer.Option(
        min=0, metavar="[N]", help="Record episodes, kept or discarded by key; end when N are kept."
    ),
]
PredictOption = Annotated[
    str | None,
    typer.Option(
        help="Compensate for delay: eih (redraws the wrist camera's frames as they would look "
        "now), all (eih, and outlines the arm's current pose in the other views) or off.",
        autocompletion=lambda: ["eih", "all", "off"],
    ),
]
FoxgloveOption = Annotated[
    str | None,
    typer.Option(
        metavar="[HOST:PORT]",
        help=f"Let Foxglove connect while the session runs; by default at {FOXGLOVE}.",
    ),
]
Ros2Option = Annotated[
    int | None,
    typer.Option(
        metavar="[DOMAIN]",
        help=f"Publish the session in ROS 2 while it runs; by default in domain {ROS2}.",
    ),
]
OutOption = Annotated[Path | None, typer.Option(help="Folder for the session folders.")]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON.")]
KeyOption = Annotated[
    Path | None,
    typer.Option("--key", help="This computer's key file; not needed on loopback."),
]
KeysOption = Annotated[
    Path | None,
    typer.Option(
        "--key",
        help="The operator's key file, or a folder of them; not needed on loopback.",
    ),
]


_KEYS = {  # of the configuration, by the option that sets it
    "sim": "rig.enabled",
    "strategy": "strategy",
    "preset": "preset",
    "network": "network",
    "budget": "policy.budget.mode",
    "seconds": "seconds",
    "seed": "seed",
    "fps": "video.fps",
    "record_reference": "recording.record_reference",
    "episodes": "recording.episode_count",
    "foxglove": "recording.foxglove",
    "ros2": "recording.ros2",
    "out": "recording.directory",
    "headless": "headless",
    "hand": "controller.device",
    "operator": "rig.operator.kind",
    "predict": "view.predict",
}


def overrides_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The overrides of the configuration file by a command's options, which are `given` by name."""
    overrides = {
        key: given.get(name) for name, key in _KEYS.items() if given.get(name) is not False
    }
    out = given.get("out")
    return overrides | {
        "recording.directory": str(out) if out else None,
        "recording.episodes": None if given.get("episodes") is None else True,
    }


def with_values(arguments: list[str]) -> list[str]:
    """The command line with the values that bare `--foxglove` and `--ros2` stand for.

    ConfigError for an option that there was.
    """
    words = [argument for argument in arguments[:2] if not argument.startswith("-")]
    for name in (argument.partition("=")[0] for argument in arguments if argument.startswith("--")):
        for before in (words, words[:1], []):
            if instead := REMOVED.get(" ".join([*before, name])):
                raise ConfigError(f"{name}: {instead}")
    found: list[str] = []
    for argument, following in pairwise([*arguments, "-"]):
        found.append(argument)
        if argument in _BARE and following.startswith("-"):
            found.append(_BARE[argument])
    return found


def check_arm_at_once(arm: bool, settings: Config) -> None:
    """ConfigError for an arm that would move without being confirmed."""
    if arm and not settings.rig.enabled:
        raise ConfigError("--arm works on the simulated rig only: confirm by hand on hardware")
