"""Sign of Doppler velocities, from the ranges of targets in successive frames."""

import numpy as np
import pytest

from dechirp.processing.velocity_ambiguity.sign_by_range_rate import (
    DECISIVE_LOG_LIKELIHOOD_RATIO,
    velocity_sign_log_likelihood_ratio,
)
from physics.test_range_rate_ambiguity import FRAME_S, SOUND_CARD, make_columns

FRAME = np.arange(40)
TIME_S = FRAME * FRAME_S


def walk(rng):
    """Return ranges and velocities of a person who walks to and fro."""
    velocity = 1.5 * np.sin(2 * np.pi * TIME_S / 12 + rng.uniform(0, 2 * np.pi))
    range_m = 20 + np.cumsum(velocity) * FRAME_S + 0.2 * rng.normal(size=FRAME.size)
    return range_m, velocity + 0.15 * rng.normal(size=FRAME.size)


@pytest.mark.parametrize("sign", [1, -1])
def test_person_who_walks_shows_the_sign(sign):
    rng, n_decisive = np.random.default_rng(3), 0
    for _ in range(20):
        columns, _ = make_columns(FRAME, TIME_S, *walk(rng))
        columns["velocity"] *= sign
        # Ranges of the beat frequencies, which are measured, stay.
        ratio = velocity_sign_log_likelihood_ratio(columns, SOUND_CARD.frame)
        assert sign * ratio > -DECISIVE_LOG_LIKELIHOOD_RATIO
        n_decisive += sign * ratio > DECISIVE_LOG_LIKELIHOOD_RATIO
    assert n_decisive >= 16


def test_wrong_bandwidths_fast_cars_and_echoes_that_stay_decide_nothing():
    rng = np.random.default_rng(5)
    for _ in range(20):
        speed = rng.uniform(5, 15) * rng.choice([-1, 1])
        slow = rng.uniform(0.5, 3) * rng.choice([-1, 1])
        cases = {
            "car": (200 + speed * TIME_S, speed),
            "scale": (100 + 1.12 * slow * TIME_S, slow),
            "tree": (46.0, rng.uniform(-0.75, 0.75, FRAME.size)),
        }
        for name, (range_m, velocity) in cases.items():
            columns, _ = make_columns(
                FRAME,
                TIME_S,
                range_m + 0.2 * rng.normal(size=FRAME.size),
                np.full(FRAME.size, velocity),
            )
            ratio = velocity_sign_log_likelihood_ratio(columns, SOUND_CARD.frame)
            assert ratio > -DECISIVE_LOG_LIKELIHOOD_RATIO, name
            if name != "scale":
                assert ratio < DECISIVE_LOG_LIKELIHOOD_RATIO, name
