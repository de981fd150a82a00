"""Eyes of the seeing operator, who gets what a person gets: the received images and their own hand.

The operator knows where the cameras stand, what the things look like, and what the hand did, and
nothing else: no capture time, index or latency, no state of arm, network or policy. They read in a
view's title that it is predicted: it is as late as the arm then, and not as its frames.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from hw.sim.operator.belief import Belief
from hw.sim.operator.belief_state import TO_BLOCK, TO_CONTAINER
from hw.sim.operator.detector import Detector
from hw.sim.operator.efference import FOLLOW_LAG_NS, EfferenceCopy, FrozenViewWatch, LagEstimator
from hw.sim.operator.operator import SimulatedOperator
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import GapSigmas, Percept, operator_hand
from hw.sim.operator.task import Stage
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from hw.sim.operator.vision.views import Glance, Thing, wrist_cameras
from tams_app.config import Config
from tams_app.records import Image, OperatorGlance, Pose, Vector
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_S


@dataclass(frozen=True, slots=True)
class OnScreen:
    """What is on screen: BGR 640 by 480, by view (None: nothing yet).

    predicted: the views whose titles say so.
    """

    images: Mapping[str, Image | None]
    predicted: frozenset[str] = frozenset()


Images = Callable[[int], OnScreen]  # at a time [ns]
_FINGERS_MOVED_M = 0.0015  # between glances
_LONGEST_S = 1.0  # between glances that a prediction makes sense of
_ABOUT_BLOCK = frozenset((Stage.REACH, Stage.TURN, Stage.DESCEND, Stage.CLOSE, Stage.LIFT))


class SeeingPerception:
    """Looks at the images at the participant's sampling rate, and knows a little later what it saw.

    `watch` is the eyes' work (some milliseconds a glance; live in a thread of its own, in virtual
    time before each step of the hand), `look` the hand's question, which never blocks.
    """

    def __init__(
        self, images: Images, asked: EfferenceCopy, sampling_s: float, delay_s: float
    ) -> None:
        """`images`: what is on screen.

        `asked`: the operator's own. `delay_s`: from the eye to the hand.
        """
        self._images = images
        self._asked = asked
        self._period_ns = round(sampling_s * NS_PER_S)
        self._delay_ns = round(delay_s * NS_PER_S)
        self.belief = Belief()  # others may read it
        self._detector = Detector()
        self._wrist_views = wrist_cameras().keys()
        self._lag = LagEstimator()
        self._predicted_lag = LagEstimator(FOLLOW_LAG_NS)
        self._freezes: dict[str, FrozenViewWatch] = {}
        self._shown: Vector = np.zeros(6)
        self._last_ns: int | None = None
        self._view_ns = 0
        self._opening: float | None = None
        self._coming: deque[tuple[int, Percept]] = deque()
        self._percept: Percept | None = None

    def watch(self, now_ns: int, stage: Stage) -> OperatorGlance | None:
        """Glance at the images if it is time to; `stage`: of the task, as the operator believes."""
        if self._last_ns is not None and now_ns - self._last_ns < self._period_ns:
            return None
        screen = self._images(now_ns)
        images = {view: image for view, image in screen.images.items() if image is not None}
        if not images:
            return None
        predicted = {
            view: images.pop(view) for view in self._wrist_views & screen.predicted & images.keys()
        }
        lag_ns = self._lag.lag_ns
        before = self.belief.state.copy()
        moved = self._advance(now_ns, lag_ns)
        frozen = tuple(
            view
            for view, image in images.items()
            if self._freezes.setdefault(view, FrozenViewWatch()).is_frozen(now_ns, image, moved)
        )
        for view in frozen:
            del images[view]
        if images:
            self._view_ns = max(self._view_ns, now_ns - lag_ns + FOLLOW_LAG_NS)
        glance = self._detector.look(images, self.belief)
        self._take_in(now_ns, glance)
        if predicted:
            opening = self._look_at_predicted(now_ns, lag_ns, predicted)
            glance = replace(glance, fingers_opening=opening)
        self.belief.learn_carried_part(before)
        if self.belief.seen[Thing.TOOL]:
            self._coming.append((now_ns + self._delay_ns, self._to_percept(glance)))
        return OperatorGlance(
            t_ns=now_ns,
            stage=stage.value,
            to_block=self.belief.shares(TO_BLOCK),
            to_container=self.belief.shares(TO_CONTAINER),
            about_block=stage in _ABOUT_BLOCK,
            block_sigma=self.belief.gap_sigma(TO_BLOCK),
            container_sigma=self.belief.gap_sigma(TO_CONTAINER),
            lag_ns=lag_ns,
            hanging=frozen,
        )

    def look(self, now_ns: int) -> Percept | None:
        """The last percept of what was seen that was understood by `now_ns`."""
        while self._coming and self._coming[0][0] <= now_ns:
            self._percept = self._coming.popleft()[1]
        return self._percept

    def _advance(self, now_ns: int, lag_ns: int) -> float:
        """Take the hand's motion into account as far as it can show; how far that was [m]."""
        shown = self._asked.asked_at(now_ns - lag_ns)
        moved, self._shown = shown - self._shown, shown
        last_ns, self._last_ns = self._last_ns, now_ns
        seconds = 0.0 if last_ns is None else min(_LONGEST_S, (now_ns - last_ns) / NS_PER_S)
        self.belief.predict(moved[:3], moved[3:], seconds)
        self.belief.hold_to_table()
        return math.sqrt(moved[:3] @ moved[:3])

    def _take_in(self, now_ns: int, glance: Glance) -> None:
        belief = self.belief
        self._watch_fingers(glance.fingers_opening)
        for sighting in glance.sightings:
            if sighting.thing is Thing.TOOL and belief.seen[Thing.TOOL]:
                slope = belief.camera(sighting.view).jacobian(belief.tcp)
                if len(sighting.pixels) == 1:
                    self._lag.see(sighting.view, now_ns, sighting.pixels[0], slope, self._asked)
        belief.take(glance.sightings)
        for heading in glance.headings:
            belief.take_heading(heading)

    def _look_at_predicted(
        self, now_ns: int, lag_ns: int, images: Mapping[str, Image]
    ) -> float | None:
        """Views that show the tool ahead of the others; the fingers' opening in them [m]."""
        then = self._asked.asked_at(now_ns - lag_ns)
        ahead = self._asked.asked_at(now_ns - self._predicted_lag.lag_ns) - then
        with self.belief.ahead_by(ahead[:3], ahead[3:]):
            glance = self._detector.look(images, self.belief)
            for sighting in glance.sightings:
                still = sighting.thing is Thing.CONTAINER or not self.belief.block_is_near
                if still and len(sighting.pixels) == 1:
                    slope = self.belief.passes(sighting)
                    source = f"{sighting.view} {sighting.thing}"
                    pixel = sighting.pixels[0]
                    self._predicted_lag.see(source, now_ns, pixel, slope, self._asked)
            self._take_in(now_ns, glance)
        return glance.fingers_opening

    def _watch_fingers(self, opening: float | None) -> None:
        if opening is None:
            return
        if self._opening is not None and abs(opening - self._opening) > _FINGERS_MOVED_M:
            self.belief.note_fingers_moved()
        self._opening = opening

    def _to_percept(self, glance: Glance) -> Percept:
        belief = self.belief
        return Percept(
            self._view_ns,
            Pose(belief.tcp.copy(), Rotation.from_matrix(belief.tool_axes)),
            Pose(belief.block.copy(), Rotation.from_matrix(belief.block_axes)),
            Pose(belief.container, Rotation.identity()),
            glance.fingers_opening,
            belief.sigma_of(Thing.TOOL),
            belief.sigma_of(Thing.BLOCK),
            GapSigmas(
                belief.gap_sigma(TO_BLOCK),
                belief.gap_sigma(TO_CONTAINER),
                belief.heading_sigma(),
            ),
        )


class SeeingParticipant:
    """Participant `seed`: eyes before `images`, which are all they get of the scene, and a hand.

    `watch` comes before each sample of `controller`. The same seeds, images and times give the
    same motion.
    """

    def __init__(self, config: Config, seed: int, images: Images, confirms: bool = True) -> None:
        """`confirms`: they arm the arm by the menu button."""
        traits, asked = ParticipantProfile.draw(seed), EfferenceCopy()
        settings, hand = config.rig.operator, operator_hand(config)
        self.eyes = SeeingPerception(images, asked, traits.sampling_s, traits.visuomotor_s)
        self.operator = SimulatedOperator(hand, settings, self.eyes, traits, seed, confirms, asked)
        self.controller = VirtualController(
            self.operator, settings, config.seed, rig_wiring(config)
        )

    def watch(self, now_ns: int) -> OperatorGlance | None:
        """Look, if it is time for a glance."""
        return self.eyes.watch(now_ns, self.operator.stage)
