"""Rate control of one view: the time between its frames, the encoder servo, drops at the source.

The time between a camera's frames is measured: cameras take longer exposures in dim light, and a
busy machine misses frames.

x264 takes frames for `X264_FPS` a second, whenever they come: each gets `bitrate`/`X264_FPS`, and a
VBV of one frame holds it to that. So the bits of a frame are set through `bitrate`, by the time
that passed before it. It undershoots by 10-20 % (measured), and knows nothing of packet headers and
repair packets: `EncoderServo` compares the bytes that left during the last eight frames with those
that their time allowed, and biases `bitrate`. `SourceDrop` leaves out whole frames where the target
would starve the encoder.

Other encoders are set to 30 frames a second, too, but none has a rate buffer of one frame that
grows with its bitrate (`codecs`).
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tams_app.units import NS_PER_MS, NS_PER_S

# Cameras are asked for 5 to 60 frames a second; with room for jitter. Frames that are rarer get no
# more bits: those of three views, taken at once, fill the queue of 150 ms in front of a bottleneck.
SHORTEST_NS, LONGEST_NS = 10 * NS_PER_MS, 250 * NS_PER_MS
_REMEMBERED = 3  # the least whose median one missed frame does not move
_PAID = 1.5  # usual intervals that a frame may be as large as
_COUNTED = 2.0  # usual intervals that may pass before it: one frame was missed
_FREEZE_NS = 200 * NS_PER_MS
_FREEZE_INTERVALS = 2.5  # two frames in a row are missing
X264_FPS = 30
RTP_IP_UDP_HEADER_BYTES = 40  # 12 + 20 + 8

WINDOW_FRAMES = 8
WINDOW_NS = 270 * NS_PER_MS  # to the nearest frame: 8 of 30 a second, 16 of 60
STEP_FRACTION = 0.10  # a larger change of the target starts a new window
_PROPORTIONAL = 0.8
_INTEGRAL = 0.12  # per frame of a window of eight
_BIAS_MIN, _BIAS_MAX = -0.60, 0.45  # with the packets' headers no frame reaches one and a half
_ERROR_MAX = 0.5  # one burst of repair packets must not starve the next eight frames
# Below this share of the target the frame itself needs no more bits: do not wind up.
_CONTENT_LIMITED_BELOW = 0.60
_WHOLE = 0.95  # of a frame's credit: an interval that jitters drops nothing at the threshold


@dataclass(frozen=True, slots=True)
class FrameTime:
    """The time before one frame [ns].

    Attributes:
        elapsed_ns: since the frame before, within `SHORTEST_NS` and `LONGEST_NS`.
        usual_ns: the median of the last three of these: one missed frame does not move it, and a
            camera that changes its rate is followed from its second interval on.
    """

    elapsed_ns: int
    usual_ns: int

    @property
    def paid_ns(self) -> int:
        """Time the frame may take on the link: never more than has passed, so no queue grows.

        At most one and a half usual intervals: after a gap the frame is not as large as the gap.
        """
        return min(self.elapsed_ns, round(_PAID * self.usual_ns))

    @property
    def counted_ns(self) -> int:
        """Time towards a view's rate: one missed frame is made up for, a gap is not."""
        return min(self.elapsed_ns, round(_COUNTED * self.usual_ns))


def freeze_ns(usual_ns: int) -> int:
    """A shown frame that stays longer is a freeze, where frames are usually `usual_ns` apart."""
    return max(_FREEZE_NS, round(_FREEZE_INTERVALS * usual_ns))


