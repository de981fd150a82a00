"""Why the arm does not move, and what the operator does about it."""

from __future__ import annotations

from enum import Enum


class Severity(Enum):
    """What a reason does to an arm that is armed."""

    HOLD = "hold"  # stops; goes on after the trigger was released and the cause is gone
    FAULT = "fault"  # stops and stays stopped until the operator confirms


class Reason(Enum):
    """Each with a short label, a severity and a sentence that says what to do.

    The order is the order of precedence when several hold at once.
    """

    EMERGENCY_STOP = (
        "emergency stop",
        Severity.FAULT,
        "Make sure that the arm is safe, release the trigger, then confirm.",
    )
    GUARD_LOST = (
        "guard lost",
        Severity.FAULT,
        "The guard process that stops the arm independently is gone: start the session again.",
    )
    GUARD_STOPPED = (
        "guard stopped the arm",
        Severity.FAULT,
        "The control loop was silent for too long and the guard stopped the arm: close other "
        "programs on this computer, release the trigger, then confirm.",
    )
    SESSION_FAILED = (  # before the stop that it sends
        "session failed",
        Severity.FAULT,
        "A part of the session failed: read the last message, then start the session again.",
    )
    ARM_ERROR = (
        "arm error",
        Severity.FAULT,
        "The arm's controller reports an error: free the arm, release the trigger, then confirm.",
    )
    ARM_LINK_LOST = (
        "arm link lost",
        Severity.FAULT,
        "Commands no longer reach the arm: check its power and network cable, then confirm.",
    )
    GUARD_BLIND = (  # behind the arm's own link, which is usually lost with it
        "guard blind",
        Severity.FAULT,
        "The guard process cannot reach the arm: check the network to the arm and wait until the "
        "guard is back, release the trigger, then confirm.",
    )
    ARM_REFUSES = (
        "arm refuses",
        Severity.FAULT,
        "The arm refused a command: see why, free the arm, release the trigger, then confirm.",
    )
    GRIPPER_FAILED = (
        "gripper failed",
        Severity.FAULT,
        "The gripper does not do what it was told: check its plug at the flange, "
        "release the trigger, then confirm.",
    )
    ARM_SILENT = (
        "arm silent",
        Severity.FAULT,
        "The arm has stopped reporting: check its power and network cable, then confirm.",
    )
    ARM_STOPPED = (
        "arm stopped",
        Severity.FAULT,
        "The arm was stopped or paused from elsewhere: find out why, release the trigger, "
        "then confirm.",
    )
    ARM_MODE = (
        "arm mode changed",
        Severity.FAULT,
        "The arm left the servo mode: close other programs that command it, then confirm.",
    )
    FOLLOWING_ERROR = (
        "following error",
        Severity.FAULT,
        "The arm does not go where it is told: look for an obstacle, release the trigger, "
        "then confirm.",
    )
    CONTROLLER_DISCONNECTED = (
        "controller disconnected",
        Severity.FAULT,
        "Switch the VR controller on, wait until it is tracked, then confirm.",
    )
    RUNTIME_QUIT = (
        "VR runtime quit",
        Severity.FAULT,
        "Start SteamVR, wait until the controller is tracked, release the trigger, then confirm.",
    )
    ROLE_SWAPPED = (
        "controller swapped",
        Severity.FAULT,
        "Another controller has taken the operator's hand: take the right one, wait until it is "
        "tracked, release the trigger, then confirm.",
    )
    TRACKING_FRAME_CHANGED = (
        "tracking frame changed",
        Severity.FAULT,
        "The headset was recentred: check that the arm's directions are still right (dry run), "
        "release the trigger, then confirm.",
    )
    POSE_FROZEN = (
        "pose frozen",
        Severity.FAULT,
        "The controller's pose has stopped changing: check SteamVR and the controller, "
        "release the trigger, then confirm.",
    )
    HAND_TOO_FAST = (
        "hand too fast",
        Severity.FAULT,
        "The tracked hand jumps about: check the tracking and reflections, release the trigger, "
        "then confirm.",
    )
    TRAJECTORY_ERROR = (
        "trajectory error",
        Severity.FAULT,
        "The motion could not be computed: release the trigger, then confirm; "
        "report it if it comes back.",
    )
    TRACKING_LOST = (
        "tracking lost",
        Severity.HOLD,
        "Bring the controller back into the view of the tracking, then release the trigger.",
    )
    CONTROLLER_STANDBY = (
        "controller standby",
        Severity.HOLD,
        "Put the headset on or wake the controller, then release the trigger.",
    )
    DASHBOARD_OPEN = (
        "dashboard open",
        Severity.HOLD,
        "Close the SteamVR dashboard, then release the trigger.",
    )
    BAD_INPUT = (
        "bad input",
        Severity.HOLD,
        "The controller sends values that make no sense: check SteamVR, then release the trigger.",
    )
    BUTTONS_STALE = (
        "buttons stale",
        Severity.HOLD,
        "The controller's buttons are not read any more: check SteamVR and its dashboard, "
        "then release the trigger.",
    )
    ARM_NOT_READY = (
        "arm not ready",
        Severity.HOLD,
        "The arm is not enabled: wait until it is, with the trigger released.",
    )
    CONTROL_STALLED = (  # before what it makes late
        "control stalled",
        Severity.HOLD,
        "The control loop was held up: close other programs on this computer, "
        "then release the trigger.",
    )
    ARM_STATE_STALE = (
        "arm report stale",
        Severity.HOLD,
        "The arm's reports are late: check the network to the arm, then release the trigger.",
    )
    ARM_STATE_INVALID = (
        "arm report invalid",
        Severity.HOLD,
        "The arm reports values that make no sense: check its firmware, then release the trigger.",
    )
    ARM_REPLY_LATE = (
        "arm reply late",
        Severity.HOLD,
        "The arm answers commands too late: check the network to the arm, "
        "then release the trigger.",
    )
    STALE_VIDEO = (
        "stale video",
        Severity.HOLD,
        "The video is too old to steer by: wait until it is back, then release the trigger.",
    )
    WORKSPACE = (
        "workspace limit",
        Severity.HOLD,
        "The arm is at the edge of its workspace: release the trigger and move back inside.",
    )
    ROTATION_LIMIT = (
        "rotation limit",
        Severity.HOLD,
        "The gripper is turned as far as allowed: release the trigger and turn it back.",
    )
    SINGULARITY = (
        "singularity",
        Severity.HOLD,
        "A joint cannot follow in this posture: release the trigger and move another way.",
    )

    def __init__(self, label: str, severity: Severity, sentence: str) -> None:
        self.label = label
        self.severity = severity
        self.sentence = sentence

    @property
    def is_fault(self) -> bool:
        return self.severity is Severity.FAULT
