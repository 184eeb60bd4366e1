"""Echoes at multiples of the range of a strong echo, and targets that are there by chance."""

from dataclasses import replace

import numpy as np
import pytest
from test_angle_motion_compensation import make_mimo_radar

import dechirp as dc
from dechirp.core.detection_columns import UNITS
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.multiple_echoes import find_multiple_echoes
from nightly import nightly

CFAR = dc.Cfar(estimator=dc.cfar.CellAveraging(), false_alarm_probability=1e-6)


@pytest.fixture
def single_round(radar):
    """Twelve elements and one round, 1,024 samples: range and direction without velocity."""
    radar = make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))
    chirp = replace(radar.frame.chirp, n_samples=256)
    return replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=1))


def make_columns(range_m, snr_db, azimuth_deg, *, velocity=np.nan):
    """Return columns of the detections of one frame, with errors of a degree."""
    n = len(range_m)
    columns = {name: np.full(n, np.nan) for name in UNITS}
    return columns | {
        "frame": np.zeros(n),
        "range": np.asarray(range_m, float),
        "snr": 10 ** (np.asarray(snr_db) / 10),
        "azimuth": np.radians(np.broadcast_to(azimuth_deg, n)),
        "azimuth_std": np.full(n, np.radians(1.0)),
        "velocity": np.broadcast_to(velocity, n) + np.zeros(n),
    }


@pytest.mark.parametrize(
    ("others_m", "azimuth_deg", "multiples_m"),
    [
        ([20, 30, 40, 33], [20, 20, 20, 20], [20, 30, 40]),  # a series of reflections
        ([20, 33], [20, 20], [20]),  # a single one, in its direction
        ([20, 33], [43.2, 20], [20]),  # a second harmonic: sin 43.2 = 2 sin 20
        ([20, 33], [-5, 20], []),  # a target at 2 R elsewhere
        ([23, 33, 37], [20, 20, 20], []),
    ],
)
def test_multiples_of_strong_echoes_are_found(single_round, others_m, azimuth_deg, multiples_m):
    columns = make_columns([10, *others_m], [60, *[25] * len(others_m)], [20, *azimuth_deg])

    multiples = find_multiple_echoes(columns, single_round)

    assert [echo.range_m for echo in multiples] == multiples_m


def test_real_samples_in_complex_numbers_give_the_multiples_of_real_ones(single_round):
    # Half of the axis of complex numbers holds mirror images, beyond the largest range.
    chirp = replace(single_round.frame.chirp, sampling="complex")
    real_chirp = replace(chirp, sampling="real")
    radar, real_radar = (
        replace(single_round, frame=replace(single_round.frame, chirp=one))
        for one in (chirp, real_chirp)
    )
    assert real_chirp.max_range_m == pytest.approx(chirp.max_range_m / 2)
    counts = {"complex": [], "limited": [], "real": []}
    for std_deg in np.linspace(0.5, 20, 40):  # from a sure multiple to one by chance
        columns = make_columns([5, 10], [60, 25], [20, 20])
        columns["azimuth_std"][:] = np.radians(std_deg)
        limit_m = real_chirp.max_range_m
        counts["complex"].append(len(find_multiple_echoes(columns, radar)))
        counts["limited"].append(len(find_multiple_echoes(columns, radar, limit_m)))
        counts["real"].append(len(find_multiple_echoes(columns, real_radar)))
    assert counts["limited"] == counts["real"]
    assert sum(counts["complex"]) > sum(counts["real"]) > 0


@nightly
def test_targets_at_random_places_are_rarely_named(single_round):
    rng, n_trials = np.random.default_rng(6), 600
    n_affected = 0
    for _ in range(n_trials):
        n = rng.integers(2, 30)
        max_range_m = single_round.frame.chirp.max_range_m
        columns = make_columns(
            rng.uniform(3, max_range_m, n), rng.uniform(15, 60, n), rng.uniform(-50, 50, n)
        )
        n_affected += bool(find_multiple_echoes(columns, single_round))
    # At most 2 % of the frames: 12, and 30 of 600 once in 10^5.
    assert n_affected <= 30


def test_moving_multiples_have_multiples_of_the_velocity(radar):
    ranges_m, snr_db = [10, 20, 20.1], [60, 35, 35]
    columns = make_columns(ranges_m, snr_db, np.nan, velocity=np.array([6.0, 12.0, 6.0]))

    (echo,) = find_multiple_echoes(columns, radar)

    assert (echo.order, echo.range_m) == (2, 20)


def test_run_keeps_a_row_of_posts_and_names_them_as_possible_multiples(single_round, tmp_path):
    direction = np.array([np.cos(0.3), np.sin(0.3), 0])
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=10 * direction, rcs_m2=1000),
            dc.Target(position_m=20 * direction, rcs_m2=300),
            dc.Target(position_m=30 * direction, rcs_m2=300),
            dc.Target(position_m=(25, -8, 0), rcs_m2=300),
        ]
    )
    path = tmp_path / "posts.h5"
    cube = dc.simulate(scene, single_round, impairments=(dc.impairments.ThermalNoise(),), seed=2)
    dc.write(dc.recording_from_cube(cube, single_round), path)

    result = dc.run(
        dc.Scenario(recording=RecordingSource(path=str(path)), chain=dc.Chain(cfar=CFAR))
    )

    assert np.allclose(np.sort(result.detections.range), [10, 20, 26.2, 30], atol=0.1)
    (note,) = (
        str(finding) for finding in result.findings if "multiples of the range" in str(finding)
    )
    assert "(2 x 10" in note and "(3 x 10" in note
    assert "no targets of their own: 2 detections" in note
