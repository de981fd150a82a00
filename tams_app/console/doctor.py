"""`run_tams.py doctor`: checks this machine, and reports how to fix what is missing.

One small function per need, all listed in `CHECKS`. Each imports what it looks at itself, so that
one that cannot be loaded spoils no other.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from tams_app.config import Config
from tams_app.console.devices import arm, cameras, controller, headset
from tams_app.console.findings import (
    Check,
    Finding,
    attempted,
    examine,
    libraries,
    loading,
    tried,
    verdict,
)
from tams_app.errors import SetupError
from tams_app.printing import Console

LOG_MB_PER_MINUTE = "25 to 100"  # docs/LOG.md has what it depends on
_RENDER = (
    "from hw.sim.layout import draw_layout; from hw.sim.world.scene_renderer import SceneRenderer; "
    "SceneRenderer(draw_layout(0)).close()"
)
_PLACE = ("limits.", "arm.tcp_offset")  # keys without which the arm may hit something
_WINDOW = "from tams_app.faces.window.toolkit import load; load()"


def gstreamer(_: Config) -> Iterator[Finding]:
    """Each GStreamer element of the video pipelines."""
    from tams_app import gst

    try:
        missing = gst.missing_elements()
    except SetupError as error:
        yield Finding("GStreamer", False, "", str(error))
        return
    if not missing:
        version = gst.load().Gst.version_string()
        yield Finding("GStreamer elements", True, f"{len(gst.STREAMING_ELEMENTS)}, {version}")
    for element, package in missing.items():
        yield Finding(f"GStreamer element {element}", False, "", f"apt-get install {package}")


def configuration(config: Config) -> Iterator[Finding]:
    """Names and ready pose, which `run` refuses before it makes anything if they cannot be."""
    from tams_app.faces.registry import check_faces
    from tams_app.robot.build import check_names, check_ready_pose

    yield attempted("Configured strategy, network and devices", check_names, config)
    yield attempted("Configured displays", check_faces, config)
    yield attempted("Ready pose inside the workspace", check_ready_pose, config)


def rendering(config: Config) -> Iterator[Finding]:
    """Off-screen OpenGL for the rig's cameras, in a child: a broken driver may abort."""
    if not config.rig.enabled:
        return
    reason = tried(_RENDER)
    fix = "apt-get install libegl1 libgl1-mesa-dri libosmesa6"
    yield Finding("Images of simulated cameras", not reason, reason, fix)


def realtime(config: Config) -> Iterator[Finding]:
    """Permission for SCHED_FIFO in the control loop; tried in a thread of its own."""
    from tams_app.runtime.realtime import use_fifo
    from tams_app.runtime.worker import Worker

    granted: list[str] = []
    priority = config.control.realtime_priority
    trial = Worker("try-fifo", lambda _: granted.append(use_fifo(priority)))
    trial.start()
    trial.stop()
    yield Finding(
        "Real-time priority of the control loop",
        granted[0] == "fifo" or priority == 0,
        granted[0],
        "add the line `@realtime - rtprio 98` to /etc/security/limits.d/realtime.conf, "
        "join the group realtime and log in again",
        essential=False,
    )


def disk(config: Config) -> Iterator[Finding]:
    """The log folder: writable, with enough space."""
    fix = "choose another with --out or recording.directory"
    try:
        logs = Path(config.recording.directory).expanduser().resolve()
        folder = next(one for one in (logs, *logs.parents) if one.exists())
    except (OSError, RuntimeError) as error:  # ~ of an unknown user, or a loop of links
        yield Finding("Log folder", False, f"{config.recording.directory}: {error}", fix)
        return
    writable = os.access(folder, os.W_OK)
    yield Finding("Log folder", writable, str(folder), fix)
    free = shutil.disk_usage(folder).free / 1_000_000
    wanted = config.recording.min_free_mb
    yield Finding(
        "Free disk space",
        free >= wanted,
        f"{free:.0f} MB, {wanted:.0f} MB wanted; a session takes {LOG_MB_PER_MINUTE} a minute",
        "delete old logs, or lower recording.min_free_mb",
    )


