"""Why the arm does not move, and what the operator does about it."""

from __future__ import annotations

from enum import Enum

from tams_app.teleop.hands import HandWords


def _fault(label: str, lasting: str, left: str = "") -> tuple[str, bool, str, str]:
    """Stops the arm, which stays stopped until the operator confirms."""
    return label, True, lasting, left


def _hold(label: str, lasting: str, left: str = "") -> tuple[str, bool, str, str]:
    """Stops the arm until the cause is gone and the deadman was released and pressed anew."""
    return label, False, lasting, left


class Reason(Enum):
    """Each with a short label, whether it is a fault or a hold, and what the operator does.

    That is told in two sentences: `lasting` while its cause is there, `left` once it is gone: what
    the operator still has to do. `left` is "" where the same sentence holds for both: the cause is
    a moment, is not looked for in a stopped arm, or stays until the session ends. Both take the
    words of the hand in use (`HandWords.fill`).

    The order is the order of precedence when several hold at once.
    """

    EMERGENCY_STOP = _fault(
        "emergency stop",
        "Make sure that the arm is safe, {release}, then confirm.",
    )
    GUARD_LOST = _fault(
        "guard lost",
        "The guard process that stops the arm independently is gone: start the session again.",
    )
    GUARD_SILENT = _fault(
        "guard silent",
        "The guard process that stops the arm independently does not answer: close other programs "
        "on this computer, wait until the guard is back, {release}, then confirm.",
        "The guard process answers again: {release}, then confirm.",
    )
    GUARD_STOPPED = _fault(
        "guard stopped the arm",
        "The control loop was silent for too long and the guard stopped the arm: close other "
        "programs on this computer, {release}, then confirm.",
    )
    COMPUTER_SLEPT = _fault(  # before what the arm and the link report of it
        "computer slept",
        "The computer beside the arm was suspended, and what it knew is from before: keep it "
        "awake, {release}, then confirm.",
    )
    ARM_MOVED_UNASKED = _fault(
        "arm moved unasked",
        "The arm moved although nothing was commanded, and the guard process stopped it: look for "
        "other programs that command it, {release}, then confirm.",
    )
    ARM_TOO_FAST = _fault(
        "arm too fast",
        "The arm moved faster than it was commanded to, and the guard process stopped it: look for "
        "other programs that command it, {release}, then confirm.",
    )
    ARM_OUTSIDE = _fault(
        "arm outside",
        "The arm left its workspace, and the guard process stopped it: see where it is, {release}, "
        "then confirm; `run_tams.py home` brings it back inside.",
    )
    SESSION_FAILED = _fault(  # before the stop that it sends
        "session failed",
        "A part of the session failed: read the last message, then start the session again.",
    )
    ARM_ERROR = _fault(
        "arm error",
        "The arm's controller reports an error: free the arm, {release}, then confirm.",
        "The arm's error is cleared: {release}, then confirm.",
    )
    ARM_LINK_LOST = _fault(
        "arm link lost",
        "Commands no longer reach the arm: check its power and network cable, {release}, "
        "then confirm.",
        "Commands can reach the arm again: {release}, then confirm.",
    )
    GUARD_BLIND = _fault(  # behind the arm's own link, which is usually lost with it
        "guard blind",
        "The guard process cannot reach the arm: check the network to the arm and wait until the "
        "guard is back, {release}, then confirm.",
        "The guard process reaches the arm again: {release}, then confirm.",
    )
    ARM_REFUSES = _fault(
        "arm refuses",
        "The arm refused a command: see why, free the arm, {release}, then confirm.",
    )
    GRIPPER_FAILED = _fault(
        "gripper failed",
        "The gripper does not do what it was told: check its plug at the flange, {release}, "
        "then confirm.",
    )
    ARM_SILENT = _fault(
        "arm silent",
        "The arm has stopped reporting: check its power and network cable, {release}, "
        "then confirm.",
        "The arm reports again: {release}, then confirm.",
    )
    ARM_STOPPED = _fault(
        "arm stopped",
        "The arm was stopped or paused from elsewhere: find out why, {release}, then confirm.",
    )
    ARM_MODE = _fault(
        "arm mode changed",
        "The arm left the servo mode: close other programs that command it, {release}, "
        "then confirm.",
    )
    FOLLOWING_ERROR = _fault(
        "following error",
        "The arm did not go where it was told: look for an obstacle, {release}, then confirm.",
    )
    LINK_LOST = _fault(
        "link lost",
        "Nothing usable comes from the operator's computer: check the network between the two "
        "computers, wait until the link is back, {release}, then confirm.",
        "Connected again; the arm is locked since the link was away: {release}, confirm to clear, "
        "confirm again to arm.",
    )
    OPERATOR_LEFT = _fault(
        "operator left",
        "The operator has left while the arm was armed: wait for the next one, {release}, then "
        "confirm.",
        "The operator before left while the arm was armed: {release}, confirm to clear, confirm "
        "again to arm.",
    )
    CONTROLLER_DISCONNECTED = _fault(
        "controller disconnected",
        "Nothing comes from {device}: {connect}, wait until it works, {release}, then confirm.",
        "{device} is back: {release}, then confirm.",
    )
    RUNTIME_QUIT = _fault(
        "VR runtime quit",
        "Start SteamVR, wait until the controller is tracked, {release}, then confirm.",
        "SteamVR is back: {release}, then confirm.",
    )
    ROLE_SWAPPED = _fault(
        "controller swapped",
        "Another controller has taken the operator's hand: take the right one, wait until it is "
        "tracked, {release}, then confirm.",
        "The right controller is tracked: {release}, then confirm.",
    )
    TRACKING_FRAME_CHANGED = _fault(
        "tracking frame changed",
        "The headset was recentred: check that the arm's directions are still right (dry run), "
        "{release}, then confirm.",
    )
    POSE_FROZEN = _fault(
        "pose frozen",
        "The hand's pose does not change: {check}, {release}, then confirm.",
        "The hand's pose had stopped changing: {check}, {release}, then confirm.",
    )
    HAND_TOO_FAST = _fault(
        "hand too fast",
        "The tracked hand jumps about: check the tracking and reflections, {release}, "
        "then confirm.",
    )
    TRAJECTORY_ERROR = _fault(
        "trajectory error",
        "The motion could not be computed: {release}, then confirm; report it if it comes back.",
    )
    TRACKING_LOST = _hold(
        "tracking lost",
        "Bring {device} back into the view of the tracking, then {release}.",
        "The tracking is back: {release}.",
    )
    CONTROLLER_STANDBY = _hold(
        "controller standby",
        "{wake}, then {release}.",
        "{device} is awake again: {release}.",
    )
    DASHBOARD_OPEN = _hold(
        "dashboard open",
        "Close the SteamVR dashboard, then {release}.",
        "The SteamVR dashboard is closed: {release}.",
    )
    BAD_INPUT = _hold(
        "bad input",
        "The values of {device} make no sense: {check}, then {release}.",
        "The values of {device} make sense again: {release}.",
    )
    NO_OPERATOR = _hold(
        "no operator",
        "No operator is connected: start `run_tams.py operate` at the operator's computer, then "
        "{release}.",
        "An operator is connected: {release}.",
    )
    LINK_GAP = _hold(
        "link gap",
        "Nothing usable comes from the operator's computer for the moment: wait until the link is "
        "back, then {release}.",
        "The link to the operator's computer is back: {release}.",
    )
    LINK_GAPS = _hold(
        "link gaps",
        "Too many gaps in what comes from the operator's computer: check the network between the "
        "two computers, then {release}.",
        "What comes from the operator's computer has no more gaps: {release}.",
    )
    HAND_NOT_FOLLOWED = _hold(
        "hand not followed",
        "Late or missing poses led the arm away from the hand: {check} and, between two "
        "computers, the network, then {release}.",
    )
    BUTTONS_STALE = _hold(
        "buttons stale",
        "The buttons of {device} are not read any more: {check}, then {release}.",
        "The buttons of {device} are read again: {release}.",
    )
    ARM_NOT_READY = _hold(
        "arm not ready",
        "The arm is not enabled: {release} and wait until it is.",
        "The arm is enabled: {release}.",
    )
    CONTROL_STALLED = _hold(  # before what it makes late
        "control stalled",
        "The control loop was held up: close other programs on this computer, then {release}.",
    )
    ARM_STATE_STALE = _hold(
        "arm report stale",
        "The arm's reports are late: check the network to the arm, then {release}.",
        "The arm's reports are in time again: {release}.",
    )
    ARM_STATE_INVALID = _hold(
        "arm report invalid",
        "The arm reports values that make no sense: check its firmware, then {release}.",
        "The arm's reports make sense again: {release}.",
    )
    ARM_REPLY_LATE = _hold(
        "arm reply late",
        "The arm answers commands too late: check the network to the arm, then {release}.",
        "The arm answers in time again: {release}.",
    )
    STALE_VIDEO = _hold(
        "stale video",
        "The video is too old to steer by: wait until it is back, then {release}.",
        "The video is back: {release}.",
    )
    VIDEO_DAMAGED = _hold(
        "video damaged",
        "Parts of the video were lost, so that what it shows may be wrong: wait until it is whole "
        "again, then {release}.",
        "The video is whole again: {release}.",
    )
    WORKSPACE = _hold(
        "workspace limit",
        "The edge of the workspace holds the arm: {release} and move back inside.",
    )
    ROTATION_LIMIT = _hold(
        "rotation limit",
        "The gripper is turned as far as allowed: {release} and turn it back.",
    )
    SINGULARITY = _hold(
        "singularity",
        "A joint cannot follow in this posture: {release} and move another way.",
    )

    def __init__(self, label: str, is_fault: bool, lasting: str, left: str) -> None:
        self.label = label
        self.is_fault = is_fault
        self.lasting = lasting
        self.left = left or lasting

    def sentence(self, hand: HandWords, lasts: bool = True) -> str:
        """The operator's next step, in the words of `hand`; `lasts`: its cause is still there."""
        return hand.fill(self.lasting if lasts else self.left)


