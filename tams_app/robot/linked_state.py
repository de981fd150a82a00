"""Messages to an operator over the link: the state, pulses, sentences, and the session's end."""

from __future__ import annotations

import msgspec

from tams_app.link.channel import LONGEST_MESSAGE_BYTES, STATE_BYTES, message_bytes
from tams_app.link.messages import STATE_RATE_HZ, HandMessage, StateMessage, encode
from tams_app.records import IP_UDP_HEADER_BYTES, Haptic, SessionState
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S

_SHARE = 0.1  # of the uplink at most, but on the narrowest
_LEAST_HZ = 10.0
_NOTES_KEPT = 3
_NOTE_BYTES = 220


def state_interval_ns(capacity_kbps: float) -> int:
    """The time between two states on an uplink that is believed to carry so much.

    They take a tenth of it, 10 to 60 times a second: at 60 their datagrams alone are 277 kbit/s.
    """
    state_bits = 8 * (message_bytes(0, STATE_BYTES) + IP_UDP_HEADER_BYTES)
    rate_hz = min(max(1000 * _SHARE * capacity_kbps / state_bits, _LEAST_HZ), STATE_RATE_HZ)
    return round(NS_PER_S / rate_hz) - NS_PER_S // 1000  # of a tick's time, some less


class LinkedState:
    """Makes the state messages of one session; for one thread at a time."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._haptics, self._haptic = 0, ""
        self._notes: tuple[int, tuple[str, ...]] = (0, ())
        self._last: StateMessage | None = None

    def note(self, text: str) -> None:
        """A sentence that the operator should read."""
        noted, notes = self._notes
        self._notes = (noted + 1, (*notes, cut(text))[-_NOTES_KEPT:])

    def pulse(self, haptic: Haptic) -> None:
        """A pulse that they should feel."""
        self._haptics += 1
        self._haptic = haptic.value

    def datagram(
        self,
        state: SessionState,
        newest: HandMessage | None,
        heard_ns: int,
        acknowledged: tuple[int, int],
        first_capture_ns: tuple[int | None, ...],
    ) -> bytes:
        """The message; `newest`: sample, received at `heard_ns`; the others are fields of it."""
        sent_ns = self._clock.now_ns()
        noted, notes = self._notes
        new = notes[-max(0, noted - newest.noted) :] if newest and newest.noted < noted else ()
        confirms, stops = acknowledged
        self._last = StateMessage(
            sent_ns=sent_ns,
            echo_ns=0 if newest is None else newest.sent_ns,
            echo_heard_ns=heard_ns,
            state=msgspec.structs.replace(state, reason=cut(state.reason)),
            first_capture_ns=first_capture_ns,
            haptics=self._haptics,
            haptic=self._haptic,
            confirms=confirms,
            stops=stops,
            noted=noted,
            notes=new,
            ended="",
            failed=False,
        )
        return _fitting(self._last)

    def farewell(self, reason: str, failed: bool, placed: bool) -> bytes | None:
        """The last state, with the end of the session and the last sentences; None: none yet.

        `placed`: the block is; that ends a simulated operator's session before another state.
        """
        if self._last is None:
            return None
        noted, notes = self._notes
        now_ns = self._clock.now_ns()
        return _fitting(
            msgspec.structs.replace(
                self._last,
                sent_ns=now_ns,
                state=msgspec.structs.replace(self._last.state, placed=placed),
                noted=noted,
                notes=notes,
                ended=cut(reason or "the session is over"),
                failed=failed,
            )
        )


def _fitting(state: StateMessage) -> bytes:
    """The message, without the joints and the oldest of its sentences where it would be too long.

    With a long reason it would be as long as only messages with sentences are.
    """
    content = encode(state)
    if len(content) > STATE_BYTES and not state.notes:
        still = msgspec.structs.replace(state.state, joints_urad=())
        content = encode(msgspec.structs.replace(state, state=still))
    while len(content) > LONGEST_MESSAGE_BYTES and state.notes:
        state = msgspec.structs.replace(state, notes=state.notes[1:])
        content = encode(state)
    return content


def cut(text: str) -> str:
    """A sentence in at most 220 bytes."""
    return text.encode()[:_NOTE_BYTES].decode(errors="ignore")
