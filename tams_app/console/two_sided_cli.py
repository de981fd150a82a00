"""The commands of two computers: `robot`, `operate` and `key`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from tams_app.config import load_config
from tams_app.console import options
from tams_app.study.cli import ConfigOption

key_app = typer.Typer(rich_markup_mode=None, help="Make, list and revoke keys of two computers.")


def add_two_sided(app: typer.Typer) -> None:
    """Give `app` the commands."""
    app.command()(robot)
    app.command()(operate)
    app.add_typer(key_app, name="key")


def robot(
    listen: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address on which to listen.")],
    key: options.KeysOption = None,
    config: ConfigOption = None,
    sim: options.SimOption = False,
    strategy: options.StrategyOption = None,
    preset: options.PresetOption = None,
    network: Annotated[
        str,
        typer.Option(
            help="Emulate before the link: s1, s2, s3, none or a trace file.",
            autocompletion=options.network_names,
        ),
    ] = "none",
    budget: options.BudgetOption = None,
    seconds: options.SecondsOption = None,
    seed: options.SeedOption = None,
    fps: options.FpsOption = None,
    arm: options.ArmOption = False,
    dry_run: options.DryRunOption = False,
    record_reference: options.ReferenceOption = False,
    episodes: options.EpisodesOption = None,
    foxglove: options.FoxgloveOption = None,
    ros2: options.Ros2Option = None,
    out: options.OutOption = None,
) -> None:
    """Run the robot's side of a session on two computers.

    It has the arm, the cameras, and everything that can stop the arm.
    """
    overrides = options.overrides_of(locals()) | {
        "headless": True,
        "controller.device": "auto",  # the operator's side has the device
        "name": "robot",
        "video.bind_host": "127.0.0.1",
        "video.quality.enabled": False,
    }
    settings = load_config(config, overrides)
    options.check_arm_at_once(arm, settings)
    typer.echo("loading …")  # takes a second or two
    from tams_app.console.two_sided import endpoint_of, run_robot

    raise typer.Exit(run_robot(settings, endpoint_of("--listen", listen, key, True), arm, dry_run))


def operate(
    robot: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the `robot`.")],
    key: options.KeyOption = None,
    config: ConfigOption = None,
    sim: Annotated[
        bool, typer.Option("--sim", help="Use a simulated operator who sees only the video.")
    ] = False,
    seconds: options.SecondsOption = None,
    seed: Annotated[int | None, typer.Option(help="Seed of the simulated operator.")] = None,
    hand: options.HandOption = None,
    predict: options.PredictOption = None,
    headless: options.HeadlessOption = False,
    foxglove: options.FoxgloveOption = None,
    ros2: options.Ros2Option = None,
    out: options.OutOption = None,
) -> None:
    """Run the operator's side of a session on two computers.

    It has the controller and the window, and moves the arm of a `robot`.
    """
    overrides = options.overrides_of(locals()) | {
        "rig.operator.kind": "seeing" if sim else None,
        "controller.device": hand or ("sim" if sim else None),
        "name": "operate",
    }
    settings = load_config(config, overrides)
    typer.echo("loading …")  # takes a second or two
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
    """Make a key, as FILE or in the folder FILE, for both computers."""
    from tams_app.link.keys import new_key

    made = new_key(file, name)
    typer.echo(f"{made}: a new key, readable only by you; copy it to the other computer")


@key_app.command("list")
def list_keys(path: Annotated[Path, typer.Argument(metavar="FILE_OR_FOLDER")]) -> None:
    """List the owners of the keys in a file or folder."""
    from tams_app.link.keys import accepted_keys

    for key in accepted_keys(path):
        typer.echo(key.name)


@key_app.command("revoke")
def revoke(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER")],
    name: Annotated[str, typer.Argument(metavar="NAME")],
) -> None:
    """Delete a key; its owner is disconnected within a second."""
    from tams_app.link.keys import revoke_key

    typer.echo(f"{revoke_key(folder, name)}: deleted; the robot's side no longer accepts it")
