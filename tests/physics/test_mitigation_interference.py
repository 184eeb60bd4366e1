"""Bursts of interference are found and repaired: floor and target come back, nothing else moves."""

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
from dechirp.processing.mitigation.interference_autoregression import InterferenceAutoregression
from dechirp.processing.mitigation.interference_zeroing import InterferenceZeroing
from dechirp.processing.mitigation.mean_subtraction import MeanSubtraction
from dechirp.radar.budget import noise_power_w
from dechirp.simulation.impairments.interference import Interference, Interferer
from noise import noise_cube

METHODS = [InterferenceZeroing(), InterferenceAutoregression()]
RANGE_M, APART_M = 20.0, 40.0

# 20 dB over the noise in a sample, and 0 dB.
STRONG_M2, WEAK_M2 = 1000.0, 10.0


def by_kind(method):
    return method.kind()


def with_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def street(rcs_m2, velocity):
    """The target, and a wall that stands still, 23 dB or more over the noise in a sample."""
    moving = dc.Target(position_m=(RANGE_M, 0, 0), velocity_m_per_s=(velocity, 0, 0), rcs_m2=rcs_m2)
    return dc.Scene(targets=[moving, dc.Target(position_m=(11, 0, 0), rcs_m2=300.0)])


def crossing(radar, scene, slope_hz_per_s, interval_s, over_target_db=15.0):
    """Another radar whose ramps cross; its bursts are so much over the target in a sample."""
    chirp = radar.frame.chirp
    echo = dc.simulate(dc.Scene(targets=scene.targets[:1]), radar, impairments=())
    power_w = float(np.mean(abs(echo) ** 2)) * 10 ** (over_target_db / 10)
    spread = (chirp.wavelength_m / (4 * math.pi * APART_M)) ** 2
    return Interference(
        interferers=[
            Interferer(
                start_frequency_hz=77e9 + (chirp.slope_hz_per_s - slope_hz_per_s) * 15e-6,
                slope_hz_per_s=slope_hz_per_s,
                ramp_duration_s=30e-6,
                interval_s=interval_s,
                transmit_power_w=power_w / (4.0 * radar.hardware.antenna_gain * spread),
                antenna_gain=4.0,
                position_m=(APART_M, 0, 0),
            )
        ]
    )


def floor_and_target_db(samples, radar, velocity):
    """Mean of the 90 % of cells with the least power, and the target's peak."""
    cube = dc.simulate(dc.Scene(), radar, impairments=()).isel(frame=0).copy(data=samples)
    power = dc.power_map(cube, radar, dc.Chain())
    near = power.sel(
        velocity=slice(velocity - 1, velocity + 1), range=slice(RANGE_M - 1, RANGE_M + 1)
    )
    least = np.sort(power.values.ravel())[: int(0.9 * power.size)]
    return 10 * np.log10([least.mean(), near.max().item()])


# Ramps that rise half as fast, on time: 20 samples of every chirp at the same place. Ones that
# fall: 3 samples, elsewhere in each chirp. Ones that nearly run along: half of a chirp and more,
# in 8 chirps. And ones that rise a little slower: 33 samples of every fifth.
BURSTS = [(10e12, 35e-6), (-20e12, 35.3e-6), (19e12, 35.7e-6), (17e12, 35.3e-6)]


@pytest.mark.parametrize("method", METHODS, ids=by_kind)
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("rcs_m2", [STRONG_M2, WEAK_M2])
@pytest.mark.parametrize(("slope_hz_per_s", "interval_s"), BURSTS)
def test_after_bursts_of_15_db_over_the_target_floor_and_target_come_back(
    radar, slope_hz_per_s, interval_s, rcs_m2, sampling, method
):
    radar, velocity = with_sampling(radar, sampling), 8.0
    scene = street(rcs_m2, velocity)
    impairment = crossing(radar, scene, slope_hz_per_s, interval_s)
    clean = dc.simulate(scene, radar, seed=1).values[0]
    hit = dc.simulate(
        scene, radar, impairments=[impairment, dc.impairments.ThermalNoise()], seed=1
    ).values[0]
    expected, found, spoiled = (
        floor_and_target_db(samples, radar, velocity)
        for samples in (clean, method.clean(hit, radar.frame), hit)
    )

    if rcs_m2 == STRONG_M2:
        assert spoiled[0] - expected[0] > 1.5
    loss_db = rise_db = 0.0
    if isinstance(method, InterferenceZeroing):
        # A target keeps (1 - share)^2 of its power, share of the window's weight being zeroed with
        # half of the taper on each side; that share of its power at most lies elsewhere then.
        is_burst = detect_bursts(hit, radar.frame).is_burst
        half = np.ones(1 + method.n_taper)
        zeroed = np.array([np.convolve(row, half, "same") > 0 for row in is_burst])
        window = np.hanning(zeroed.shape[1])
        share = (zeroed @ window).mean() / window.sum()
        loss_db = -20 * np.log10(1 - share)
        snr = 100 if rcs_m2 == STRONG_M2 else 1
        rise_db = max(10 * np.log10(1 + share * snr) - 2, 0)
    assert -2 < found[0] - expected[0] < 2 + rise_db
    assert found[1] - expected[1] == pytest.approx(-loss_db, abs=1)


