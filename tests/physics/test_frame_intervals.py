"""Frames with different chirp intervals: simulation and velocity ambiguity resolution."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

import dechirp as dc
from dechirp.processing.direction_finding import element_snapshots_and_noise
from dechirp.processing.velocity_ambiguity import by_frame_intervals
from dechirp.processing.velocity_ambiguity.by_frame_intervals import FrameEstimates
from dechirp.processing.velocity_ambiguity.hypotheses import (
    AmbiguityHypotheses,
    unresolved_hypotheses,
)
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg
from dechirp.scene.aliasing import RangeVelocity, alias_range_velocity
from dechirp.scene.scene_warnings import scene_findings
from nightly import nightly_except

INTERVALS_S = (31e-6, 35e-6, 38e-6)


def replace_intervals(radar, *intervals_s, n_chirps=32, period_s=10e-3):
    frame = replace(radar.frame, n_chirps=n_chirps, interval_s=intervals_s, period_s=period_s)
    return replace(radar, frame=frame, array=dc.Array())


def make_target_ahead(range_m, velocity, rcs_m2=1.0):
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)


def draw_frame_estimates(radar, range_m, velocity, snr, n_frames, rng, detection_probability=1.0):
    """Draw single-frame estimates of targets (n,) at constant velocity, with errors at the bound.

    Return the estimates of each frame and the true ambiguity numbers.
    """
    frames, ambiguity_numbers = [], []
    for number in range(n_frames):
        frame_radar = radar.for_frame(number)
        time_s = radar.frame.frame_start_s(number) + frame_radar.frame.mid_frame_s
        truth = RangeVelocity(range_m + velocity * time_s, velocity)
        apparent = alias_range_velocity(truth, frame_radar)
        is_detected = rng.random(len(range_m)) < detection_probability
        std = [
            np.full(is_detected.sum(), float(bound))
            for bound in range_and_velocity_crlb_std(frame_radar.frame, snr=snr)
        ]
        frames.append(
            FrameEstimates(
                number,
                time_s,
                apparent.range_m[is_detected] + std[0] * rng.standard_normal(is_detected.sum()),
                apparent.velocity_m_per_s[is_detected]
                + std[1] * rng.standard_normal(is_detected.sum()),
                *std,
                unresolved_hypotheses(is_detected.sum()),
            )
        )
        span = 2 * frame_radar.frame.max_velocity_m_per_s
        span_difference = (velocity[is_detected] - frames[-1].velocity_m_per_s) / span
        ambiguity_numbers.append(np.round(span_difference))
    return frames, ambiguity_numbers


def test_each_frame_equals_radar_with_its_own_interval(radar):
    radar = replace_intervals(radar, *INTERVALS_S, period_s=None)
    scene = dc.Scene(targets=[make_target_ahead(20, 5)])
    options = {"impairments": (), "dtype": np.complex128}
    cube = dc.simulate(scene, radar, n_frames=4, **options)

    starts_s = 32 * np.array([0, 31e-6, 66e-6, 104e-6])
    assert cube.frame.values == pytest.approx(starts_s, abs=1e-15)
    assert dc.truth(scene, radar, n_frames=4).time.values == pytest.approx(
        starts_s + 31 / 2 * np.array([31e-6, 35e-6, 38e-6, 31e-6]) + 14.75e-6
    )
    for number in range(4):
        moved_scene = dc.Scene(targets=[make_target_ahead(20 + 5 * starts_s[number], 5)])
        expected = dc.simulate(moved_scene, radar.for_frame(number), **options)
        frame_cube = cube.isel(frame=number)
        # Positions at 20 m are rounded in double precision, 1e-11 rad of phase.
        np.testing.assert_allclose(
            frame_cube, expected.isel(frame=0), rtol=0, atol=1e-9 * abs(expected.values).max()
        )
        np.testing.assert_allclose(frame_cube.chirp_time, expected.chirp)
    assert cube.chirp.values.tolist() == list(range(32))


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")  # aliased within each frame
@pytest.mark.parametrize("velocity", [-150.0, -40.0, 5.0, 33.0, 90.0])
def test_frame_intervals_resolve_velocity_beyond_span_of_each_frame(radar, velocity):
    radar = replace_intervals(radar, *INTERVALS_S)
    scene = dc.Scene(targets=[make_target_ahead(30, velocity)])
    cube = dc.simulate(scene, radar, n_frames=3, seed=1)
    detections, truth = dc.detect(cube, radar), dc.truth(scene, radar, n_frames=3).isel(target=0)

    assert detections.frame.values.tolist() == [0, 1, 2]
    assert np.all(detections.ambiguity_confidence >= 0.99)
    expected = [
        round(velocity / (2 * radar.for_frame(k).frame.max_velocity_m_per_s)) for k in range(3)
    ]
    assert detections.ambiguity_number.values.tolist() == expected
    # Six standard errors; fast targets walk by half a range cell within a frame.
    assert np.all(abs(detections.velocity - truth.velocity.values) < 6 * detections.velocity_std)
    assert np.all(abs(detections.range - truth.range.values) < 6 * detections.range_std)


def count_decisions(radar, draw_targets, snr, n_frames, n_trials, rng):
    """Count estimates, certain ones and wrong ones for targets from `draw_targets`."""
    n_estimates = n_certain = n_wrong = 0
    for _ in range(n_trials):
        frames, truth = draw_frame_estimates(
            radar, *draw_targets(), snr, n_frames, rng, detection_probability=0.9
        )
        for hypotheses, true_number in zip(
            by_frame_intervals.ambiguity_probabilities(frames, radar.frame), truth, strict=True
        ):
            is_certain = hypotheses.confidence >= 0.99
            assert np.array_equal(
                is_certain, np.isfinite(hypotheses.certain_ambiguity_numbers_or_nan)
            )
            n_estimates, n_certain = n_estimates + len(true_number), n_certain + is_certain.sum()
            n_wrong += (
                hypotheses.certain_ambiguity_numbers_or_nan[is_certain] != true_number[is_certain]
            ).sum()
    return n_estimates, n_certain, n_wrong


def test_ambiguity_numbers_and_confidence_are_correct_at_20_db(radar):
    radar, rng = replace_intervals(radar, *INTERVALS_S), np.random.default_rng(2)
    n_estimates, n_certain, n_wrong = count_decisions(
        radar, lambda: (rng.uniform(5, 70, 12), rng.uniform(-80, 80, 12)), 100.0, 6, 60, rng
    )
    # The requirements are 1 % of all and 2 % of the certain numbers; uncertain ones are marked.
    assert binom.sf(n_wrong - 1, n_estimates, 0.01) > 1e-6
    assert binom.sf(n_wrong - 1, n_certain, 0.02) > 1e-6
    assert n_certain > 0.95 * n_estimates


def test_confidence_is_correct_for_crowded_and_weak_targets(radar):
    radar, rng = replace_intervals(radar, 31e-6, 35e-6), np.random.default_rng(3)
    # Targets are within 4 m, so that remainders of others coincide with wrong ambiguities.
    n_estimates, n_certain, n_wrong = count_decisions(
        radar, lambda: (rng.uniform(20, 24, 30), rng.uniform(-80, 80, 30)), 30.0, 2, 40, rng
    )
    assert 0.1 < n_certain / n_estimates < 0.95  # a difficult case
    assert binom.sf(n_wrong - 1, n_certain, 0.02) > 1e-6


def test_single_frame_leaves_ambiguity_unresolved(radar):
    rng = np.random.default_rng(4)
    radar = replace_intervals(radar, *INTERVALS_S)
    frames, _ = draw_frame_estimates(radar, np.array([20.0]), np.array([40.0]), 1000.0, 1, rng)
    (hypotheses,) = by_frame_intervals.ambiguity_probabilities(frames, radar.frame)
    assert np.isnan(hypotheses.certain_ambiguity_numbers_or_nan).all()
    assert hypotheses.confidence.item() < 0.2  # 31, 35 or 38 ambiguities


@pytest.mark.parametrize(
    ("interval_s", "setting", "expected"),
    [
        ((35e-6,), "Frame.interval_s", "two or more"),
        ((), "Frame.interval_s", "two or more"),
        ((35e-6, 29e-6), "Frame.interval_s.1", "duration of the ramp"),
        ((35e-6, "40 us"), "Frame.interval_s.1", "finite number"),
    ],
)
def test_rejects_invalid_intervals(radar, interval_s, setting, expected):
    with pytest.raises(dc.InvalidSetting, match=expected) as error:
        replace(radar.frame, interval_s=interval_s)
    assert error.value.mistakes[0].setting == setting


def test_single_frame_functions_need_radar_of_that_frame(radar):
    radar = replace_intervals(radar, 31e-6, 35e-6)
    cube = dc.simulate(dc.Scene(), radar, n_frames=2)
    with pytest.raises(dc.InvalidSetting, match=r"radar\.for_frame"):
        dc.power_map(cube.isel(frame=0), radar, dc.Chain(angle=None))
    assert dc.power_map(cube.isel(frame=1), radar.for_frame(1), dc.Chain(angle=None)).shape == (
        32,
        256,
    )
    with pytest.raises(dc.InvalidSetting, match="one profile"):
        format_ti_cfg(radar, device="xwr1843")


@pytest.mark.parametrize(
    ("intervals_s", "n_frames", "message"),
    [((31e-6, 31e-6), 4, "all 31 us"), ((31e-6, 35e-6), 1, "2 intervals for 1 frames")],
)
def test_warns_of_intervals_without_benefit(radar, intervals_s, n_frames, message):
    with pytest.warns(dc.PhysicsWarning, match=message):
        dc.simulate(dc.Scene(), replace_intervals(radar, *intervals_s), n_frames=n_frames)


def test_rejects_period_shorter_than_any_interval_needs(radar):
    with pytest.raises(dc.InvalidSetting, match="duration of the chirps"):
        replace(radar.frame, interval_s=(31e-6, 80e-6), period_s=128 * 40e-6)


WAVEFORMS = {
    "tdm": {"multiplexing": dc.multiplexing.Tdm(order=(0, 1, 2))},
    "single": {},
    "fsk": {"modulation": dc.modulations.FrequencyShiftKeying(step_hz=3e6)},
    "staggered": {"modulation": dc.modulations.Staggered(pauses_s=(0, 5e-6))},
    "triangular": {"modulation": dc.modulations.Triangular()},
}


def make_row_radar(radar, *, multiplexing=None, modulation=None):
    half_m = radar.frame.chirp.wavelength_m / 2
    tx_m = [(0, 4 * half_m * k, 0) for k in range(1 if multiplexing is None else 3)]
    frame = replace(
        replace_intervals(radar, *INTERVALS_S, period_s=20e-3).frame,
        multiplexing=multiplexing,
        modulation=modulation,
    )
    array = dc.Array(tx_m=tx_m, rx_m=[(0, half_m * k, 0) for k in range(4)])
    return replace(radar, frame=frame, array=array)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")  # aliased within each frame
@pytest.mark.parametrize("waveform", nightly_except(2, WAVEFORMS))
@pytest.mark.parametrize("velocity", [-60.0, 33.0, 75.0])
def test_azimuth_uses_ambiguity_number_of_frame_comparison(radar, waveform, velocity):
    """Exceed the nearest three ambiguities of one frame: up to four with three transmitters."""
    radar = make_row_radar(radar, **WAVEFORMS[waveform])
    azimuth = np.radians(-20)
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    target = dc.Target(
        position_m=tuple(20 * direction), velocity_m_per_s=tuple(velocity * direction), rcs_m2=10
    )
    scene = dc.Scene(targets=[target])
    cube = dc.simulate(scene, radar, n_frames=3, seed=2)
    detections, truth = dc.detect(cube, radar), dc.truth(scene, radar, n_frames=3).isel(target=0)

    assert detections.frame.values.tolist() == [0, 1, 2]
    assert np.all(detections.ambiguity_confidence >= 0.99)
    # Six standard errors; wave curvature and range walk within a frame add 0.05 degrees.
    assert np.all(abs(detections.azimuth - azimuth) < 6 * detections.azimuth_std + np.radians(0.05))
    assert np.all(abs(detections.velocity - truth.velocity.values) < 6 * detections.velocity_std)
    assert np.all(abs(detections.range - truth.range.values) < 6 * detections.range_std + 2e-4)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("waveform", WAVEFORMS)
def test_single_frame_equals_radar_with_its_own_interval(radar, waveform):
    """Use 12 m/s, left of boresight: TDM transmitters resolve one ambiguity, two ramps another."""
    radar = make_row_radar(radar, **WAVEFORMS[waveform])
    azimuth = np.radians(20)
    direction = np.array([np.cos(azimuth), np.sin(azimuth), 0])
    target = dc.Target(
        position_m=tuple(20 * direction), velocity_m_per_s=tuple(12 * direction), rcs_m2=10
    )
    cube = dc.simulate(dc.Scene(targets=[target]), radar, n_frames=1, seed=1)
    detections = dc.detect(cube, radar)
    assert detections.identical(dc.detect(cube, radar.for_frame(0)))
    assert abs(
        detections.azimuth.item() - azimuth
    ) < 6 * detections.azimuth_std.item() + np.radians(0.05)
    assert abs(detections.velocity.item() - 12) < 6 * detections.velocity_std.item()


@pytest.mark.parametrize(
    ("waveform", "n_frames", "velocity", "level", "message"),
    [
        ("single", 1, 40.0, "warning", "expect the aliased velocity"),
        ("single", 2, 40.0, "note", "frames with other intervals resolve velocities up to"),
        ("tdm", 1, 12.0, "note", "phase differences between transmitters resolve velocities up to"),
        ("tdm", 1, 40.0, "warning", "expect the aliased velocity"),
        ("staggered", 1, 20.0, None, ""),
        ("triangular", 1, 20.0, None, ""),
    ],
)
def test_finding_explains_treatment_of_aliased_velocity(
    radar, waveform, n_frames, velocity, level, message
):
    """Compare TDM and one transmitter at 31 us: 31.4 m/s with resolution, 31.4 m/s without."""
    radar = make_row_radar(radar, **WAVEFORMS[waveform])
    findings = scene_findings(
        dc.Scene(targets=[make_target_ahead(20, velocity)]), radar, n_frames=n_frames
    )
    velocity_findings = [finding for finding in findings if finding.setting.endswith("velocity")]

    assert [finding.level for finding in velocity_findings] == ([] if level is None else [level])
    assert all(message in finding.fix for finding in velocity_findings)


def test_frame_comparison_uses_single_frame_probabilities(radar):
    """Spread a probability of 0.9 for one of three ambiguities over all equivalent ones."""
    rng = np.random.default_rng(5)
    radar = make_row_radar(radar, multiplexing=dc.multiplexing.Tdm(order=(0, 1, 2)))
    (estimates,), _ = draw_frame_estimates(radar, np.array([20.0]), np.array([2.0]), 300.0, 1, rng)
    informed_estimates = estimates._replace(
        hypotheses=AmbiguityHypotheses(np.array([[0.05, 0.9, 0.05]]), np.array([[-1.0, 0.0, 1.0]]))
    )
    (hypotheses,) = by_frame_intervals.ambiguity_probabilities([informed_estimates], radar.frame)

    is_equivalent = hypotheses.number[0] % 3 == 0
    # 11 of 31 ambiguities are equivalent and 20 are not: 0.908.
    assert hypotheses.probability[0, is_equivalent].sum() == pytest.approx(0.9, abs=0.01)
    assert np.isnan(hypotheses.certain_ambiguity_numbers_or_nan).all()


def test_ambiguity_does_not_rotate_receivers_of_one_transmitter(radar):
    """Use slots half a cycle apart, which cancel if a wrong ambiguity is corrected."""
    radar = make_row_radar(
        radar, modulation=dc.modulations.Staggered(pauses_s=(0, 5e-6))
    ).for_frame(0)
    rng = np.random.default_rng(6)
    rx_phasors = np.exp(1j * np.array([0.0, 1.1, 2.2, 3.3]))
    slots = np.exp(1j * rng.uniform(-np.pi, np.pi, (50, 2, 1)))
    noise = rng.standard_normal((2, 50, 8)) * 1e-3
    amplitudes = (slots * rx_phasors).reshape(50, 8) + noise[0] + 1j * noise[1]
    doppler_hz = rng.uniform(-1e5, 1e5, 50)
    snapshots, noise_power = element_snapshots_and_noise(
        amplitudes, doppler_hz, np.full(50, 2e-6), radar
    )

    elements = snapshots[:, 0] / snapshots[:, :1, 0] * rx_phasors[0]
    # The mean of two slots has an error of sqrt(2) x 1e-3, and the first element adds as much: five
    # and a half times both.
    assert np.all(abs(elements - rx_phasors) < 0.011)
    assert noise_power == pytest.approx(1e-6)
