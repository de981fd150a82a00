"""The predictive display of a session, made of its configuration."""

from __future__ import annotations

from collections.abc import Callable

from hw.arms import arm_kind
from tams_app.config import Config
from tams_app.prediction.camera_check import CameraCheck
from tams_app.prediction.forward_model import ForwardModel
from tams_app.prediction.outline import links_of
from tams_app.prediction.present import (
    PREDICTED_FACT,
    CorrectedView,
    MountTrail,
    PredictedCamera,
    Present,
    WristView,
)
from tams_app.recording.journal import Journal
from tams_app.records import MountPrediction, ShownFrame
from tams_app.robot.build import ready_pose
from tams_app.runtime.clock import Clock
from tams_app.runtime.parts import Parts
from tams_app.session.late_states import LateStates
from tams_app.session.lenses import WRIST_VIEW, known_cameras
from tams_app.session.viewing import scene_of, tool_tip
from tams_app.station.camera_watch import MEASURE, misfit
from tams_app.station.mount_memory import MountMemory
from tams_app.video.live.networks import resolve_network

_NOT_KNOWN = "view.predict: how the hand moves the arm is not known: all is shown as received"


def predicted_cameras(config: Config) -> dict[str, PredictedCamera]:
    """By view, the cameras whose frames `view.predict` wants to be corrected."""
    scene = scene_of(config)
    if config.view.predict == "off" or scene.figure is None:
        return {}
    flange = scene.figure.flange
    tool, grip = scene.figure.solids[flange], scene.figure.grip
    tip, links = tool_tip(config, scene.figure), links_of(scene.figure)
    cameras = {}
    for view, lens in scene.lenses.items():
        if lens.parent == flange:
            cameras[view] = PredictedCamera(lens, tool, grip)
        elif config.view.predict == "all":
            cameras[view] = PredictedCamera(lens, tool, on_arm=False, tip=tip, links=links)
    return cameras


def as_received(config: Config) -> dict[str, str]:
    """By view, why its frames are not corrected although `view.predict` wants it: a clause."""
    if config.view.predict == "off":
        return {}
    known, predicted = known_cameras(config), predicted_cameras(config)
    only = config.view.predict == "eih" and WRIST_VIEW in known
    views = (WRIST_VIEW,) if only else tuple(known)
    return {
        view: "it is not on the arm" if known[view].lens else known[view].words
        for view in views
        if view not in predicted
    }


def follow_states(
    config: Config, clock: Clock, parts: Parts, log: Journal, mount: MountMemory | None
) -> tuple[LateStates, ...]:
    """What tells `mount` where the arm is, where both sides are one process; a thread works."""
    if not _told(config, log, mount):
        return ()
    assert mount is not None
    present = _spared(log, present_of(config, _logged(log, mount.put), lambda: mount.camera_fits))
    states = LateStates(present, resolve_network(config, config.network))
    parts.run("prediction", lambda stop: states.run(stop, clock))
    return (states,)


def predicted_trial(
    config: Config, log: Journal
) -> tuple[tuple[LateStates, ...], dict[str, CorrectedView], Callable[[ShownFrame], None]]:
    """The same in virtual time; by view, what shows its frames if they are corrected.

    The last is to get each frame that reaches the screen.
    """
    cameras, trail = predicted_cameras(config), MountTrail()
    if not cameras:
        return (), {}, lambda _shown: None
    log.fact(PREDICTED_FACT, ",".join(cameras))
    views: dict[str, CorrectedView] = {one: cameras[one].view(trail) for one in cameras}
    checks = {view: CameraCheck(one) for view, one in views.items() if isinstance(one, WristView)}

    def fits() -> bool:
        return all(check.fits for check in checks.values())

    def shown(frame: ShownFrame) -> None:
        if frame.view in checks and checks[frame.view].shown(frame):
            log.note("warning", misfit(frame.view))

    network = resolve_network(config, config.network)
    present = present_of(config, _logged(log, trail.add), fits)
    return (LateStates(present, network, at_once=True),), views, shown


def linked_present(
    ours: Config, moves_by: Config | None, log: Journal, mount: MountMemory | None
) -> Present | None:
    """What tells `mount` where the arm at the other end of a link is.

    `moves_by`: the configuration by which it moves; None: that was not told.
    """
    if not _told(ours, log, mount):
        return None
    assert mount is not None
    if moves_by is None:
        log.note("warning", _NOT_KNOWN)
        return None
    return _spared(log, present_of(moves_by, _logged(log, mount.put), lambda: mount.camera_fits))


def _logged(
    log: Journal, tell: Callable[[MountPrediction], None]
) -> Callable[[MountPrediction], None]:
    """`tell`, and the log keeps what is told."""

    def told(prediction: MountPrediction) -> None:
        tell(prediction)
        log.record(prediction)

    return told


def _spared(log: Journal, present: Present) -> Present:
    """`present`, whose failure is not the session's: frames are shown as received from then on."""
    present.on_failure = lambda error: log.note(
        "warning", f"the prediction failed ({error!r}): frames are shown as received"
    )
    return present


def _told(config: Config, log: Journal, mount: MountMemory | None) -> bool:
    """Record which views are predicted; whether any is."""
    for view, reason in as_received(config).items():
        log.note("warning", f"{view.upper()} is shown as received: {reason}; measure it: {MEASURE}")
    if mount is not None:
        log.fact(PREDICTED_FACT, ",".join(mount.cameras))
    return mount is not None


def present_of(
    config: Config, tell: Callable[[MountPrediction], None], camera_fits: Callable[[], bool]
) -> Present:
    """What follows the arm's flange for those cameras; `tell` gets where it is believed to be.

    `camera_fits`: as for `Present`.
    """
    kind = arm_kind(config.arm.model)
    figure = kind.figure()
    assert figure is not None, "there are no such cameras without"
    model = ForwardModel(config, kind.kinematics(config.arm), ready_pose(config).rotation)
    return Present(model, figure, tell, camera_fits)
