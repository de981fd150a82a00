import math

import pytest

from hw.sim.operator.participant import ParticipantProfile
from tams_app.config import OperatorConfig

pytestmark = pytest.mark.untimed

PEOPLE = [ParticipantProfile.draw(seed) for seed in range(200)]


def test_the_same_seed_is_the_same_person_and_people_differ():
    assert ParticipantProfile.draw(7) == ParticipantProfile.draw(7)
    assert len(set(PEOPLE)) == len(PEOPLE)


def test_traits_stay_within_the_published_ranges():
    for person in PEOPLE:
        assert 0.18 <= person.reaction_s <= 0.32
        assert 0.11 <= person.visuomotor_s <= 0.16
        assert 10.0 <= 1.0 / person.sampling_s <= 15.0
        assert 3.7 <= person.gain_per_s / math.log(2.0) <= 4.9
        assert 1.5 <= person.wait_limit_s <= 3.0
        assert person.fine_speed_m_s < person.reach_speed_m_s
    mean = sum(person.reaction_s for person in PEOPLE) / len(PEOPLE)
    assert abs(mean - 0.231) < 0.01


def test_the_script_has_no_person_s_weaknesses():
    script = ParticipantProfile.scripted(OperatorConfig(reaction_s=0.4))
    assert script.reaction_s == 0.4
    assert script.motor_noise == 0.0
    assert script.wait_limit_s == math.inf
