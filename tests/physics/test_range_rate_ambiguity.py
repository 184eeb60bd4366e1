"""Ambiguity numbers of velocities from the ranges of targets in successive frames."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.detection_columns import UNITS
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.velocity_ambiguity.by_range_rate import resolve_by_range_rate
from dechirp.radar.velocity_ambiguity import (
    range_shift_per_ambiguity_m,
    unambiguous_velocity_span_m_per_s,
)
from nightly import nightly, nightly_except

SOUND_CARD = dc.Radar(
    frame=dc.Frame(
        chirp=dc.Chirp(
            start_frequency_hz=2.2e9,
            slope_hz_per_s=7e9,
            sample_rate_hz=44.1e3,
            n_samples=882,
            ramp_duration_s=20e-3,
            sampling="real",
        ),
        n_chirps=8,
        interval_s=41e-3,
    ),
    array=dc.Array(rx_m=((0, 0, 0),)),
)
"""A cell of 1.07 m, velocities modulo 1.6 m/s and 3.0 frames in a second."""
FRAME_S = 8 * 41e-3


def make_columns(frame, time_s, range_m, velocity):
    """Return columns of moving detections with aliased velocities, and the ranges of those."""
    span = unambiguous_velocity_span_m_per_s(range_m, SOUND_CARD.frame)
    number = np.round(velocity / span)
    columns = {name: np.full(len(frame), np.nan) for name in UNITS}
    columns |= {
        "frame": frame,
        "time": time_s,
        "range": range_m + number * range_shift_per_ambiguity_m(SOUND_CARD.frame),
        "velocity": velocity - number * span,
        "velocity_std": np.full(len(frame), 0.01),
        "range_std": np.full(len(frame), 0.1),
        "snr": np.full(len(frame), 100.0),
        "moving": np.ones(len(frame)),
    }
    return columns, number


@nightly
def test_stated_probabilities_are_those_of_correct_numbers():
    rng, frame = np.random.default_rng(2), np.arange(10)
    time_s = frame * FRAME_S
    n_certain = n_wrong = 0
    expected_wrong = 0.0
    wrong = n_all = 0
    for _ in range(300):
        speed, acceleration = rng.uniform(-20, 20), rng.uniform(-1, 1)
        velocity = speed + acceleration * time_s
        range_m = 120 + speed * time_s + acceleration * time_s**2 / 2
        columns, number = make_columns(frame, time_s, range_m + 0.5 * rng.normal(size=10), velocity)

        resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)

        # One frame of each trial, since neighbours share their line.
        confidence = resolved["ambiguity_confidence"][5]
        if np.isnan(confidence):
            continue
        is_wrong = abs(resolved["velocity"][5] - velocity[5]) > 0.5
        n_all, wrong = n_all + 1, wrong + is_wrong
        expected_wrong += 1 - confidence
        if not np.isnan(resolved["ambiguity_number"][5]):
            n_certain, n_wrong = n_certain + 1, n_wrong + is_wrong
            if not is_wrong:
                assert resolved["ambiguity_number"][5] == number[5]
                assert resolved["range"][5] == pytest.approx(range_m[5], abs=2.5)
    assert n_all > 240 and n_certain > 200
    assert n_wrong < 12  # the share of 1 % gives 12 of 300 once in 10^4
    assert wrong < expected_wrong + 5 * np.sqrt(expected_wrong) + 3


def test_range_errors_contain_shifts_of_unknown_numbers():
    rng, frame = np.random.default_rng(6), np.repeat(np.arange(3), 200)
    # Persons with numbers from -1 to 1, in too few frames for lines.
    velocity = rng.uniform(-2.4, 2.4, 600)
    true_m = rng.uniform(5, 100, 600)
    columns, number = make_columns(
        frame, frame * FRAME_S, true_m + 0.1 * rng.normal(size=600), velocity
    )

    resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)

    assert set(number) == {-1, 0, 1}
    assert np.isnan(resolved["ambiguity_number"]).all()
    errors = (resolved["range"] - true_m) / resolved["range_std"]
    # Before, 3.4: the standard error of the mean square is sqrt(2 / 600) = 0.06 of it at most.
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.25)
    # Static detections do not alias.
    columns["moving"][:] = 0
    still = resolve_by_range_rate(columns, SOUND_CARD.frame)
    assert np.array_equal(still["range_std"], columns["range_std"])


def test_detections_at_random_ranges_are_no_targets():
    rng = np.random.default_rng(7)
    frame = np.repeat(np.arange(12), 6)
    for _ in range(20):
        columns, _ = make_columns(
            frame, frame * FRAME_S, rng.uniform(0, 200, 72), rng.uniform(-0.7, 0.7, 72)
        )
        resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)
        # Each detection becomes part of a line once in 10^3: 1.4 of 1,440, in groups of five.
        assert np.isfinite(resolved["ambiguity_confidence"]).sum() <= 12
        assert np.array_equal(
            resolved["velocity"][np.isnan(resolved["ambiguity_confidence"])],
            columns["velocity"][np.isnan(resolved["ambiguity_confidence"])],
        )


def test_targets_of_frames_without_map_of_moving_targets_are_resolved():
    frame = np.arange(10)
    time_s, velocity = frame * FRAME_S, np.full(10, -14.3)
    rng = np.random.default_rng(1)
    columns, number = make_columns(
        frame, time_s, 100 - 14.3 * time_s + 0.1 * rng.normal(size=10), velocity
    )
    columns["moving"][:] = np.nan

    resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)

    assert np.array_equal(resolved["ambiguity_number"], number)
    assert np.allclose(resolved["velocity"], -14.3, atol=1e-6)


def test_echoes_that_stay_keep_their_velocity():
    rng = np.random.default_rng(3)
    frame = np.repeat(np.arange(13), 2)
    for _ in range(20):  # a tree in the wind, and another echo anywhere
        range_m = np.stack([46 + rng.uniform(-0.5, 0.5, 13), rng.uniform(0, 200, 13)], axis=1)
        columns, _ = make_columns(
            frame, frame * FRAME_S, range_m.ravel(), rng.uniform(-0.75, 0.75, 26)
        )
        resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)
        assert np.array_equal(resolved["velocity"][::2], columns["velocity"][::2])


def test_slopes_of_no_whole_number_of_spans_resolve_nothing():
    frame = np.arange(10)
    time_s, velocity = frame * FRAME_S, np.full(10, -14.3)
    rng = np.random.default_rng(1)
    columns, _ = make_columns(
        # A bandwidth that is wrong by 5 % puts the slope at 0.45 spans beside the velocity.
        frame,
        time_s,
        1.05 * (100 - 14.3 * time_s) + 0.02 * rng.normal(size=10),
        velocity,
    )

    resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)

    assert np.isnan(resolved["ambiguity_confidence"]).all()
    assert np.array_equal(resolved["velocity"], columns["velocity"])


@pytest.mark.parametrize("acceleration", nightly_except(1, [1.5, 2.0, 2.5, 3.0]))
def test_targets_that_turn_get_no_wrong_number(acceleration):
    frame = np.arange(24)
    time_s = frame * FRAME_S
    rng = np.random.default_rng(8)
    for _ in range(20):
        turn_s = rng.uniform(3, 5)
        velocity = np.clip(-acceleration * (time_s - turn_s), -2.5, 2.5)
        fine_s = np.linspace(0, time_s[-1], 2000)
        steps_m = np.clip(-acceleration * (fine_s - turn_s), -2.5, 2.5) * fine_s[1]
        range_m = 30 + np.interp(time_s, fine_s, np.cumsum(steps_m))
        columns, _ = make_columns(frame, time_s, range_m + 0.3 * rng.normal(size=24), velocity)

        resolved = resolve_by_range_rate(columns, SOUND_CARD.frame)

        is_known = np.isfinite(resolved["ambiguity_number"])
        assert np.allclose(resolved["velocity"][is_known], velocity[is_known], atol=0.3)


@pytest.mark.filterwarnings("ignore::dechirp.core.findings.PhysicsWarning")  # aliased
def test_run_shows_velocity_of_fast_car_by_its_ranges(radar, tmp_path):
    radar = replace(SOUND_CARD, hardware=radar.hardware)
    scene = dc.Scene(
        targets=[
            dc.Target(
                name="car", position_m=(100, 0, 0), velocity_m_per_s=(-14.3, 0, 0), rcs_m2=10
            ),
            dc.Target(position_m=(30, 0, 0), rcs_m2=10),
        ]
    )
    cube = dc.simulate(
        scene,
        radar,
        impairments=(dc.impairments.WhiteNoise(snr=1.0, target="car"),),
        n_frames=12,
        seed=3,
    )
    path = tmp_path / "car.h5"
    dc.write(dc.recording_from_cube(cube, radar), path)

    result = dc.run(dc.Scenario(recording=RecordingSource(path=str(path))))

    moving = result.detections.isel(detection=np.flatnonzero(result.detections.moving.values == 1))
    assert moving.sizes["detection"] >= 6
    # The car crosses four cells in a frame, over which its echo has several maxima; one detection
    # in eleven is at a maximum beside the highest.
    assert (abs(moving.velocity + 14.3) < 3 * moving.velocity_std).all()
    assert (moving.velocity_std < 0.15).all()
    error_m = moving.range - (100 - 14.3 * moving.time)
    assert (abs(error_m) < 3 * moving.range_std).all()
    assert (moving.range_std < 2).all()
    assert np.allclose(moving.ambiguity_number, -9)
    (note,) = (str(finding) for finding in result.findings if "successive frames" in str(finding))
    assert "-14.2 m/s" in note.replace("\N{MINUS SIGN}", "-")

    unresolved = dc.run(dc.Scenario(recording=RecordingSource(path=str(path), fit_chain=False)))
    assert np.isnan(unresolved.detections.ambiguity_number).all()