@pytest.mark.parametrize("method", METHODS, ids=by_kind)
def test_what_stands_still_is_kept_in_bursts_that_wander(radar, method):
    scene = street(WEAK_M2, 8.0)
    impairment = crossing(radar, scene, -20e12, 35.3e-6, over_target_db=30)
    still = dc.simulate(scene, radar, impairments=()).values[0].mean(axis=0)
    hit = dc.simulate(
        scene, radar, impairments=[impairment, dc.impairments.ThermalNoise()], seed=1
    ).values[0]
    errors = [
        np.mean(abs(samples.mean(axis=0) - still) ** 2) * 128 / noise_power_w(radar)
        for samples in (hit, method.clean(hit, radar.frame))
    ]

    # Noise in a mean over 128 chirps; six of them are not in it at some samples. 2 x 256
    # exponential powers have a standard error of 4 %.
    assert errors[0] > 4
    assert errors[1] == pytest.approx(1.05, abs=0.25)


def test_autoregression_carries_a_strong_target_through_a_burst_and_zeroing_does_not(radar):
    n, rng = np.arange(radar.frame.chirp.n_samples), np.random.default_rng(83)
    samples = noise_cube(radar, rng).values[0]
    phases = 2 * np.pi * (0.11 * n + 0.2 * np.arange(128)[:, None])
    tones = 30 * np.exp(1j * phases) + 20 * np.exp(-0.7j * phases + 2j)
    samples += tones[:, None].astype(np.complex64)
    gap = slice(100, 130)
    hit = samples.copy()
    hit[40:50, :, gap] += 200 * np.exp(2j * np.pi * rng.random((10, 2, 30))).astype(np.complex64)

    def error(method):
        wrong = method.clean(hit, radar.frame)[40:50, :, gap] - tones[40:50, None, gap]
        return np.mean(abs(wrong) ** 2) / np.mean(abs(tones) ** 2)

    # Tones 28 dB over the noise; a predictor of 16 weights knows them to within some noise.
    assert 10 * np.log10(error(InterferenceAutoregression())) < -15
    assert 10 * np.log10(error(InterferenceZeroing())) > -1


@pytest.mark.parametrize("method", METHODS, ids=by_kind)
@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("n_tx", [1, 2])
def test_clean_frames_stay_as_they_are_to_the_bit(radar, method, sampling, n_tx):
    rng = np.random.default_rng(84)
    frame = replace(
        radar.frame, multiplexing=dc.multiplexing.Tdm(order=(0, 1)) if n_tx > 1 else None
    )
    array = replace(radar.array, tx_m=((0, 0, 0), (0, 5e-3, 0))[:n_tx])
    radar = with_sampling(replace(radar, frame=frame, array=array), sampling)
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
    noise = [noise_cube(radar, rng).values[0] for _ in range(10)]

    # 3,300 chirps; each of noise is taken for one with a burst with a chance below 1e-12.
    for samples in [*frames, *noise]:
        assert np.array_equal(method.clean(samples, radar.frame), samples)


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("over_noise_db", "length"), [(12, 40), (30, 12), (50, 150)])
def test_bursts_are_marked_where_they_are(radar, sampling, over_noise_db, length):
    radar, rng = with_sampling(radar, sampling), np.random.default_rng(85)
    samples = noise_cube(radar, rng).values[0]
    samples += np.float32(100)  # what stands still
    places = {3: 20, 4: 60, 77: 90, 127: 100}
    amplitude = 10 ** (over_noise_db / 20)
    for chirp, start in places.items():
        burst = amplitude * np.exp(2j * np.pi * rng.random(length))
        if sampling == "real":
            burst = np.sqrt(2) * burst.real
        samples[chirp, :, start : start + length] += burst.astype(samples.dtype)
    is_burst = detect_bursts(samples, radar.frame).is_burst

    assert np.flatnonzero(is_burst.any(axis=1)).tolist() == sorted(places)
    for chirp, start in places.items():
        true = np.zeros(256, bool)
        true[start : start + length] = True
        # Ends are off by the samples by which noise goes on as a burst, or a burst begins weak;
        # where only one side predicts, by the 16 weights.
        assert np.count_nonzero(is_burst[chirp] & ~true) <= 12 + 16
        assert np.count_nonzero(true & ~is_burst[chirp]) <= 0.1 * length


