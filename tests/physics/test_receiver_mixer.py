"""Mixer and channel errors: IQ imbalance, DC offset and channel mismatch."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.simulation.impairments.channel_mismatch import ChannelMismatch
from dechirp.simulation.impairments.dc_offset import DcOffset
from dechirp.simulation.impairments.iq_imbalance import IqImbalance

EMPTY_SCENE = dc.Scene()


def set_sampling(radar, sampling):
    chirp = replace(radar.frame.chirp, sampling=sampling)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def apply_impairment(impairment, radar, samples, seed=0):
    impairment.check(EMPTY_SCENE, radar)
    n_before, n_after = impairment.sample_margins(radar)
    cube = np.array(samples)
    impairment.apply_to_samples(cube, EMPTY_SCENE, radar, np.random.default_rng(seed))
    return cube[..., n_before : cube.shape[-1] - n_after]


def generate_tone(cycles, *, n=256, n_margin=0, is_complex=True):
    """Generate a tone of `cycles` in n samples, of power 1, in two receivers, with margins."""
    phase = 2 * np.pi * cycles / n * (np.arange(n + 2 * n_margin) - n_margin)
    wave = np.exp(1j * phase) if is_complex else np.sqrt(2) * np.cos(phase)
    return np.tile(wave, (1, 3, 2, 1))


@pytest.mark.parametrize(
    ("gain_db", "phase_deg", "rejection_db"), [(0.1, 1.0, 39.6), (1.0, 5.0, 22.8), (0.0, 3.0, 31.6)]
)
def test_iq_imbalance_gives_image_of_predicted_level(radar, gain_db, phase_deg, rejection_db):
    impairment = IqImbalance(gain=10 ** (gain_db / 10), phase_rad=np.radians(phase_deg))
    power = (
        abs(np.fft.fft(apply_impairment(impairment, radar, generate_tone(20)))[0, 0, 0] / 256) ** 2
    )

    assert 10 * np.log10(power[20] / power[-20]) == pytest.approx(rejection_db, abs=0.05)
    # The echo itself changes only in second order of the errors.
    assert 10 * np.log10(power[20]) == pytest.approx(0, abs=0.01)
    power[[20, -20]] = 0
    assert power.max() < 1e-20


def test_image_level_holds_in_single_precision(radar):
    impairment = IqImbalance(gain=10**0.01, phase_rad=np.radians(1))
    power = (
        abs(np.fft.fft(apply_impairment(impairment, radar, generate_tone(20).astype(np.complex64))))
        ** 2
    )
    ratio_db = 10 * np.log10(power[0, 0, 0, 20] / power[0, 0, 0, -20])
    assert ratio_db == pytest.approx(39.6, abs=0.05)


def test_rejects_iq_imbalance_of_real_sampling(radar):
    with pytest.raises(dc.InvalidSetting, match="a single mixer"):
        IqImbalance(gain=1.1).check(EMPTY_SCENE, set_sampling(radar, "real"))


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_dc_offset_is_constant_of_its_power_in_every_receiver(radar, sampling):
    radar = set_sampling(radar, sampling)
    offset = DcOffset(power_w=1e-9, phases_rad=(0.3, 2.0))
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=[offset], dtype=np.complex128).values

    expected = np.sqrt(1e-9) * np.exp([0.3j, 2.0j])
    if sampling == "real":
        expected = np.sqrt(2) * expected.real
    np.testing.assert_allclose(cube, np.broadcast_to(expected[:, None], cube.shape))


def test_offset_phases_are_drawn_once_per_receiver(radar):
    offset = DcOffset(power_w=1.0)
    cube = dc.simulate(EMPTY_SCENE, radar, impairments=[offset], n_frames=2, seed=5).values
    np.testing.assert_allclose(abs(cube), 1, rtol=1e-6)
    rx_offsets = cube[0, 0, :, 0]
    assert rx_offsets[0] != rx_offsets[1]
    assert (cube == rx_offsets[:, None]).all()


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize("cycles", [20.0, 63.4, 110.3])
def test_mismatch_rotates_and_scales_each_receiver(radar, sampling, cycles):
    radar = set_sampling(radar, sampling)
    mismatch = ChannelMismatch(gains=(1.2, 0.9), phases_rad=(0.05, -0.4))
    n_margin, is_complex = max(mismatch.sample_margins(radar)), sampling == "complex"
    samples = generate_tone(cycles, n_margin=n_margin, is_complex=is_complex)
    received = apply_impairment(mismatch, radar, samples)[0]

    phase = 2 * np.pi * cycles / 256 * np.arange(256)
    for rx, (gain, phase_rad) in enumerate([(1.2, 0.05), (0.9, -0.4)]):
        rotated_wave = np.exp(1j * (phase + phase_rad))
        wave = np.sqrt(gain) * (rotated_wave if is_complex else np.sqrt(2) * rotated_wave.real)
        # Tolerance of the response for real samples: 0.2 %.
        np.testing.assert_allclose(received[:, rx], np.tile(wave, (3, 1)), atol=4e-3)


def test_drawn_mismatches_have_their_spread_and_are_constant(radar):
    array = dc.Array(rx_m=[(0, 1e-3 * k, 0) for k in range(400)])
    frame = replace(radar.frame, n_chirps=2)
    radar = replace(radar, frame=replace(frame, chirp=replace(frame.chirp, n_samples=4)))
    mismatch = ChannelMismatch(gain_std=10**0.05, phase_std_rad=0.05)
    received = apply_impairment(
        mismatch, replace(radar, array=array), np.ones((2, 2, 400, 4), complex), 6
    )

    assert (received == received[0, 0, :, :1]).all()
    gains_db, phases = 20 * np.log10(abs(received[0, 0, :, 0])), np.angle(received[0, 0, :, 0])
    # Standard deviations of 400 draws have an error of 3.5 %: four of those.
    assert np.std(gains_db) == pytest.approx(0.5, rel=0.14)
    assert np.std(phases) == pytest.approx(0.05, rel=0.14)
    assert abs(gains_db.mean()) < 0.1
    assert abs(phases.mean()) < 0.01


@pytest.mark.parametrize(
    ("build_impairment", "message"),
    [
        (lambda: IqImbalance(gain=0.0), "IqImbalance.gain"),
        (lambda: IqImbalance(phase_rad=2.0), "IqImbalance.phase_rad"),
        (lambda: DcOffset(power_w=-1.0), "DcOffset.power_w"),
        (lambda: DcOffset(power_w=1.0, phases_rad=(float("nan"),)), "DcOffset.phases_rad"),
        (lambda: ChannelMismatch(gain_std=0.9), "ChannelMismatch.gain_std"),
        (lambda: DcOffset(power_w=1.0, phases_rad=0.5), "DcOffset.phases_rad"),
        (lambda: ChannelMismatch(gains=(1.0, 0.0)), "ChannelMismatch.gains"),
        (lambda: ChannelMismatch(gains=2.0), "ChannelMismatch.gains"),
        (lambda: ChannelMismatch(phases_rad=[[0.1], [0.2]]), "ChannelMismatch.phases_rad.0"),
        (lambda: ChannelMismatch(phase_std_rad=float("inf")), "ChannelMismatch.phase_std_rad"),
    ],
)
def test_rejects_invalid_impairment_settings(build_impairment, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        build_impairment()


@pytest.mark.parametrize(
    ("impairment", "message"),
    [
        (DcOffset(power_w=1.0, phases_rad=(0.0,)), "phases: 1 values.*2 values"),
        (ChannelMismatch(gains=(1.0, 1.0, 1.0)), "gains: 3 values.*2 values"),
    ],
)
def test_rejects_wrong_number_of_receiver_values(radar, impairment, message):
    with pytest.raises(dc.InvalidSetting, match=message):
        impairment.check(EMPTY_SCENE, radar)
