"""Triangular modulation: rising and falling ramps, and pairing of their peaks."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

import dechirp as dc
from dechirp.processing.refine import RefinedPeaks, Tones
from dechirp.processing.velocity_ambiguity.triangular_pairing import pair_rising_and_falling_peaks
from dechirp.radar.estimation_bounds import range_and_velocity_crlb_std
from dechirp.scene.scene_warnings import scene_findings
from dechirp.theory.direction_bounds import unit_vectors


def set_triangular(radar, *, n_chirps=64, sampling="complex"):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    frame = replace(
        radar.frame, chirp=chirp, n_chirps=n_chirps, modulation=dc.modulations.Triangular()
    )
    return replace(radar, frame=frame)


def build_slow_triangle(radar, **chirp):
    """Build a radar with one triangle of 2 ms: 0.83 m and 1 m/s per beat bin."""
    slow_chirp = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=200e9, adc_start_s=20e-6, ramp_duration_s=1e-3,
        sample_rate_hz=1e6, n_samples=900, **{"sampling": "complex", **chirp},
    )  # fmt: skip
    frame = dc.Frame(
        chirp=slow_chirp, n_chirps=1, interval_s=1e-3, modulation=dc.modulations.Triangular()
    )
    return replace(radar, frame=frame)


def build_target_ahead(range_m, velocity, rcs_m2=1.0):
    return dc.Target(position_m=(range_m, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("velocity", [-45.0, -8.0, 6.0, 33.0])
def test_beat_difference_resolves_velocity_ambiguity(radar, velocity, sampling):
    radar = set_triangular(radar, sampling=sampling)
    assert radar.frame.max_velocity_m_per_s < 14
    scene = dc.Scene(targets=[build_target_ahead(20, velocity)])
    detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert detections.sizes["detection"] == 1
    # Five standard errors, plus the longer path to the second receiver.
    assert abs(detections.range - truth.range).item() < 5 * detections.range_std.item() + 1e-4
    assert abs(detections.velocity - truth.velocity).item() < 5 * detections.velocity_std.item()
    assert detections.ambiguity_number.item() == round(
        velocity / (2 * radar.frame.max_velocity_m_per_s)
    )
    assert detections.ambiguity_confidence.item() > 0.99


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_one_triangle_measures_ranges_and_velocities(radar, sampling):
    radar = build_slow_triangle(radar, sampling=sampling)
    # Beats of both ramps are at least 20 bins apart: outside each other's training cells.
    targets = [
        build_target_ahead(20, 10),
        build_target_ahead(45, -14, 10.0),
        build_target_ahead(70, 0, 30.0),
        build_target_ahead(105, 33, 1000.0),
    ]
    scene = dc.Scene(targets=targets)
    detections = dc.detect(dc.simulate(scene, radar, seed=2), radar)
    truth = dc.truth(scene, radar).isel(frame=0)

    order = np.argsort(detections.range.values)
    assert detections.sizes["detection"] == 4  # no ghost
    for name in ("range", "velocity"):
        error = abs(detections[name].values[order] - truth[name].values)
        assert np.all(error < 5 * detections[f"{name}_std"].values[order] + 2e-3)
    assert np.all(detections.ambiguity_confidence > 0.99)


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("rcs_m2", [1e-4, 10.0])
def test_ramps_of_wide_sweep_are_paired_despite_range_walk(radar, rcs_m2, sampling):
    """Range walk of 1.1 cells of 5 cm per frame at 3 GHz; both kinds of ramps are 10 MHz apart, so
    Doppler differs by 1.3e-4, 100 standard errors of the stronger target."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=1e14, adc_start_s=1e-6, ramp_duration_s=32e-6,
        sample_rate_hz=10e6, n_samples=300, sampling=sampling,
    )  # fmt: skip
    frame = dc.Frame(
        chirp=chirp, n_chirps=64, interval_s=34e-6, modulation=dc.modulations.Triangular()
    )
    radar = replace(radar, frame=frame)
    scene = dc.Scene(targets=[build_target_ahead(3, 13, rcs_m2)])
    detections = dc.detect(
        dc.simulate(scene, radar, seed=1), radar, dc.Chain(range_walk="keystone")
    )
    truth = dc.truth(scene, radar).isel(target=0, frame=0)

    assert detections.sizes["detection"] == 1
    # Five standard errors, plus 10 um for the second receiver in the near field.
    assert abs(detections.range - truth.range).item() < 5 * detections.range_std.item() + 1e-5
    assert (
        abs(detections.velocity - truth.velocity).item() < 5 * detections.velocity_std.item() + 1e-4
    )
    assert detections.ambiguity_number.item() == 0 and detections.ambiguity_confidence.item() > 0.99