def test_two_bursts_of_a_chirp_leave_what_is_between_them(radar):
    samples = noise_cube(radar, np.random.default_rng(86)).values[0]
    samples[9, :, 30:34] += 300
    samples[9, :, 200:204] -= 300j
    is_burst = detect_bursts(samples, radar.frame).is_burst[9]

    assert is_burst[30:34].all() and is_burst[200:204].all()
    assert not is_burst[60:180].any()


def test_what_was_taken_out_is_told_by_its_number_and_its_power(radar):
    rng = np.random.default_rng(87)
    methods = [InterferenceZeroing(n_taper=0), MeanSubtraction()]
    frames = []
    for chirps in ([5, 40], []):
        samples = noise_cube(radar, rng).values[0] + np.complex64(10)
        for chirp in chirps:
            samples[chirp, :, 50:60] += 100
        frames.append(apply_mitigation(samples, radar.frame, methods))
    repaired, still = frames[0].removed

    assert (repaired.kind, repaired.n_changed_chirps, repaired.n_frame_chirps) == (
        "interference-zeroing",
        2,
        128,
    )
    n_marked = disturbed_samples = round(repaired.changed_share * 128 * 256)
    assert 20 <= n_marked <= 36 and disturbed_samples == repaired.changed_share * 128 * 256
    # 100^2 in 20 of 128 x 256 samples, and noise in all of those.
    assert repaired.removed_power == pytest.approx(1e4 * 20 / (128 * 256), rel=0.05)
    # 10^2 and the noise of a mean over 128; 127 / 128 of the noise is left.
    assert still.removed_power == pytest.approx(100, rel=0.01)
    assert still.remaining_power == pytest.approx(1, rel=0.05)
    assert (still.n_changed_chirps, still.changed_share) == (128, 1)
    said = [finding.value for finding in mitigation_findings([one.removed for one in frames])]
    assert said[0].startswith("2 of 256 chirps repaired, 0.0")
    assert said[1] == "removed power: +20.0 dB of the remaining power"
    nothing = mitigation_findings([frames[1].removed])
    assert nothing[0].value == "nothing to repair in 128 chirps"
    assert np.array_equal(apply_mitigation(samples, radar.frame, []).samples, samples)


@pytest.mark.parametrize("method", METHODS, ids=by_kind)
def test_frames_too_short_to_know_what_is_usual_are_left_alone(radar, method):
    short = replace(radar, frame=replace(radar.frame, n_chirps=3))
    samples = noise_cube(short, np.random.default_rng(88)).values[0]
    samples[1, :, 40:50] += 1e3

    assert np.array_equal(method.clean(samples, short.frame), samples)
    assert method.target_findings(short)[0].level == "warning"
    assert "3 chirps" in method.target_findings(short)[0].value
    assert method.target_findings(radar) == []


@pytest.mark.parametrize("method", METHODS, ids=by_kind)
def test_silence_and_half_chirps_of_interference_are_survived(radar, method):
    shape = (radar.frame.n_chirps_total, 2, radar.frame.chirp.n_samples)
    silent = np.zeros(shape, np.complex64)
    assert np.array_equal(method.clean(silent, radar.frame), silent)
    samples = noise_cube(radar, np.random.default_rng(89)).values[0]
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
    done = apply_mitigation(samples, frame, METHODS)
    assert np.isfinite(done.samples).all()
    assert all(np.isfinite([one.removed_power, one.remaining_power]).all() for one in done.removed)
