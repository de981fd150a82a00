"""Why the arm does not move, and what the operator does about it."""

from __future__ import annotations

from enum import Enum


def _fault(label: str, sentence: str) -> tuple[str, bool, str]:
    """Stops the arm, which stays stopped until the operator confirms."""
    return label, True, sentence


def _hold(label: str, sentence: str) -> tuple[str, bool, str]:
    """Stops the arm, which goes on after the trigger was released and the cause is gone."""
    return label, False, sentence


class Reason(Enum):
    """Each with a short label, whether it is a fault or a hold, and what the operator does.

    The order is the order of precedence when several hold at once.
    """

    EMERGENCY_STOP = _fault(
        "emergency stop",
        "Make sure that the arm is safe, release the trigger, then confirm.",
    )
    GUARD_LOST = _fault(
        "guard lost",
        "The guard process that stops the arm independently is gone: start the session again.",
    )
    GUARD_SILENT = _fault(
        "guard silent",
        "The guard process that stops the arm independently does not answer: close other programs "
        "on this computer, wait until the guard is back, release the trigger, then confirm.",
    )
    GUARD_STOPPED = _fault(
        "guard stopped the arm",
        "The control loop was silent for too long and the guard stopped the arm: close other "
        "programs on this computer, release the trigger, then confirm.",
    )
    SESSION_FAILED = _fault(  # before the stop that it sends
        "session failed",
        "A part of the session failed: read the last message, then start the session again.",
    )
    ARM_ERROR = _fault(
        "arm error",
        "The arm's controller reports an error: free the arm, release the trigger, then confirm.",
    )
    ARM_LINK_LOST = _fault(
        "arm link lost",
        "Commands no longer reach the arm: check its power and network cable, then confirm.",
    )
    GUARD_BLIND = _fault(  # behind the arm's own link, which is usually lost with it
        "guard blind",
        "The guard process cannot reach the arm: check the network to the arm and wait until the "
        "guard is back, release the trigger, then confirm.",
    )
    ARM_REFUSES = _fault(
        "arm refuses",
        "The arm refused a command: see why, free the arm, release the trigger, then confirm.",
    )
    GRIPPER_FAILED = _fault(
        "gripper failed",
        "The gripper does not do what it was told: check its plug at the flange, "
        "release the trigger, then confirm.",
    )
    ARM_SILENT = _fault(
        "arm silent",
        "The arm has stopped reporting: check its power and network cable, then confirm.",
    )
    ARM_STOPPED = _fault(
        "arm stopped",
        "The arm was stopped or paused from elsewhere: find out why, release the trigger, "
        "then confirm.",
    )
    ARM_MODE = _fault(
        "arm mode changed",
        "The arm left the servo mode: close other programs that command it, then confirm.",
    )
    FOLLOWING_ERROR = _fault(
        "following error",
        "The arm does not go where it is told: look for an obstacle, release the trigger, "
        "then confirm.",
    )
    LINK_LOST = _fault(
        "link lost",
        "Nothing usable comes from the operator's computer: check the network between the two "
        "computers, wait until the link is back, release the trigger, then confirm.",
    )
    CONTROLLER_DISCONNECTED = _fault(
        "controller disconnected",
        "Switch the controller on or plug it in, wait until it is tracked, then confirm.",
    )
    RUNTIME_QUIT = _fault(
        "VR runtime quit",
        "Start SteamVR, wait until the controller is tracked, release the trigger, then confirm.",
    )
    ROLE_SWAPPED = _fault(
        "controller swapped",
        "Another controller has taken the operator's hand: take the right one, wait until it is "
        "tracked, release the trigger, then confirm.",
    )
    TRACKING_FRAME_CHANGED = _fault(
        "tracking frame changed",
        "The headset was recentred: check that the arm's directions are still right (dry run), "
        "release the trigger, then confirm.",
    )
    POSE_FROZEN = _fault(
        "pose frozen",
        "The controller's pose has stopped changing: check SteamVR and the controller, "
        "release the trigger, then confirm.",
    )
    HAND_TOO_FAST = _fault(
        "hand too fast",
        "The tracked hand jumps about: check the tracking and reflections, release the trigger, "
        "then confirm.",
    )
    TRAJECTORY_ERROR = _fault(
        "trajectory error",
        "The motion could not be computed: release the trigger, then confirm; "
        "report it if it comes back.",
    )
    TRACKING_LOST = _hold(
        "tracking lost",
        "Bring the controller back into the view of the tracking, then release the trigger.",
    )
    CONTROLLER_STANDBY = _hold(
        "controller standby",
        "Put the headset on or wake the controller, or click into the window that takes the keys, "
        "then release the trigger.",
    )
    DASHBOARD_OPEN = _hold(
        "dashboard open",
        "Close the SteamVR dashboard, then release the trigger.",
    )
    BAD_INPUT = _hold(
        "bad input",
        "The controller sends values that make no sense: check SteamVR, then release the trigger.",
    )
    BUTTONS_STALE = _hold(
        "buttons stale",
        "The controller's buttons are not read any more: check SteamVR and its dashboard, or the "
        "window that takes the keys, then release the trigger.",
    )
    ARM_NOT_READY = _hold(
        "arm not ready",
        "The arm is not enabled: wait until it is, with the trigger released.",
    )
    CONTROL_STALLED = _hold(  # before what it makes late
        "control stalled",
        "The control loop was held up: close other programs on this computer, "
        "then release the trigger.",
    )
    ARM_STATE_STALE = _hold(
        "arm report stale",
        "The arm's reports are late: check the network to the arm, then release the trigger.",
    )
    ARM_STATE_INVALID = _hold(
        "arm report invalid",
        "The arm reports values that make no sense: check its firmware, then release the trigger.",
    )
    ARM_REPLY_LATE = _hold(
        "arm reply late",
        "The arm answers commands too late: check the network to the arm, "
        "then release the trigger.",
    )
    STALE_VIDEO = _hold(
        "stale video",
        "The video is too old to steer by: wait until it is back, then release the trigger.",
    )
    WORKSPACE = _hold(
        "workspace limit",
        "The arm is at the edge of its workspace: release the trigger and move back inside.",
    )
    ROTATION_LIMIT = _hold(
        "rotation limit",
        "The gripper is turned as far as allowed: release the trigger and turn it back.",
    )
    SINGULARITY = _hold(
        "singularity",
        "A joint cannot follow in this posture: release the trigger and move another way.",
    )

    def __init__(self, label: str, is_fault: bool, sentence: str) -> None:
        self.label = label
        self.is_fault = is_fault
        self.sentence = sentence