class FrameIntervals:
    """Watches the times of one view's frames."""

    def __init__(self, first_ns: int) -> None:
        """`first_ns`: what counts as the time before the first frame."""
        self._first_ns = first_ns
        self._last_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=_REMEMBERED)

    def step(self, capture_ns: int) -> FrameTime:
        if self._last_ns is not None:
            elapsed_ns = capture_ns - self._last_ns
            self._recent.append(min(max(elapsed_ns, SHORTEST_NS), LONGEST_NS))
        self._last_ns = capture_ns
        if not self._recent:
            return FrameTime(self._first_ns, self._first_ns)
        usual_ns = sorted(self._recent)[len(self._recent) // 2]
        return FrameTime(self._recent[-1], usual_ns)


@dataclass(frozen=True, slots=True)
class _Sent:
    used_bytes: int
    allowed_bytes: float
    time_ns: int


class EncoderServo:
    """A PI controller from a view's wire rate to x264's `bitrate`, stepped before each frame.

    A frame dropped at the source is not stepped: its share goes to the frames that are kept, so
    the target is what the kept frames would cost at the full rate (`SourceDrop.frame_target_kbps`).
    """

    def __init__(self, mtu_bytes: int) -> None:
        """`mtu_bytes`: the payloader's, RTP header included."""
        self._mtu_bytes = mtu_bytes
        self._integral = 0.0
        self._bias = 0.0
        self._target_kbps = 0.0
        self._counted_ns = 0
        self._wire_bytes = 0
        self._window: deque[_Sent] = deque()

    def step(self, wire_bytes: int, target_kbps: float, time: FrameTime) -> int:
        """Take in what was sent, and control the next frame.

        Args:
            wire_bytes: IP datagram bytes that have left so far, repair packets included.
            target_kbps: the wire rate to meet [kbit/s]. A change of more than `STEP_FRACTION`
                starts a new window of measurement.
            time: the time before the next frame.

        Returns:
            The encoder's `bitrate` [kbit/s] for the next frame, at least 1.
        """
        if self._target_kbps:
            allowed = _frame_bytes(self._target_kbps, self._counted_ns)
            self._window.append(_Sent(wire_bytes - self._wire_bytes, allowed, self._counted_ns))
            self._shorten(time.usual_ns)
        self._wire_bytes = wire_bytes
        if abs(target_kbps - self._target_kbps) > STEP_FRACTION * self._target_kbps:
            self._window.clear()
            self._bias = self._integral
        elif self._window:
            self._correct()
        self._target_kbps = target_kbps
        self._counted_ns = time.counted_ns
        return max(1, round(self.encoder_kbps(target_kbps, time.paid_ns) * (1.0 + self._bias)))

    def encoder_kbps(self, wire_kbps: float, frame_ns: int) -> float:
        """The `bitrate` at which a frame, cut into packets, takes `frame_ns` of `wire_kbps`."""
        frame_bytes = max(_frame_bytes(wire_kbps, frame_ns), 1.0)
        packets = frame_bytes / (self._mtu_bytes + 28) + 0.5
        payload = max(1.0 - packets * RTP_IP_UDP_HEADER_BYTES / frame_bytes, 0.5)
        return wire_kbps * payload * frame_ns * X264_FPS / NS_PER_S

    def _shorten(self, usual_ns: int) -> None:
        """Leave the window as many frames as come nearest to `WINDOW_NS`, eight at least."""
        window = self._window
        time_ns = sum(sent.time_ns for sent in window)
        while len(window) > WINDOW_FRAMES:
            time_ns -= window[0].time_ns
            if time_ns < WINDOW_NS - usual_ns // 2:
                break
            window.popleft()

    def _correct(self) -> None:
        used = sum(sent.used_bytes for sent in self._window)
        allowed = sum(sent.allowed_bytes for sent in self._window)
        share = len(self._window) / WINDOW_FRAMES
        error = min(share, 1.0) * max(1.0 - used / max(allowed, 1.0), -_ERROR_MAX)
        if used >= _CONTENT_LIMITED_BELOW * allowed:
            self._integral = _clip(self._integral + _INTEGRAL / max(share, 1.0) * error)
        self._bias = _clip(self._integral + _PROPORTIONAL * error)


def _frame_bytes(kbps: float, frame_ns: int) -> float:
    return kbps * 1000.0 / 8.0 * frame_ns / NS_PER_S


def _clip(bias: float) -> float:
    return min(max(bias, _BIAS_MIN), _BIAS_MAX)


class SourceDrop:
    """Keeps the fraction of frames that the target can pay for.

    A frame must have at least what `threshold_kbps` gives each of 30 a second. At a lower target
    each frame earns a part of a frame; a whole one is spent to keep it. So the kept frames have the
    bits that the threshold would give them, and are spread evenly.
    """

    def __init__(self, threshold_kbps: float) -> None:
        self._threshold_kbps = threshold_kbps
        self._credit = 1.0  # the first frame is the keyframe: keep it

    def keep(self, target_kbps: float, usual_ns: int) -> bool:
        """True if the next captured frame is encoded, at the view's present target and rate."""
        kept = self._credit >= _WHOLE
        if kept:
            self._credit -= 1.0
        self._credit += target_kbps / self.frame_target_kbps(target_kbps, usual_ns)
        return kept

    def frame_target_kbps(self, target_kbps: float, usual_ns: int) -> float:
        """The rate that the kept frames would have if all were kept."""
        return max(target_kbps, self._threshold_kbps * NS_PER_S / (X264_FPS * usual_ns))