_REASONS = {reason.label: reason for reason in Reason}
GO_ON = "{release}, then confirm."


def advice(held: str, lasting: str | None, hand: HandWords) -> str:
    """A stop as it is recorded, and what the operator does about it."""
    return f"{held}{'' if held.endswith('.') else '.'} {what_to_do(held, lasting, hand)}".strip()


def what_to_do(held: str, lasting: str | None, hand: HandWords) -> str:
    """The operator's next step after a stop as `robot.control.describe` has it; "" for no reason.

    `lasting`: label of the reason whose cause is still there, the same or one that came besides;
    "": it is gone; None: not known, as in a log of an older version. A detail that is a sentence
    says by itself what to do, but perhaps not how to go on.
    """
    label, _, detail = held.partition(": ")
    reason = _REASONS.get(label)
    if reason is None:
        return ""
    besides = _REASONS.get(lasting or "", reason)
    if besides is not reason:
        return besides.sentence(hand)
    if lasting == "":
        return reason.sentence(hand, lasts=False)
    if not detail.endswith("."):
        return reason.sentence(hand)
    return "" if "confirm" in held else hand.fill(GO_ON)


def refusal(in_the_way: Reason | None, hand: HandWords) -> str:
    """Why a confirmation does not count; None: but for the deadman nothing is in its way."""
    if in_the_way is None:
        return f"{hand.release} first."
    return f"{in_the_way.label}. {in_the_way.sentence(hand)}"
