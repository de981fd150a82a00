"""The end of the link that calls: until it is answered, and again once the robot falls silent.

It pins the robot's identity, which is in its key, and proves the key to that robot alone. The
certificate's dates are ignored: a robot may have no clock while it is off.
"""

from __future__ import annotations

import hmac
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from cryptography.hazmat.primitives.serialization import Encoding

from tams_app.link.addresses import Address
from tams_app.link.certificate import is_signed_by
from tams_app.link.channel import (
    GOODBYE,
    HAND_BYTES,
    LINK,
    QUESTION,
    RENEW_NS,
    REPLY,
    Channel,
    End,
    Heard,
)
from tams_app.link.keys import Key
from tams_app.link.proof import (
    GREETING_NONCE_BYTES,
    LONGEST_INTRODUCTION_BYTES,
    NONCE_BYTES,
    Busy,
    Challenge,
    Meeting,
    Proof,
    Welcome,
    answer,
    filled,
    framed,
    greeting,
    unfilled,
)
from tams_app.link.quic import Came, Connection, destination_of
from tams_app.units import NS_PER_MS, NS_PER_S

REDIAL_NS = 2 * NS_PER_S  # of silence, then call again
ATTEMPT_NS = 5 * NS_PER_S  # a call that came to nothing is begun anew
# Not heard for so long, a session is over, also for the robot's side, which hears of us no more: it
# may hear us all the time, and tell us that we are there already.
GIVE_UP_NS = 10 * NS_PER_S
_AGAIN_NS = 1000 * NS_PER_MS  # after *busy*
_JITTER_NS = 200 * NS_PER_MS  # more or less, so that nothing can keep step with them


@dataclass(slots=True)
class _Attempt:
    """A call to one address. `meeting`: what the proof that was sent is about."""

    channel: Channel
    certificate: bytes | None = None  # DER; of the robot that is called
    challenge: bytes | None = None
    meeting: Meeting | None = None


