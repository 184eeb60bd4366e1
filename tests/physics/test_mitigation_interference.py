"""Interference mitigation: detection and repair of bursts, effect on floor and targets."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import dechirp as dc
from dechirp.processing.mitigation.apply import apply_mitigation, mitigation_findings
from dechirp.processing.mitigation.burst_detection import detect_bursts
from dechirp.processing.mitigation.interference_repair import (
    InterferenceAutoregression,
    InterferenceZeroing,
)
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.radar.budget import noise_power_w
from dechirp.simulation.impairments.interference import Interference, Interferer
from nightly import nightly_except
from noise_cubes import simulate_noise_cube

METHODS = [InterferenceZeroing(), InterferenceAutoregression()]
RANGE_M, INTERFERER_RANGE_M = 20.0, 40.0

# SNR per sample: 20 dB and 0 dB.
STRONG_M2, WEAK_M2 = 1000.0, 10.0


def format_kind(method):
    return method.kind()


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def build_street(rcs_m2, velocity):
    """Build the target and a static wall, 23 dB or more over the noise in a sample."""
    moving = dc.Target(position_m=(RANGE_M, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)
    return dc.Scene(targets=[moving, dc.Target(position_m=(11, 0, 0), rcs_m2=300.0)])


def build_crossing_interference(radar, scene, slope_hz_per_s, interval_s, over_target_db=15.0):
    """Build a radar with crossing ramps and bursts `over_target_db` above the target."""
    chirp = radar.frame.chirp
    echo = dc.simulate(dc.Scene(targets=scene.targets[:1]), radar, impairments=())
    power_w = float(np.mean(abs(echo) ** 2)) * 10 ** (over_target_db / 10)
    spread = (chirp.wavelength_m / (4 * math.pi * INTERFERER_RANGE_M)) ** 2
    return Interference(
        interferers=[
            Interferer(
                start_frequency_hz=77e9 + (chirp.slope_hz_per_s - slope_hz_per_s) * 15e-6,
                slope_hz_per_s=slope_hz_per_s,
                ramp_duration_s=30e-6,
                interval_s=interval_s,
                transmit_power_w=power_w / (4.0 * radar.hardware.antenna_gain * spread),
                antenna_gain=4.0,
                position_m=(INTERFERER_RANGE_M, 0, 0),
            )
        ]
    )


def measure_floor_and_target_db(samples, radar, velocity):
    """Measure the mean of the weakest 90 % of cells and the peak of the target."""
    cube = dc.simulate(dc.Scene(), radar, impairments=()).isel(frame=0).copy(data=samples)
    power = dc.power_map(cube, radar, dc.Chain())
    neighbourhood = power.sel(
        velocity=slice(velocity - 1, velocity + 1), range=slice(RANGE_M - 1, RANGE_M + 1)
    )
    floor_powers = np.sort(power.values.ravel())[: int(0.9 * power.size)]
    return 10 * np.log10([floor_powers.mean(), neighbourhood.max().item()])


# Half the slope, synchronous: 20 samples of every chirp at the same place. Falling ramps: 3
# samples, elsewhere in each chirp. Nearly equal slope: half a chirp and more, in 8 chirps.
# Slightly lower slope: 33 samples of every fifth chirp.
BURSTS = [(10e12, 35e-6), (-20e12, 35.3e-6), (19e12, 35.7e-6), (17e12, 35.3e-6)]


@pytest.mark.parametrize("method", nightly_except(1, METHODS), ids=format_kind)
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("rcs_m2", nightly_except([WEAK_M2], [STRONG_M2, WEAK_M2]))
@pytest.mark.parametrize(("slope_hz_per_s", "interval_s"), nightly_except(1, BURSTS))
def test_repair_restores_floor_and_target_after_15_db_bursts(
    radar, slope_hz_per_s, interval_s, rcs_m2, sampling, method
):
    radar, velocity = set_sampling(radar, sampling), 8.0
    scene = build_street(rcs_m2, velocity)
    impairment = build_crossing_interference(radar, scene, slope_hz_per_s, interval_s)
    clean = dc.simulate(scene, radar, seed=1).values[0]
    disturbed = dc.simulate(
        scene, radar, impairments=[impairment, dc.impairments.ThermalNoise()], seed=1
    ).values[0]
    clean_db, repaired_db, disturbed_db = (
        measure_floor_and_target_db(samples, radar, velocity)
        for samples in (clean, method.clean(disturbed, radar.frame), disturbed)
    )

    if rcs_m2 == STRONG_M2:
        assert disturbed_db[0] - clean_db[0] > 1.5
    loss_db = rise_db = 0.0
    if isinstance(method, InterferenceZeroing):
        # The target keeps (1 - share)^2 of its power, where share is the zeroed window weight
        # with half of the taper on each side; at most that share of its power spreads elsewhere.
        is_burst = detect_bursts(disturbed, radar.frame).is_burst
        taper_kernel = np.ones(1 + method.n_taper)
        zeroed = np.array([np.convolve(row, taper_kernel, "same") > 0 for row in is_burst])
        window = np.hanning(zeroed.shape[1])
        share = (zeroed @ window).mean() / window.sum()
        loss_db = -20 * np.log10(1 - share)
        snr = 100 if rcs_m2 == STRONG_M2 else 1
        rise_db = max(10 * np.log10(1 + share * snr) - 2, 0)
    assert -2 < repaired_db[0] - clean_db[0] < 2 + rise_db
    assert repaired_db[1] - clean_db[1] == pytest.approx(-loss_db, abs=1)


@pytest.mark.parametrize("method", METHODS, ids=format_kind)
def test_static_targets_survive_wandering_bursts(radar, method):
    scene = build_street(WEAK_M2, 8.0)
    impairment = build_crossing_interference(radar, scene, -20e12, 35.3e-6, over_target_db=30)
    static_samples = dc.simulate(scene, radar, impairments=()).values[0].mean(axis=0)
    disturbed = dc.simulate(
        scene, radar, impairments=[impairment, dc.impairments.ThermalNoise()], seed=1
    ).values[0]
    errors = [
        np.mean(abs(samples.mean(axis=0) - static_samples) ** 2) * 128 / noise_power_w(radar)
        for samples in (disturbed, method.clean(disturbed, radar.frame))
    ]

    # Noise of a mean over 128 chirps; six chirps are missing at some samples. 2 x 256 exponential
    # powers have a standard error of 4 %.
    assert errors[0] > 4
    assert errors[1] == pytest.approx(1.05, abs=0.25)


def test_autoregression_bridges_burst_on_strong_target_unlike_zeroing(radar):
    n, rng = np.arange(radar.frame.chirp.n_samples), np.random.default_rng(83)
    samples = simulate_noise_cube(radar, rng).values[0]
    phases = 2 * np.pi * (0.11 * n + 0.2 * np.arange(128)[:, None])
    tones = 30 * np.exp(1j * phases) + 20 * np.exp(-0.7j * phases + 2j)
    samples += tones[:, None].astype(np.complex64)
    gap = slice(100, 130)
    disturbed = samples.copy()
    disturbed[40:50, :, gap] += 200 * np.exp(2j * np.pi * rng.random((10, 2, 30))).astype(
        np.complex64
    )

    def compute_error(method):
        deviation = method.clean(disturbed, radar.frame)[40:50, :, gap] - tones[40:50, None, gap]
        return np.mean(abs(deviation) ** 2) / np.mean(abs(tones) ** 2)

    # Tones 28 dB over the noise; a predictor of 16 weights extrapolates them to about the noise.
    assert 10 * np.log10(compute_error(InterferenceAutoregression())) < -15
    assert 10 * np.log10(compute_error(InterferenceZeroing())) > -1


@pytest.mark.parametrize("method", nightly_except(1, METHODS), ids=format_kind)
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_tx", nightly_except([2], [1, 2]))
def test_clean_frames_stay_bit_identical(radar, method, sampling, n_tx):
    rng = np.random.default_rng(84)
    frame = replace(
        radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)) if n_tx > 1 else None
    )
    array = replace(radar.array, tx_m=((0, 0, 0), (0, 5e-3, 0))[:n_tx])
    radar = set_sampling(replace(radar, frame=frame, array=array), sampling)
    targets = [
        dc.Target(
            name=f"scatterer-{k}",
            position_m=(range_m, 0, 0),
            velocity_m_per_s=(velocity, 0, 0),
            rcs_m2=10.0**decades,
        )
        for k, (range_m, velocity, decades) in enumerate(
            rng.uniform((1, -12, -2), (34, 12, 2), size=(60, 3))
        )
    ]
    frames = dc.simulate(dc.Scene(targets=targets), radar, n_frames=3, seed=3).values
    noise = [simulate_noise_cube(radar, rng).values[0] for _ in range(10)]

    # 3,300 chirps; the false-burst probability of a chirp of noise is below 1e-12.
    for samples in [*frames, *noise]:
        assert np.array_equal(method.clean(samples, radar.frame), samples)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("over_noise_db", "length"), [(12, 40), (30, 12), (50, 150)])
def test_bursts_are_marked_at_their_samples(radar, sampling, over_noise_db, length):
    radar, rng = set_sampling(radar, sampling), np.random.default_rng(85)
    samples = simulate_noise_cube(radar, rng).values[0]
    samples += np.float32(100)  # static echo
    burst_starts = {3: 20, 4: 60, 77: 90, 127: 100}
    amplitude = 10 ** (over_noise_db / 20)
    for chirp, start in burst_starts.items():
        burst = amplitude * np.exp(2j * np.pi * rng.random(length))
        if sampling == "real":
            burst = np.sqrt(2) * burst.real
        samples[chirp, :, start : start + length] += burst.astype(samples.dtype)
    is_burst = detect_bursts(samples, radar.frame).is_burst

    assert np.flatnonzero(is_burst.any(axis=1)).tolist() == sorted(burst_starts)
    for chirp, start in burst_starts.items():
        is_true_burst = np.zeros(256, bool)
        is_true_burst[start : start + length] = True
        # Errors of burst limits: samples in which noise continues a burst or a burst begins
        # weakly, and the 16 weights where prediction has one side only.
        assert np.count_nonzero(is_burst[chirp] & ~is_true_burst) <= 12 + 16
        assert np.count_nonzero(is_true_burst & ~is_burst[chirp]) <= 0.1 * length


def test_samples_between_two_bursts_stay_unmarked(radar):
    samples = simulate_noise_cube(radar, np.random.default_rng(86)).values[0]
    samples[9, :, 30:34] += 300
    samples[9, :, 200:204] -= 300j
    is_burst = detect_bursts(samples, radar.frame).is_burst[9]

    assert is_burst[30:34].all() and is_burst[200:204].all()
    assert not is_burst[60:180].any()


def test_findings_report_number_and_power_of_repaired_chirps(radar):
    rng = np.random.default_rng(87)
    methods = [InterferenceZeroing(n_taper=0), MeanSubtraction()]
    frames = []
    for chirps in ([5, 40], []):
        samples = simulate_noise_cube(radar, rng).values[0] + np.complex64(10)
        for chirp in chirps:
            samples[chirp, :, 50:60] += 100
        frames.append(apply_mitigation(samples, radar.frame, methods))
    zeroing, subtraction = frames[0].removed

    assert (zeroing.kind, zeroing.n_changed_chirps, zeroing.n_frame_chirps) == (
        "interference-zeroing",
        2,
        128,
    )
    n_marked = disturbed_samples = round(zeroing.changed_share * 128 * 256)
    assert 20 <= n_marked <= 36 and disturbed_samples == zeroing.changed_share * 128 * 256
    # 100^2 in 20 of 128 x 256 samples, and noise in all of those.
    assert zeroing.removed_power == pytest.approx(1e4 * 20 / (128 * 256), rel=0.05)
    # 10^2 and the noise of a mean over 128; 127 / 128 of the noise remains.
    assert subtraction.removed_power == pytest.approx(100, rel=0.01)
    assert subtraction.remaining_power == pytest.approx(1, rel=0.05)
    assert (subtraction.n_changed_chirps, subtraction.changed_share) == (128, 1)
    messages = [
        finding.value for finding in mitigation_findings([frame.removed for frame in frames])
    ]
    assert messages[0].startswith("2 of 256 chirps repaired, 0.0")
    assert messages[1] == "removed power: +20.0 dB of the remaining power"
    idle_findings = mitigation_findings([frames[1].removed])
    assert idle_findings[0].value == "nothing to repair in 128 chirps"
    assert np.array_equal(apply_mitigation(samples, radar.frame, []).samples, samples)


@pytest.mark.parametrize("method", METHODS, ids=format_kind)
def test_frames_of_three_chirps_are_not_repaired(radar, method):
    short_radar = replace(radar, frame=replace(radar.frame, n_chirps=3))
    samples = simulate_noise_cube(short_radar, np.random.default_rng(88)).values[0]
    samples[1, :, 40:50] += 1e3

    assert np.array_equal(method.clean(samples, short_radar.frame), samples)
    assert method.limitation_findings(short_radar)[0].level == "warning"
    assert "3 chirps" in method.limitation_findings(short_radar)[0].value
    assert method.limitation_findings(radar) == []


@pytest.mark.parametrize("method", METHODS, ids=format_kind)
def test_silent_frames_and_half_chirp_bursts_give_finite_samples(radar, method):
    shape = (radar.frame.n_chirps_total, 2, radar.frame.chirp.n_samples)
    silent_samples = np.zeros(shape, np.complex64)
    assert np.array_equal(method.clean(silent_samples, radar.frame), silent_samples)
    samples = simulate_noise_cube(radar, np.random.default_rng(89)).values[0]
    samples[:60] = 0  # lost
    samples[100, :, :140] += 1e4
    repaired = method.clean(samples, radar.frame)
    assert not repaired[:60].any()
    assert np.isfinite(repaired).all() and abs(repaired[100]).max() < 100
    with pytest.raises(dc.InvalidSetting, match="finite"):
        method.clean(samples * np.nan, radar.frame)
    for n_taper in (-1, 1.5):
        with pytest.raises(dc.InvalidSetting, match="n_taper"):
            InterferenceZeroing(n_taper=n_taper)


@given(data=st.data())
def test_any_finite_samples_give_finite_samples(radar, data):
    n_chirps = data.draw(st.sampled_from([1, 4, 9]))
    n_samples = data.draw(st.sampled_from([2, 16, 33]))
    chirp = replace(radar.frame.chirp, n_samples=n_samples, sampling="real")
    frame = replace(radar.frame, n_chirps=n_chirps, chirp=chirp)
    numbers = st.floats(-(2.0**99), 2.0**99, width=32)
    samples = data.draw(hnp.arrays(np.float32, (n_chirps, 2, n_samples), elements=numbers))
    result = apply_mitigation(samples, frame, METHODS)
    assert np.isfinite(result.samples).all()
    assert all(
        np.isfinite([echo.removed_power, echo.remaining_power]).all() for echo in result.removed
    )