def home_folder(_: Config) -> Iterator[Finding]:
    """The home folder: the xArm SDK writes ~/.UFACTORY when it is imported."""
    folder = Path.home()
    yield Finding(
        "Home folder", os.access(folder, os.W_OK), str(folder), "set HOME to a folder you may write"
    )


def shared_memory(config: Config) -> Iterator[Finding]:
    """Shared memory between the session and its helpers: as much as this configuration takes."""
    from tams_app.runtime.shared_ring import require_room
    from tams_app.session.folder import session_bytes

    wanted = session_bytes(config)
    try:
        require_room(wanted)
    except SetupError as error:
        yield Finding("Shared memory", False, "", str(error))
        return
    yield Finding("Shared memory", True, f"{wanted / 1e6:.0f} MB wanted")


def display(config: Config) -> Iterator[Finding]:
    """Somewhere to show windows; without it TAMS runs with --headless, but for a keyboard."""
    from tams_app.faces.window import toolkit

    if config.headless:
        return
    needed = config.controller.device == "keyboard"  # its keys are the window's
    without = f"{'choose another --hand and ' if needed else 'run with '}--headless"
    server = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    if server and not toolkit.is_installed():
        fix = f"apt-get install gir1.2-gtk-4.0, or {without}"
        yield Finding("Display", False, "GTK 4 is missing", fix, essential=needed)
        return
    reason = tried(_WINDOW) if server else ""
    yield Finding(
        "Display",
        bool(server) and not reason,
        reason or server or "none",
        without,
        essential=needed,
    )


def predictive_display(config: Config) -> Iterator[Finding]:
    """Prediction of each view, where it is wanted: what must be known of its camera."""
    from tams_app.session.lenses import known_cameras
    from tams_app.station.mount_memory import MEASURE

    is_measured = any(camera.lens is not None for camera in config.cameras.values())
    if config.view.predict == "off" and not is_measured:
        return
    for view, known in known_cameras(config).items():
        yield Finding(
            f"Prediction of {view}",
            known.lens is not None,
            known.words,
            f"it is shown as received; to measure it: {MEASURE}",
            essential=False,
        )


def marked_keys(path: Path) -> Check:
    """The check of the keys marked SET in a file of one's hardware that are still as in ours."""

    def keys_marked_set(config: Config) -> Iterator[Finding]:
        from tams_app.config.marks import TEMPLATE, unset_keys

        if config.rig.enabled:
            return
        left = unset_keys(path)
        for what, essential in (("Your workspace and TCP", True), ("Other keys marked SET", False)):
            keys = [key for key in left if key.startswith(_PLACE) == essential]
            fix = (
                f"{', '.join(f'{key} (line {left[key]})' for key in keys)} in {path} still as in "
                f"our {TEMPLATE.name}: set, or remove the mark SET where the value is right"
            )
            yield Finding(what, not keys, "", fix, essential)

    return keys_marked_set


CHECKS: tuple[Check, ...] = (
    libraries,
    loading,
    gstreamer,
    configuration,
    rendering,
    shared_memory,
    disk,
    home_folder,
    realtime,
    display,
    predictive_display,
    arm,
    controller,
    headset,
    cameras,
)


def run_doctor(
    config: Config, checks: Sequence[Check], as_json: bool = False, console: Console | None = None
) -> int:
    """Run every check and print one line each; 0 if all that TAMS needs is there, else 1.

    `as_json`: print the findings as one list instead.
    """
    console = console or Console()
    found: list[Finding] = []
    for finding in examine(config, checks):
        found.append(finding)
        if not as_json:
            console.print(str(finding), soft_wrap=True)
    broken = sum(finding.is_broken for finding in found)
    if as_json:
        console.out(json.dumps([asdict(one) for one in found]))
    else:
        console.print(verdict(broken))
    return 1 if broken else 0