class Caller(End):
    """The operator's end."""

    def __init__(
        self,
        key: Key,
        robots: Sequence[Address],
        random: Callable[[int], bytes],
        introduction: bytes = b"",
    ) -> None:
        """`introduction`: what the robot's side is told with the call; cut if it is too long.

        `robots`: the addresses of the robot's side: all are called, and what answers first counts.
        """
        super().__init__(random)
        self._introduction = filled(introduction, LONGEST_INTRODUCTION_BYTES)
        self.welcome: bytes | None = None  # what the robot's side said last
        self.busy = False  # the robot's side has another operator
        self._key, self._robots = key, tuple(robots)
        self._attempts: list[_Attempt] = []
        self._again_ns = 0  # when to call the next time

    def step(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """What is to be sent now: calls, and what is due in them and in the session."""
        self._wear_out(now_ns)
        sent: list[tuple[bytes, Address]] = []
        channel, silent_ns = self._channel, self.silent_ns(now_ns)
        if channel is not None and silent_ns is not None and silent_ns >= GIVE_UP_NS:
            self._drop(channel)
        if channel is None or silent_ns is None or silent_ns >= REDIAL_NS:
            if now_ns >= self._again_ns:
                sent += self._call(now_ns)
        else:
            self._let_be(now_ns)
            if now_ns - channel.renewed_ns >= RENEW_NS:
                channel.renewed_ns = now_ns
                channel.connection.renew_keys()
        return sent + self._timed(now_ns)

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in; where it comes from does not matter."""
        channel = self._routes.get(destination_of(datagram)) if datagram else None
        if channel is None:
            self.counts["without a session" if datagram else "of no known kind"] += 1
            return Heard()
        came = self._received(channel, datagram, now_ns)
        if channel is not self._channel:
            attempt = next(one for one in self._attempts if one.channel is channel)
            return self._answered(attempt, came, now_ns)
        heard = self._said(channel, came, address, now_ns)
        if heard.messages or heard.media:
            self.busy = False  # said while it heard us, and we did not hear it
        return heard

    def _active(self, now_ns: int) -> Iterator[Channel]:
        yield from super()._active(now_ns)
        yield from (attempt.channel for attempt in self._attempts)

    # --- a call ---------------------------------------------------------------------------------

    def _call(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """Call all addresses; what was begun before has come to nothing."""
        self._hang_up()
        self._again_ns = now_ns + ATTEMPT_NS
        sent: list[tuple[bytes, Address]] = []
        for address in self._robots:
            token = greeting(self._key, self._random(GREETING_NONCE_BYTES))
            channel = Channel(Connection.calling(token, now_ns), address, HAND_BYTES, now_ns)
            self._routes[channel.connection.first_id] = channel
            self._attempts.append(_Attempt(channel))
            sent += channel.datagrams(now_ns)
        return sent

    def _let_be(self, now_ns: int) -> None:
        """The robot is heard again. A call that may have been answered goes on for a while."""
        for attempt in list(self._attempts):
            if attempt.meeting is None or now_ns >= self._again_ns:
                self._end(attempt)
        if not self._attempts:
            self._again_ns = now_ns

    def _hang_up(self) -> None:
        for attempt in list(self._attempts):
            self._end(attempt)

    def _end(self, attempt: _Attempt) -> None:
        if attempt in self._attempts:  # or it was welcomed, and ended at once
            self._attempts.remove(attempt)
        if attempt.channel is not self._channel:
            self._drop(attempt.channel)

    def _answered(self, attempt: _Attempt, came: Came, now_ns: int) -> Heard:
        """Something came of who is called."""
        channel = attempt.channel
        if came.asked:
            channel.connection.answer(answer(self._key, came.asked))
        if came.complete:
            shown = channel.connection.certificate
            if shown is None or not (
                self._key.robot is None or is_signed_by(shown, self._key.robot)
            ):
                channel.connection.ended = True
            else:
                attempt.certificate = shown.public_bytes(Encoding.DER)
        heard = Heard()
        for word in channel.words.of(came.stream):
            if isinstance(word, Challenge):
                attempt.challenge = word.nonce
            elif isinstance(word, Busy) and attempt.meeting is not None:
                return self._told_busy(attempt, now_ns)
            elif isinstance(word, Welcome) and attempt.meeting is not None:
                heard.connected = self._welcomed(attempt, attempt.meeting, word, now_ns)
        if channel.connection.ended or channel.words.ended:
            self._end(attempt)
            self._drop(channel)
            self.counts["answers that are not authentic"] += 1
            if not self._attempts:
                self._again(now_ns)
            return Heard()
        if attempt.meeting is None and attempt.certificate and attempt.challenge:
            self._prove(attempt, attempt.certificate, attempt.challenge)
        heard.replies += channel.datagrams(now_ns)
        return heard

    def _prove(self, attempt: _Attempt, certificate: bytes, challenge: bytes) -> None:
        nonce, said = self._random(NONCE_BYTES), self._introduction
        attempt.meeting = meeting = Meeting(self._key, certificate, challenge, nonce)
        proof = Proof(self._key.identity, nonce, meeting.proof(said), said)
        attempt.channel.connection.write(framed(proof))

    def _told_busy(self, attempt: _Attempt, now_ns: int) -> Heard:
        attempt.channel.message(GOODBYE, LINK)
        heard = Heard(replies=attempt.channel.datagrams(now_ns))
        self._end(attempt)
        if all(one.meeting is None for one in self._attempts):  # else it may be us who is there
            self.busy = True
            self._hang_up()
            self._again(now_ns)
        return heard

    def _again(self, now_ns: int) -> None:
        """Call again in a while."""
        drawn = int.from_bytes(self._random(4)) / 2**32
        self._again_ns = now_ns + _AGAIN_NS + round((2 * drawn - 1) * _JITTER_NS)

    def _welcomed(self, attempt: _Attempt, meeting: Meeting, welcome: Welcome, now_ns: int) -> bool:
        """Whether this is the robot's side, and we are in."""
        channel = attempt.channel
        if not hmac.compare_digest(meeting.welcome(welcome.content), welcome.mac):
            channel.words.ended = True
            return False
        if self._channel is not None:
            self._drop(self._channel)
        self._channel = channel
        channel.heard_ns = channel.renewed_ns = now_ns
        self.welcome, self.busy = unfilled(welcome.content), False
        self._hang_up()
        self._again_ns = now_ns
        return True

    # --- the session ----------------------------------------------------------------------------

    def _link_said(
        self, heard: Heard, channel: Channel, said: bytes, address: Address, now_ns: int
    ) -> None:
        if said.startswith(QUESTION):
            heard.replies += self.message(REPLY + said[len(QUESTION) :], now_ns, LINK)
        else:
            super()._link_said(heard, channel, said, address, now_ns)
