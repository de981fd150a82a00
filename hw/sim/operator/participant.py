"""Participant profiles: the traits in which operators differ, drawn from published ranges.

Each field names its source; docs/OPERATOR_MODEL.md has the full references. A participant is one
seed, whatever scene they are given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tams_app.config import OperatorConfig


@dataclass(frozen=True, slots=True)
class ParticipantProfile:
    """One operator's traits."""

    reaction_s: float  # from seeing to beginning something new
    sampling_s: float  # between glances
    visuomotor_s: float  # from the eye to a correction under way
    reach_speed_m_s: float  # of the tool, at most
    fine_speed_m_s: float
    gain_per_s: float  # part of the remaining distance closed per second: ln 2 × throughput
    wait_limit_s: float  # for a better view; then the operator goes on without
    tremor: float  # times that of the hand at rest
    motor_noise: float  # of the speed, one standard deviation
    misjudged_rad: float  # the hand's directions against the tool's, per axis
    misjudged_scale: float

    @staticmethod
    def scripted(config: OperatorConfig) -> ParticipantProfile:
        """The configured operator, without a person's weaknesses."""
        return ParticipantProfile(
            reaction_s=config.reaction_s,
            sampling_s=1.0 / 13.0,
            visuomotor_s=0.0,
            reach_speed_m_s=config.reach_speed_m_s,
            fine_speed_m_s=config.fine_speed_m_s,
            gain_per_s=2.8,  # below 4/27 of the hand's own rate (its lags): no overshoot
            wait_limit_s=math.inf,
            tremor=1.0,
            motor_noise=0.0,
            misjudged_rad=math.radians(2.0),
            misjudged_scale=0.05,
        )

    @staticmethod
    def draw(seed: int) -> ParticipantProfile:
        """Participant `seed`; the same seed is always the same participant."""
        random = np.random.default_rng([seed, 0x9E0])
        # Woods et al. 2015: simple visual reaction times of 231 ms in the mean; spread of people
        # clipped to where nearly all of theirs lie.
        reaction_s = float(np.clip(random.normal(0.231, 0.030), 0.18, 0.32))
        # VanRullen, Reddy and Koch 2005: continuous motion is sampled about 13 times a second.
        sampling_s = 1.0 / random.uniform(11.0, 15.0)
        # Brenner and Smeets 1997: 110 ms until a hand follows a target that moved; Saunders and
        # Knill 2005: 117 ms for a shifted view of the own hand, 130 to 200 ms in distance.
        visuomotor_s = random.uniform(0.11, 0.16)
        # Soukoreff and MacKenzie 2004: throughputs of 3.7 to 4.9 bit/s in nine studies of a mouse.
        gain_per_s = math.log(2.0) * random.uniform(3.7, 4.9)
        # Nah 2004: about 2 s is what people tolerate waiting without receiving any feedback.
        wait_limit_s = random.uniform(1.5, 3.0)
        # Riviere, Rader and Khosla 1997: 49 um rms for eye surgeons who hold still, 133 um when
        # they work; the hand at rest has 49 um on each axis.
        tremor = random.uniform(0.8, 2.2)
        # How fast novices dare to drive: one trait for coarse and fine motion.
        skill = float(np.clip(random.lognormal(0.0, 0.15), 0.7, 1.4))
        return ParticipantProfile(
            reaction_s=reaction_s,
            sampling_s=sampling_s,
            visuomotor_s=visuomotor_s,
            reach_speed_m_s=REACH_SPEED_M_S * skill,
            fine_speed_m_s=FINE_SPEED_M_S * skill,
            gain_per_s=gain_per_s,
            wait_limit_s=wait_limit_s,
            tremor=tremor,
            motor_noise=random.uniform(0.05, 0.15),
            misjudged_rad=math.radians(random.uniform(1.0, 3.0)),
            misjudged_scale=random.uniform(0.03, 0.10),
        )


# The only free parameters, fitted to the paper: with lossless, undelayed video the times are about
# those of the paper's participants under S1 (`benchmarks.experiments.seeing_operator` at 628dd78b).
REACH_SPEED_M_S = 0.10
FINE_SPEED_M_S = 0.030
