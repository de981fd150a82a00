"""Messages of an operator's side, as the robot's side takes them in: samples, frames, requests."""

from __future__ import annotations

from collections.abc import Mapping

from hw.link.controller import LinkController
from tams_app.link.gaps import GapWatch
from tams_app.link.gateway_client import Received
from tams_app.link.messages import HandMessage, MessageError, decode
from tams_app.records import EpisodeRequest, HandHeard, Presses, SteeredBy
from tams_app.robot.control import TOO_LONG_AGO
from tams_app.robot.ground import Ground
from tams_app.teleop.hands import HAND_FACT, HANDS, hand_of
from tams_app.video.core.frame_identity import SentFrames


class LinkedHand:
    """The newest sample, the frames that count there, and each request once; for one thread.

    `hand`: what they drive with, of `HANDS`. `message`: the one sent last, whether it counted or
    not, received at `heard_ns`.
    """

    def __init__(
        self, ground: Ground, controller: LinkController, sent: Mapping[str, SentFrames]
    ) -> None:
        """`controller`: the one in the operator's hand. `sent`: by view, the frames behind the RTP
        timestamps of shown ones.
        """
        self._config, self._signals, self._log = ground.config, ground.signals, ground.log
        config = ground.config
        self.controller = controller
        self.hand = hand_of(config)
        self.message: HandMessage | None = None
        self.heard_ns = 0
        self.is_armed = False
        self._views = config.video.views
        self._sent = sent
        self._session = 0
        self._operator: int | None = None
        self._shown: dict[str, int | None] = dict.fromkeys(self._views)
        self._captured_ns: dict[str, int] = {}  # of the frame that is shown, once it was found
        self._damaged = dict.fromkeys(self._views, False)
        self._confirms = self._stops = self._menu_presses = 0
        self._episodes: tuple[int, ...] = ()
        self._notified: set[str] = set()
        self._gaps = GapWatch(config.link)

    @property
    def is_simulated(self) -> bool:
        """True if no person holds the controller, as far as is known."""
        return self.message is None or self.message.simulated

    def steered_by(self, view: str) -> SteeredBy:
        """Of the frame that counts there; its age counts from its capture here until now.

        So it is never taken for younger than it is.
        """
        timestamp = self._shown[view]
        sent = None if timestamp is None else self._sent[view].find(timestamp)
        if sent is not None:
            self._captured_ns[view] = sent.capture_ns
        return SteeredBy(timestamp, self._captured_ns.get(view), self._damaged[view])

    def wake(self, now_ns: int) -> None:
        """This computer was suspended: what is from before is too old."""
        self.controller.wake(now_ns)

    def take(self, received: Received, key: str) -> None:
        """Take in one message; `key`: whose it is, "" without keys."""
        try:
            message = decode(received.content, HandMessage)
        except MessageError as error:
            self.controller.refused["not understood"] += 1
            self._notify_once(f"messages of the operator's side are left out: {error}")
            return
        if received.session != self._session:
            self._begin(received.session, key)
        if message.operator != self._operator:
            self._operator = message.operator
            self._confirms = self._stops = 0
            self._episodes = message.episodes  # what was asked of another session does not count
            self._menu_presses = Presses(*message.presses).menu
        if message.simulated and not self._config.rig.enabled:
            self._notify_once("a simulated operator moves no real arm: its samples are left out")
            return
        self._sample(message, received.heard_ns)
        if self.message is None or message.sent_ns >= self.message.sent_ns:
            self._follow_newest(message, received.heard_ns)
        self._obey(message, received.heard_ns)

    def _begin(self, session: int, key: str) -> None:
        self._session = session
        self.controller.let_go()
        self.message = None
        self._signals.pinned = ""
        self._gaps.forget()
        self._shown = dict.fromkeys(self._views)
        self._damaged = dict.fromkeys(self._views, False)
        whose = f", with the key of {key}" if key else ""
        self._log.note("info", f"an operator is connected{whose}")

    def _sample(self, message: HandMessage, heard_ns: int) -> None:
        if message.hand != self.hand and message.hand in HANDS:
            self.hand = message.hand
            self._log.fact(HAND_FACT, message.hand)
        refusal = self.controller.take(message, heard_ns)
        if self.controller.counted_ns == heard_ns:
            advice = self._gaps.step(heard_ns, self.is_armed, self.controller.too_often)
            if advice:
                self._log.note("warning", advice)
        self._log.record(
            HandHeard(
                t_ns=heard_ns,
                sent_ns=message.sent_ns,
                pose_ns=message.pose_ns,
                echo_ns=message.echo_ns,
                refusal=refusal,
                operator=message.operator,
            )
        )

    def _follow_newest(self, message: HandMessage, heard_ns: int) -> None:
        """What the operator sees and has pinned: of a message that was not overtaken."""
        self.message, self.heard_ns = message, heard_ns
        for view, timestamp in zip(self._views, message.shown, strict=False):
            self._shown[view] = timestamp
        self._damaged.update(zip(self._views, message.damaged, strict=False))
        pinned = -1 if message.pinned is None else message.pinned
        self._signals.pinned = dict(enumerate(self._views)).get(pinned, "")

    def _obey(self, message: HandMessage, heard_ns: int) -> None:
        """Stops count however old they are; a confirmation only while it is fresh."""
        if message.stops > self._stops:
            self._stops = message.stops
            self._signals.estop()
        menu_presses = Presses(*message.presses).menu
        if menu_presses > self._menu_presses:  # also one that no sample has shown
            self._menu_presses = menu_presses
            if self.is_armed:
                self._signals.estop()
        counts = zip(EpisodeRequest, self._episodes, message.episodes, strict=True)
        for request, before, count in counts:
            if count > before:  # once, also where two presses come together: none is a second one
                self._signals.episode(request)
        self._episodes = tuple(map(max, self._episodes, message.episodes))  # it may be an older one
        if message.confirms <= self._confirms:
            return
        self._confirms = message.confirms
        age_ns = self.controller.clock.age_ns(message.sent_ns, message.echo_ns, heard_ns)
        if age_ns is None or message.confirmed_ns > message.sent_ns:
            self._log.note("warning", TOO_LONG_AGO)
        else:
            self._signals.confirm(heard_ns - age_ns - (message.sent_ns - message.confirmed_ns))

    @property
    def acknowledged(self) -> tuple[int, int]:
        """Confirmations and stops that were taken in, of the connected operator."""
        return self._confirms, self._stops

    def _notify_once(self, sentence: str) -> None:
        if sentence not in self._notified:
            self._notified.add(sentence)
            self._log.note("warning", sentence)
