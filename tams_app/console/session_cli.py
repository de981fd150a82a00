"""The commands that run a session, `run`, `robot` and `operate`, and the keys of two computers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from tams_app.config import Config, load_config
from tams_app.console.options import (
    ConfigOption,
    KeyOption,
    Override,
    endpoint_of,
    network_names,
    overriding,
)
from tams_app.errors import ConfigError

ArmOption = Annotated[bool, typer.Option("--arm", help="Arm without asking; simulated rig only.")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Do everything except move the arm.")]
key_app = typer.Typer(rich_markup_mode=None, help="Make, list and revoke keys of two computers.")


@overriding(
    "config sim strategy preset network budget seconds seed fps headless hand operator predict "
    "arm dry_run record_reference episodes foxglove ros2 out"
)
def run(settings: Config, arm: ArmOption = False, dry_run: DryRunOption = False) -> None:
    """Run a session; by default one simulated pick-and-place."""
    _check_arm_at_once(arm, settings)
    if settings.controller.device == "page":
        from tams_app.console.page import HERE, by_page

        settings = by_page(settings, moves=not settings.rig.enabled and not dry_run)
        typer.echo("loading …")
        from tams_app.console.app import run_robot

        run_robot(settings, None, arm, dry_run, HERE)
        return
    typer.echo("loading …")  # takes a second or two
    from tams_app.console.app import run_session

    run_session(settings, arm_at_once=arm, dry_run=dry_run)


@overriding(
    "listen key page page_cert config sim strategy preset network budget seconds seed fps arm "
    "dry_run record_reference episodes foxglove ros2 out",
    {
        "network": Override(
            "network",
            "Emulate before the link: s1, s2, s3, none or a trace file.",
            default="none",
            autocompletion=network_names,
        )
    },
    {
        "headless": True,
        "controller.device": "auto",  # the operator's side has the device
        "name": "robot",
        "video.quality.enabled": False,
    },
)
def robot(
    settings: Config,
    listen: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address on which to listen.")],
    key: Annotated[
        Path | None,
        typer.Option(help="An operator's key file, or a folder of them; not needed on loopback."),
    ] = None,
    page: Annotated[
        str | None,
        typer.Option(metavar="HOST:PORT", help="Let a browser drive, by a link to this address."),
    ] = None,
    page_cert: Annotated[
        Path | None,
        typer.Option(help="The page's certificate and its key, a PEM file that browsers trust."),
    ] = None,
    arm: ArmOption = False,
    dry_run: DryRunOption = False,
) -> None:
    """Run the robot's side of a session on two computers.

    It has the arm, the cameras, and everything that can stop the arm.
    """
    _check_arm_at_once(arm, settings)
    typer.echo("loading …")  # takes a second or two
    from tams_app.console.app import run_robot
    from tams_app.console.page import place_of

    endpoint = endpoint_of("--listen", listen, key, True)
    moves = not settings.rig.enabled and not dry_run
    run_robot(settings, endpoint, arm, dry_run, place_of(page, page_cert, endpoint, moves))


@overriding(
    "robot key config sim seconds seed hand predict headless foxglove ros2 out",
    {
        "sim": Override("rig.enabled", "Use a simulated operator who sees only the video."),
        "seed": Override("seed", "Seed of the simulated operator."),
    },
)
def operate(
    overrides: dict[str, Any],
    robot: Annotated[str, typer.Option(metavar="HOST:PORT", help="Address of the `robot`.")],
    key: KeyOption = None,
    config: ConfigOption = None,
) -> None:
    """Run the operator's side of a session on two computers.

    It has the controller and the window, and moves the arm of a `robot`.
    """
    overrides["name"] = "operate"
    if overrides["rig.enabled"]:
        overrides["rig.operator.kind"] = "seeing"
        overrides["controller.device"] = overrides["controller.device"] or "sim"
    settings = load_config(config, overrides)
    typer.echo("loading …")  # takes a second or two
    from tams_app.console.app import run_operate

    run_operate(settings, endpoint_of("--robot", robot, key))


@key_app.command("new")
def new_key_file(
    file: Annotated[Path, typer.Argument(metavar="FILE")],
    name: Annotated[
        str | None,
        typer.Option("--for", metavar="NAME", help="The key's owner; default the file's name."),
    ] = None,
) -> None:
    """Make a key, as FILE or in the folder FILE; on the robot's side."""
    from tams_app.link.keys import new_key

    made = new_key(file, name)
    typer.echo(f"{made}: a new key; copy it to the operator's computer, but never robot.identity")


@key_app.command("list")
def list_keys(path: Annotated[Path, typer.Argument(metavar="FILE_OR_FOLDER")]) -> None:
    """List the owners of the keys in a file or folder, and their robots."""
    from tams_app.link.keys import accepted_keys

    for key in accepted_keys(path):
        typer.echo(f"{key.name} (robot {key.robot.hex()[:8]})" if key.robot else key.name)


@key_app.command("revoke")
def revoke(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER")],
    name: Annotated[str, typer.Argument(metavar="NAME")],
) -> None:
    """Delete a key; its owner is disconnected within a second."""
    from tams_app.link.keys import revoke_key

    typer.echo(f"{revoke_key(folder, name)}: deleted; the robot's side no longer accepts it")


def _check_arm_at_once(arm: bool, settings: Config) -> None:
    """ConfigError for an arm that would move without being confirmed."""
    if arm and not settings.rig.enabled:
        raise ConfigError("--arm works on the simulated rig only: confirm by hand on hardware")
