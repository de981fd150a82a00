"""The commands of two computers: `robot`, `operate` and `key`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tams_app.config import load_config
from tams_app.console.options import (
    ArmOption,
    BudgetOption,
    DryRunOption,
    EpisodesOption,
    FoxgloveOption,
    FpsOption,
    HandOption,
    HeadlessOption,
    KeyOption,
    KeysOption,
    OutOption,
    PredictOption,
    PresetOption,
    ReferenceOption,
    Ros2Option,
    SecondsOption,
    SeedOption,
    SimOption,
    StrategyOption,
    arm_overrides,
    check_arm_at_once,
    network_names,
)
from tams_app.study.cli import ConfigOption

key_app = typer.Typer(rich_markup_mode=None, help="Make, list and revoke keys of two computers.")


def add_two_sided(app: typer.Typer) -> None:
    """Give `app` the commands."""
    app.command()(robot)
    app.command()(operate)
    app.add_typer(key_app, name="key")


def robot(
    listen: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address on which to listen.")],
    key: KeysOption = None,
    config: ConfigOption = None,
    sim: SimOption = False,
    strategy: StrategyOption = None,
    preset: PresetOption = None,
    network: Annotated[
        str,
        typer.Option(
            help="Emulate before the link: s1, s2, s3, none or a trace file.",
            autocompletion=network_names,
        ),
    ] = "none",
    budget: BudgetOption = None,
    seconds: SecondsOption = None,
    seed: SeedOption = None,
    fps: FpsOption = None,
    arm: ArmOption = False,
    dry_run: DryRunOption = False,
    record_reference: ReferenceOption = False,
    episodes: EpisodesOption = False,
    foxglove: FoxgloveOption = None,
    ros2: Ros2Option = None,
    out: OutOption = None,
) -> None:
    """Run the robot's side of a session on two computers: arm, cameras, safety."""
    overrides = arm_overrides(
        sim=sim,
        strategy=strategy,
        preset=preset,
        network=network,
        budget=budget,
        seconds=seconds,
        seed=seed,
        fps=fps,
        record_reference=record_reference,
        episodes=episodes,
        foxglove=foxglove,
        ros2=ros2,
        out=out,
    )
    overrides |= {
        "headless": True,
        "controller.device": "auto",  # the operator's side has the device
        "name": "robot",
        "video.bind_host": "127.0.0.1",
        "video.quality.enabled": False,
    }
    settings = load_config(config, overrides)
    check_arm_at_once(arm, settings)
    typer.echo("starting: arm, cameras, link …")  # before what takes long to import
    from tams_app.console.two_sided import endpoint_of, run_robot

    raise typer.Exit(run_robot(settings, endpoint_of("--listen", listen, key, True), arm, dry_run))


def operate(
    robot: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the `robot`.")],
    key: KeyOption = None,
    config: ConfigOption = None,
    sim: Annotated[
        bool, typer.Option("--sim", help="Use a simulated operator who sees only the video.")
    ] = False,
    seconds: SecondsOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated operator.")] = None,
    hand: HandOption = None,
    predict: PredictOption = None,
    headless: HeadlessOption = False,
    foxglove: FoxgloveOption = None,
    ros2: Ros2Option = None,
    out: OutOption = None,
) -> None:
    """Run the operator's side: controller and window for the arm of a `robot`."""
    settings = load_config(
        config,
        {
            "rig.enabled": True if sim else None,
            "rig.operator.kind": "seeing" if sim else None,
            "controller.device": hand or ("sim" if sim else None),
            "seconds": seconds,
            "seed": seed,
            "view.predict": predict,
            "headless": True if headless else None,
            "name": "operate",
            "recording.foxglove": foxglove,
            "recording.ros2": ros2,
            "recording.directory": str(out) if out else None,
        },
    )
    typer.echo("starting: controller, link, video …")  # before what takes long to import
    from tams_app.console.two_sided import endpoint_of, run_operate

    raise typer.Exit(run_operate(settings, endpoint_of("--robot", robot, key)))


@key_app.callback()
def _key() -> None:
    """The secrets that two computers share."""


NameOption = Annotated[
    str | None,
    typer.Option("--for", metavar="NAME", help="The key's owner; default the file's name."),
]


@key_app.command("new")
def new_key_file(
    file: Annotated[Path, typer.Argument(metavar="FILE")], name: NameOption = None
) -> None:
    """Make a key, as FILE or in the folder FILE; copy it to the other computer securely."""
    from tams_app.link.keys import new_key

    made = new_key(file, name)
    typer.echo(f"{made}: a new key, readable only by you; copy it to the other computer")


@key_app.command("list")
def list_keys(path: Annotated[Path, typer.Argument(metavar="FILE_OR_FOLDER")]) -> None:
    """List the owners of the keys in a file, or in a folder for `robot --key FOLDER`."""
    from tams_app.link.keys import accepted_keys

    for key in accepted_keys(path):
        typer.echo(key.name)


@key_app.command("revoke")
def revoke(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER")],
    name: Annotated[str, typer.Argument(metavar="NAME")],
) -> None:
    """Delete NAME's key from FOLDER: `robot --key FOLDER` disconnects them within a second."""
    from tams_app.link.keys import revoke_key

    typer.echo(f"{revoke_key(folder, name)}: deleted; the robot's side no longer accepts it")
