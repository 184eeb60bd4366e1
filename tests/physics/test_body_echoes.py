"""Velocity of a vehicle from the echoes of its body and its wheels."""

import numpy as np
import pytest

from dechirp.evaluation.body_echoes import find_body_echo

EGO_M_PER_S, SPEED_M_PER_S = 5.0, 14.0
RELATIVE_M_PER_S = SPEED_M_PER_S - EGO_M_PER_S


def detections(velocity, snr, *, azimuth=0.0, ambiguity_number=0.0):
    n = len(velocity)
    return {
        "velocity": np.array(velocity, float),
        "snr": np.array(snr, float),
        "azimuth": np.broadcast_to(azimuth, n),
        "ambiguity_number": np.broadcast_to(ambiguity_number, n),
    }


def rims(n, rng):
    """Velocities of rim points in a frame: v (1 + cos) over ground, at random angles."""
    return SPEED_M_PER_S * (1 + np.cos(rng.uniform(0, 2 * np.pi, n))) - EGO_M_PER_S


@pytest.mark.parametrize("seed", range(5))
def test_body_outshines_its_wheels(seed):
    rng = np.random.default_rng(seed)
    velocity = [*rims(10, rng), RELATIVE_M_PER_S]

    echo = find_body_echo(detections(velocity, [*rng.uniform(500, 2000, 10), 4e4]))

    assert echo == (10, RELATIVE_M_PER_S)


@pytest.mark.parametrize("seed", range(5))
def test_wheels_alone_give_the_middle_of_their_ends(seed):
    # Angles are uniform, so each end is reached but for 1 - cos(a), with a up to 2 pi / n times a
    # few: with 40 points both ends within 1 % of the speed, and the middle too.
    rng = np.random.default_rng(seed)
    velocity = rims(40, rng)
    ends = np.isclose(velocity, velocity.min()) | np.isclose(velocity, velocity.max())

    echo = find_body_echo(detections(velocity, np.where(ends, 2000, rng.uniform(500, 1500, 40))))

    assert echo.velocity_m_per_s == pytest.approx(RELATIVE_M_PER_S, abs=0.05 * SPEED_M_PER_S)
    assert echo.row in np.flatnonzero(ends)


@pytest.mark.parametrize(("top", "velocity"), [(5e3, RELATIVE_M_PER_S), (2e4, 23.0)])
def test_ends_of_wheels_differ_in_power(top, velocity):
    # Both ends are sums of few scatterers, whose powers are exponential: their ratio is below 9 in
    # 1 - 2 / (1 + 9) = 80 % of the cases. Bodies are stronger than one wheel by 10 dB and more.
    echo = find_body_echo(detections([-EGO_M_PER_S, 7.0, 23.0], [1e3, 200, top]))

    assert echo == (2, velocity)


def test_wheels_without_ambiguity_number_give_no_velocity():
    # As in traffic: two tops of wheels at one end, one of them of an unknown ambiguity number.
    columns = detections([19.5, 21.7], [190, 130], ambiguity_number=[np.nan, 0])

    echo = find_body_echo(columns)

    assert echo.row == 1 and np.isnan(echo.velocity_m_per_s)


def test_echoes_of_two_vehicles_in_one_cell_count_as_weaker():
    # As in traffic: a car with wheels from -0.8 to 24 m/s, and one that is merged with another.
    columns = detections(
        [0.0, 12.2, 24.2, -0.8], [13e3, 7e3, 280, 170], ambiguity_number=[np.nan, 0, 0, 0]
    )

    assert find_body_echo(columns) == (1, 12.2)


def test_body_of_one_velocity_needs_no_wheels():
    assert find_body_echo(detections([3.0, 3.4], [100, 90])) == (0, 3.0)
    assert find_body_echo(detections([3.0], [100])) == (0, 3.0)


@pytest.mark.parametrize("velocity", [[20.2], [-3.0, 8.5]], ids=["one side", "without its end"])
def test_wheels_alone_that_miss_an_end_give_no_velocity(velocity):
    # Powers of bodies are exponential (Swerling 1): 1 - exp(-0.003), 0.3 %, are below 0.003 of the
    # mean.
    snr = [1.0, 0.5][: len(velocity)]
    of_wheels = find_body_echo(detections(velocity, snr), mean_snr=1 / 0.0029)
    of_body = find_body_echo(detections(velocity, snr), mean_snr=1 / 0.0031)

    assert of_wheels.row == of_body.row == 0
    assert np.isnan(of_wheels.velocity_m_per_s) and np.isfinite(of_body.velocity_m_per_s)


def test_detections_without_direction_give_no_position():
    assert find_body_echo(detections([3.0], [100], azimuth=np.nan)) is None