@pytest.mark.parametrize(("rcs_m2", "max_found_speed"), [(3e-4, 14), (10.0, 42)])
def test_warns_of_aliased_walking_targets_that_are_lost(radar, rcs_m2, max_found_speed):
    """One ambiguity at 3 GHz and 14 m/s walks 2.5 cells more, uncompensated in both maps.

    Strong echoes are found nevertheless, and show their walk.
    """
    chirp = dc.Chirp(
        start_frequency_hz=77e9, slope_hz_per_s=1e14, adc_start_s=1e-6, ramp_duration_s=32e-6,
        sample_rate_hz=10e6, n_samples=300, sampling="complex",
    )  # fmt: skip
    frame = dc.Frame(
        chirp=chirp, n_chirps=64, interval_s=34e-6, modulation=dc.modulations.Triangular()
    )
    radar = replace(radar, frame=frame)
    is_detected = []
    velocities = np.array([-12.0, 3.0, 10.0, 13.0, 17.0, 20.0, -24.0, 35.0, -45.0, 52.0, 60.0])
    has_finding = abs(velocities) > 14
    for velocity, is_expected in zip(velocities, has_finding, strict=True):
        scene = dc.Scene(targets=[build_target_ahead(6, velocity, rcs_m2)])
        findings = [
            finding for finding in scene_findings(scene, radar) if "range cells" in finding.value
        ]
        assert [finding.level for finding in findings] == ["warning"] * int(is_expected)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", dc.PhysicsWarning)
            detections = dc.detect(dc.simulate(scene, radar, seed=1), radar)
        is_detected.append(np.any(abs(detections.velocity.values - velocity) < 0.1))
    is_slow = abs(velocities) < max_found_speed
    assert np.all(np.array(is_detected)[is_slow])
    assert np.mean(np.array(is_detected)[~is_slow]) < 0.5


@pytest.mark.parametrize("range_m", [7.0, 70.0])
@pytest.mark.parametrize("pause_s", [0.0, 10e-6])
@pytest.mark.parametrize("n_rows", [1, 3])
def test_directions_of_triangles_take_mean_frequency_of_both_echoes(
    radar, n_rows, pause_s, range_m
):
    """Echoes of falling ramps are as far above the transmitted frequency as the others are below.

    Samples that leave out the last 10 us of the ramp are 300 MHz higher in the falling ramps.
    """
    chirp = radar.frame.chirp
    chirp = replace(chirp, ramp_duration_s=chirp.ramp_duration_s + pause_s)
    frame = dc.Frame(
        chirp=chirp,
        n_chirps=64,
        interval_s=chirp.ramp_duration_s + 3e-6,
        modulation=dc.modulations.Triangular(),
    )
    rx_m = [(0, y * 1.95e-3, z * 1.95e-3) for z in range(n_rows) for y in range(4)]
    radar = replace(radar, frame=frame, array=dc.Array(rx_m=rx_m))
    angles = np.radians([-50.0, 25.0 if n_rows > 1 else 0.0])
    (unit,) = unit_vectors(angles[[0]], angles[[1]])
    scene = dc.Scene(targets=[dc.Target(position_m=tuple(range_m * unit))])
    noise = dc.impairments.WhiteNoise(snr=1e5)
    detections = dc.detect(dc.simulate(scene, radar, impairments=[noise], seed=1), radar)
    truth = dc.truth(scene, radar)

    # Bounds are below 4e-6 rad at 103 dB after integration. The frequency of rising ramps makes
    # errors of 1e-4 tan(angle) at 70 m, and of 2e-3 tan(angle) with the pause.
    for name in ("azimuth", "elevation")[: 1 + (n_rows > 1)]:
        assert detections[name].item() == pytest.approx(truth[name].item(), abs=2e-5), name


