"""The folder a session leaves behind, and the shared memory it takes, to be checked before it."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

from tams_app.config import Config, dump_config
from tams_app.errors import ConfigError, LogError
from tams_app.outputs import write_file
from tams_app.recording.mcap_log import require_free_space
from tams_app.video.live.frame_ring import CAPTURED, SHOWN, RingLayout


def create_session_folder(config: Config, now: time.struct_time | None = None) -> Path:
    """Make `<directory>/<time>-<name>/` with the effective configuration in it.

    Two sessions of the same second get different folders. LogError if it cannot be made or the
    disk is nearly full.
    """
    stamp = time.strftime("%Y%m%d-%H%M%S", now or time.localtime())
    parent = recording_directory(config)
    try:
        parent.mkdir(parents=True, exist_ok=True)
        require_free_space(parent, config.recording.min_free_mb)
        folder = _make_unique(parent, f"{stamp}-{config.name}")
    except OSError as error:
        raise LogError(
            f"{parent}: no session folder can be made there ({error.strerror}): "
            "choose another one with --out"
        ) from error
    try:
        furnish_session_folder(config, folder)
    except LogError:
        remove_session_folder(folder)
        raise
    return folder


def furnish_session_folder(config: Config, folder: Path) -> None:
    """Put the effective configuration into a folder that is there already.

    LogError if it cannot be written or the disk is nearly full.
    """
    require_free_space(folder, config.recording.min_free_mb)
    write_file(folder / "config.yaml", dump_config(config))


def remove_session_folder(folder: Path, failure: str = "") -> None:
    """Remove the folder of a session that has not started.

    It stays if the sentence `failure` names a file in it, such as a helper's last words.
    """
    if str(folder) not in failure:
        shutil.rmtree(folder, ignore_errors=True)


def recording_directory(config: Config) -> Path:
    """The folder of session folders, absolute; ConfigError if it names no folder."""
    try:
        return Path(config.recording.directory).expanduser().resolve()
    except (RuntimeError, OSError) as error:  # ~nobody-of-that-name, a loop of links
        raise ConfigError(f"recording.directory: {error}") from error


def _make_unique(parent: Path, name: str) -> Path:
    for attempt in range(1, 1000):
        folder = parent / (name if attempt == 1 else f"{name}-{attempt}")
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        return folder
    raise LogError(f"{parent}: holds a thousand sessions named {name}: clean it up")


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
