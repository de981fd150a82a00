"""The scene and address for viewers of a session's log, made of its configuration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np
from foxglove import Context
from pydantic import ValidationError

from hw.arms import arm_kind
from tams_app.config import Config, LimitsConfig
from tams_app.errors import require_extra
from tams_app.recording import Header, Viewer
from tams_app.records import ArmFigure, Pose, Solid, SolidKind
from tams_app.robot.build import ready_pose
from tams_app.rotation import Rotation
from tams_app.session.lenses import known_lenses
from tams_app.telemetry import Scene, Telemetry
from tams_app.vectors import Floats3

if TYPE_CHECKING:  # loaded where viewers may connect
    from tams_app.telemetry.gate import Address

_BLOCK_COLOUR = (0.85, 0.15, 0.12)
_CONTAINER_COLOUR = (0.20, 0.35, 0.75)


def address_of(config: Config) -> Address | None:
    """The address for viewers; None: there is none. ConfigError if it is no address."""
    given = config.recording.foxglove
    if not given:
        return None
    from tams_app.telemetry.gate import Address

    return Address.of(given, "--foxglove", "127.0.0.1:8765")


def check_viewers(config: Config) -> None:
    """ConfigError or SetupError in one sentence if viewers cannot be served as they should."""
    if (address := address_of(config)) is not None:
        from tams_app.telemetry.gate import check_address

        check_address(address)
    if config.recording.ros2 is not None:
        require_extra("ros2", "--ros2")


def invitations(config: Config) -> Iterator[tuple[str, str]]:
    """Sentences, each behind its level: where viewers may connect, if they may, and who can."""
    if (domain := config.recording.ros2) is not None:
        yield "info", f"published in ROS 2, domain {domain}: all who reach it see this session"
    if (address := address_of(config)) is None:
        return
    if address.is_private:
        yield "info", f"Foxglove may connect to {address.url}"
    else:
        yield "warning", f"all who reach {address.url} see this session: no password is asked"


def viewers_of(config: Config, header: Header, live: bool = True) -> tuple[list[Viewer], Context]:
    """The channels for viewers in the log of that header, if it has any, and their context.

    `live`: viewers may connect to them.
    """
    context, keeping = Context(), config.recording
    address = address_of(config) if live else None
    if not keeping.viewers and address is None:
        return [], context
    scene, pictures_per_s = scene_of(config), keeping.pictures_per_s
    origins = keeping.foxglove_origins
    return [Telemetry(context, header, scene, pictures_per_s, address, origins)], context


def scene_of_header(header: Header) -> Scene | None:
    """That of the configuration that a log's header has; None if another version wrote it."""
    try:
        return scene_of(Config.model_validate(header.config))
    except ValidationError:
        return None


def scene_of(config: Config) -> Scene:
    """The known surroundings: of the rig everything, of a real place what is measured."""
    limits, simulated = config.limits, config.rig.enabled
    figure = arm_kind(config.arm.model).figure()
    return Scene(
        figure=figure,
        workspace=_workspace(limits),
        tracking=Pose(np.zeros(3), Rotation.from_matrix(config.hand.rotation)),
        twist_lasts_s=config.arm.velocity_deadman_s,
        things=_things() if simulated else {},
        lenses=known_lenses(config, figure),
    )


def tool_tip(config: Config, figure: ArmFigure) -> Floats3:
    """The TCP of the configured tool in the flange's frame [m], the same in each pose."""
    flange = figure.place(np.radians(np.array(config.arm.ready_joints_deg)))[figure.flange]
    x, y, z = flange.rotation.inv().apply(ready_pose(config).position - flange.position).tolist()
    return x, y, z


def _workspace(limits: LimitsConfig) -> tuple[Floats3, Floats3]:
    """The box that the TCP never leaves [m]; the radii are not drawn."""
    x, y, z = limits.box_min_mm
    lower = x / 1000.0, y / 1000.0, max(z, limits.floor_mm) / 1000.0
    x, y, z = limits.box_max_mm
    return lower, (x / 1000.0, y / 1000.0, z / 1000.0)


def _things() -> Mapping[str, tuple[Solid, ...]]:
    """The rig's block and container, in frames of their own."""
    from hw.sim.layout import (
        BLOCK_EDGE_M,
        BLOCK_HEIGHT_M,
        CONTAINER_HEIGHT_M,
        CONTAINER_INNER_M,
        CONTAINER_WALL_M,
    )

    inner, wall, height = CONTAINER_INNER_M, CONTAINER_WALL_M, CONTAINER_HEIGHT_M
    side, across = (inner + wall) / 2.0, inner + 2 * wall
    walls = [
        _box((sign * side, 0.0, height / 2), (wall, across, height), _CONTAINER_COLOUR)
        for sign in (-1, 1)
    ] + [
        _box((0.0, sign * side, height / 2), (inner, wall, height), _CONTAINER_COLOUR)
        for sign in (-1, 1)
    ]
    block = _box((0.0, 0.0, 0.0), (BLOCK_EDGE_M, BLOCK_EDGE_M, BLOCK_HEIGHT_M), _BLOCK_COLOUR)
    return {"block": (block,), "container": tuple(walls)}


def _box(middle: Floats3, extent: Floats3, colour: Floats3) -> Solid:
    return Solid(SolidKind.BOX, Pose(np.array(middle), Rotation.identity()), extent, colour)