def test_errors_of_one_triangle_reach_bound(radar):
    radar, trials = build_slow_triangle(radar), 150
    rng = np.random.default_rng(3)
    scene = dc.Scene(targets=[build_target_ahead(40.3, 7.7)])
    clean = dc.simulate(scene, radar, impairments=())
    truth = dc.truth(scene, radar).isel(target=0, frame=0)
    echo_w = float(np.mean(abs(clean.values) ** 2))
    # SNR: 24 dB after integration over both ramps and receivers, 21 dB in each map.
    noise_w = echo_w * radar.integration_gain / 250
    std = [float(bound) for bound in range_and_velocity_crlb_std(radar.frame, snr=250.0)]
    errors = np.full((trials, 2), np.nan)
    for trial in range(trials):
        noise = rng.standard_normal((2, *clean.shape)) * np.sqrt(noise_w / 2)
        detections = dc.detect(clean + (noise[0] + 1j * noise[1]).astype(np.complex64), radar)
        if detections.sizes["detection"]:
            nearest = abs(detections.range.values - truth.range.item()).argmin()
            errors[trial] = [
                (detections[name].values[nearest] - truth[name].item()) / bound
                for name, bound in zip(("range", "velocity"), std, strict=True)
            ]
    is_detected = np.isfinite(errors[:, 0])
    assert is_detected.mean() > 0.9
    for axis_errors in errors[is_detected].T:
        # Tolerance: 5 % above the bound, and the chi-squared quantile of 1e-6.
        assert np.sum(axis_errors**2) < 1.05**2 * chi2.isf(1e-6, is_detected.sum())
        assert np.sum(axis_errors**2) > chi2.ppf(1e-6, is_detected.sum()) / 1.05**2


def select_tones(tones, indices):
    fields = ("slow", "fast", "energy", "amplitude")
    return Tones(*(getattr(tones, name)[indices] for name in fields))


def draw_ramp_peaks(radar, range_m, velocity, snr, rng, imbalance_db=0.0):
    """Draw peaks of rising and falling ramps of targets (n,), with errors at the bound."""
    frame, chirp = radar.frame, radar.frame.chirp
    n = len(range_m)
    delay_hz = chirp.beat_frequency_hz(1.0) * range_m
    doppler_hz = 2 * velocity / chirp.wavelength_m
    amplitude = np.sqrt(snr) * 10 ** (rng.uniform(0, imbalance_db, n) / 20)
    peaks = []
    for sign in (1, -1):
        std = np.sqrt(6 / (amplitude**2 * (chirp.n_samples**2 - 1)))
        fast = (delay_hz + sign * doppler_hz) * 2 * np.pi / chirp.sample_rate_hz
        noise = rng.standard_normal((2, n)) / np.sqrt(2)
        amplitudes = amplitude * np.exp(2j * np.pi * rng.random(n)) + noise[0] + 1j * noise[1]
        tones = Tones(
            slow=np.zeros(n), fast=fast + std * rng.standard_normal(n),
            energy=abs(amplitudes) ** 2, amplitude=amplitudes[:, None],
        )  # fmt: skip
        order = rng.permutation(n)
        peaks.append(
            (
                RefinedPeaks(select_tones(tones, order), abs(amplitudes[order]) ** 2, np.ones(n)),
                order,
            )
        )
    assert frame.n_chirps == 1
    return peaks


