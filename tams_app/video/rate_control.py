"""Rate control of one view: the encoder servo, and frame dropping at the source.

x264 with a VBV of one frame undershoots its `bitrate` by 10-20 % (measured), and knows nothing of
packet headers and repair packets. `EncoderServo` compares the bytes that left during the last eight
frames with those allowed, and biases `bitrate`. `SourceDrop` leaves out whole frames where the
target would starve the encoder.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

RTP_IP_UDP_HEADER_BYTES = 40  # 12 + 20 + 8

WINDOW_FRAMES = 8
STEP_FRACTION = 0.10  # a larger change of the target starts a new window
_PROPORTIONAL = 0.8
_INTEGRAL = 0.12
_BIAS_MIN, _BIAS_MAX = -0.60, 0.50
_ERROR_MAX = 0.5  # one burst of repair packets must not starve the next eight frames
# Below this share of the target the frame itself needs no more bits: do not wind up.
_CONTENT_LIMITED_BELOW = 0.60


@dataclass(frozen=True, slots=True)
class _Sent:
    used_bytes: int
    allowed_bytes: float


class EncoderServo:
    """A PI controller from a view's wire rate to x264's `bitrate`, stepped before each frame.

    A frame dropped at the source is not stepped: its share goes to the frames that are kept, so
    the target is what the kept frames would cost at the full rate (`SourceDrop.frame_target_kbps`).
    """

    def __init__(self, fps: int, mtu_bytes: int) -> None:
        """`fps`: nominal frames per second. `mtu_bytes`: the payloader's, RTP header included."""
        self._fps = fps
        self._mtu_bytes = mtu_bytes
        self._integral = 0.0
        self._bias = 0.0
        self._target_kbps = 0.0
        self._wire_bytes = 0
        self._window: deque[_Sent] = deque(maxlen=WINDOW_FRAMES)

    def step(self, wire_bytes: int, target_kbps: float) -> int:
        """Take in what was sent, and control the next frame.

        Args:
            wire_bytes: IP datagram bytes that have left so far, repair packets included.
            target_kbps: the wire rate to meet [kbit/s]. A change of more than `STEP_FRACTION`
                starts a new window of measurement.

        Returns:
            The encoder's `bitrate` [kbit/s] for the next frame, at least 1.
        """
        if self._target_kbps:
            allowed = self._frame_bytes(self._target_kbps)
            self._window.append(_Sent(wire_bytes - self._wire_bytes, allowed))
        self._wire_bytes = wire_bytes
        if abs(target_kbps - self._target_kbps) > STEP_FRACTION * self._target_kbps:
            self._window.clear()
            self._bias = self._integral
        elif self._window:
            self._correct()
        self._target_kbps = target_kbps
        return max(1, round(self.payload_kbps(target_kbps) * (1.0 + self._bias)))

    def payload_kbps(self, wire_kbps: float) -> float:
        """H.264 bytes that fit into `wire_kbps` when every frame is cut into packets."""
        frame_bytes = max(self._frame_bytes(wire_kbps), 1.0)
        packets = frame_bytes / (self._mtu_bytes + 28) + 0.5
        return wire_kbps * max(1.0 - packets * RTP_IP_UDP_HEADER_BYTES / frame_bytes, 0.5)

    def _frame_bytes(self, kbps: float) -> float:
        return kbps * 1000.0 / 8.0 / self._fps

    def _correct(self) -> None:
        used = sum(sent.used_bytes for sent in self._window)
        allowed = sum(sent.allowed_bytes for sent in self._window)
        share = len(self._window) / WINDOW_FRAMES
        error = share * max(1.0 - used / max(allowed, 1.0), -_ERROR_MAX)
        if used >= _CONTENT_LIMITED_BELOW * allowed:
            self._integral = _clip(self._integral + _INTEGRAL * error)
        self._bias = _clip(self._integral + _PROPORTIONAL * error)


def _clip(bias: float) -> float:
    return min(max(bias, _BIAS_MIN), _BIAS_MAX)


class SourceDrop:
    """Keeps the fraction of frames that the target can pay for at `threshold_kbps` each second.

    Each frame earns target/threshold of a frame; a whole one is spent to keep it. So the kept
    frames have the bits that `threshold_kbps` would give them, and are spread evenly.
    """

    def __init__(self, threshold_kbps: float) -> None:
        self._threshold_kbps = threshold_kbps
        self._credit = 1.0  # the first frame is the keyframe: keep it

    def keep(self, target_kbps: float) -> bool:
        """Whether the next captured frame is encoded, at the view's present target."""
        kept = self._credit >= 1.0
        if kept:
            self._credit -= 1.0
        self._credit += target_kbps / self.frame_target_kbps(target_kbps)
        return kept

    def frame_target_kbps(self, target_kbps: float) -> float:
        """What the kept frames would cost at the full frame rate."""
        return max(target_kbps, self._threshold_kbps)
