"""How much shared memory a session takes, for the check before anything is started."""

from __future__ import annotations

from tams_app.config import Config
from tams_app.video.live.frame_ring import CAPTURED, SHOWN, RingLayout

_SMALL_BYTES = 2_000_000  # world, facts, mount, guard, a simulated hand: some kilobytes each


def robot_bytes(config: Config) -> int:
    """What the robot's side takes: the frames of the rig's renderer."""
    if not config.rig.enabled:
        return _SMALL_BYTES
    from hw.sim.world.rig_memory import FRAMES_BYTES  # hardware runs without the simulation

    return _SMALL_BYTES + FRAMES_BYTES


def station_bytes(config: Config) -> int:
    """What the operator's side takes: the frames that are shown."""
    return _SMALL_BYTES + _layout(config, SHOWN).block_bytes


def session_bytes(config: Config) -> int:
    """What `run` takes: both sides, and the captured frames that those shown are compared with."""
    compared = _layout(config, CAPTURED).block_bytes if config.video.quality.enabled else 0
    return robot_bytes(config) + station_bytes(config) + compared


def _layout(config: Config, kind: str) -> RingLayout:
    video = config.video
    return RingLayout(kind, video.views, video.width, video.height)