def test_pair_confidence_matches_rate_of_correct_pairs(radar):
    radar = build_slow_triangle(radar)
    rng = np.random.default_rng(4)
    confidences, is_correct, n_targets = [], [], 0
    for _ in range(60):
        n = 6
        (up, up_targets), (down, down_targets) = draw_ramp_peaks(
            radar, rng.uniform(20, 100, n), rng.uniform(-40, 40, n), 200.0, rng, imbalance_db=30
        )
        detections = pair_rising_and_falling_peaks(up, down, radar.frame)
        n_targets += n
        beats = detections.peaks.tones.fast
        confidences.append(detections.hypotheses.confidence)
        # Range and Doppler frequency determine both beats, and so the two paired peaks.
        radians_per_hz = 2 * np.pi / radar.frame.chirp.sample_rate_hz
        paired_up = up_targets[abs(beats[:, None] - up.tones.fast).argmin(axis=1)]
        down_beats = beats - 2 * detections.doppler_hz * radians_per_hz
        paired_down = down_targets[abs(down_beats[:, None] - down.tones.fast).argmin(axis=1)]
        is_correct.append(paired_up == paired_down)
    confidences, is_correct = np.concatenate(confidences), np.concatenate(is_correct)
    is_certain = confidences >= 0.99
    assert binom.sf((~is_correct & is_certain).sum() - 1, is_certain.sum(), 0.02) > 1e-6
    assert is_certain.sum() > 0.5 * n_targets
    assert (~is_correct).sum() <= 1.2 * (1 - confidences).sum() + 5 * np.sqrt(
        (1 - confidences).sum()
    )


def test_ambiguous_pairs_of_equal_targets_are_marked(radar):
    radar, rng = build_slow_triangle(radar), np.random.default_rng(5)
    (up, _), (down, _) = draw_ramp_peaks(
        radar, np.array([40.0, 44.0]), np.array([5.0, -5.0]), 300.0, rng
    )
    detections = pair_rising_and_falling_peaks(up, down, radar.frame)
    assert len(detections.doppler_hz) == 2
    assert np.isnan(detections.hypotheses.certain_ambiguity_numbers_or_nan).all()
    assert np.all(detections.hypotheses.confidence < 0.9)


def test_peak_without_partner_is_not_paired(radar):
    radar, rng = build_slow_triangle(radar), np.random.default_rng(6)
    (up, _), (down, _) = draw_ramp_peaks(radar, np.array([40.0]), np.array([5.0]), 300.0, rng)
    no_peaks = RefinedPeaks(
        select_tones(down.tones, slice(0)), down.snr[:0], down.amplitude_noise[:0]
    )
    assert len(pair_rising_and_falling_peaks(up, no_peaks, radar.frame).doppler_hz) == 0


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
def test_target_in_rising_ramps_only_leaves_other_pairs_intact(radar):
    radar = set_triangular(radar)
    targets = [build_target_ahead(20, 6.0), build_target_ahead(45, -33.0, 10.0)]
    cube = dc.simulate(dc.Scene(targets=targets), radar, seed=3)
    interfered_cube = dc.simulate(
        dc.Scene(targets=[*targets, build_target_ahead(32, 12.0, 10.0)]), radar, seed=3
    )
    cube[:, ::2] = interfered_cube[:, ::2]  # even chirps rise
    detections = dc.detect(cube, radar)
    truth = dc.truth(dc.Scene(targets=targets), radar).isel(frame=0)

    order = np.argsort(detections.range.values)
    assert detections.sizes["detection"] == 2
    for name in ("range", "velocity"):
        error = abs(detections[name].values[order] - truth[name].values)
        # Five standard errors, plus the longer path to the second receiver.
        assert np.all(error < 5 * detections[f"{name}_std"].values[order] + 1e-4)


def test_rejects_settings_without_support_for_falling_ramps(radar):
    radar = set_triangular(radar, n_chirps=4)
    scene = dc.Scene(targets=[build_target_ahead(20, 0)])
    with pytest.raises(dc.InvalidSetting, match="triangular, with an impairment of kind pll"):
        dc.simulate(scene, radar, impairments=[dc.impairments.Pll(natural_frequency_hz=3e5)])
    with pytest.raises(dc.InvalidSetting, match="tail, with ramps that differ"):
        dc.simulate(scene, radar, engine=dc.Engine(late="tail"))
    with pytest.raises(dc.InvalidSetting, match="only one of the two"):
        replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)))
