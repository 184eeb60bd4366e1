"""Transmitters that send together: their codes, and what detection makes of the sum."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import hadamard
from scipy.stats import binom

import dechirp as dc
from dechirp.core.errors import InvalidSetting
from dechirp.core.gaussian_noise import add_white_noise
from dechirp.core.units import to_decibels
from dechirp.processing.virtual_array import split_slots
from dechirp.radar.array import Array
from dechirp.radar.cube import label_cube
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from noise import alarms

ORDERS = st.integers(1, 6).flatmap(lambda n: st.permutations(range(n)))
TOGETHER = [
    Bpm(order=(1, 0)),
    Bpm(order=(2, 0, 1)),
    Ddma(order=(0, 1), n_sub_bands=3),
    Ddma(order=(2, 0, 1), n_sub_bands=4),
    PhaseCode(phases_rad=[[0, 0], [pi / 2, -pi / 2]]),
]


def coded(radar, multiplexing, *, n_chirps=None, n_samples=None):
    """The radar with transmitters two wavelengths apart that share its chirps so."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples or radar.frame.chirp.n_samples)
    frame = replace(
        radar.frame,
        chirp=chirp,
        n_chirps=n_chirps or radar.frame.n_chirps,
        multiplexing=multiplexing,
    )
    tx_m = [(0, 0.0078 * k, 0) for k in range(multiplexing.n_tx)]
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def slow_time(frame, *, velocity_m_per_s, echoes):
    """Chirps of (tx, ...) complex echoes of a target, as each receiver takes them, (chirp, ...)."""
    chirps = np.arange(frame.n_chirps_total)
    turned = 4 * pi * velocity_m_per_s / frame.chirp.wavelength_m * chirps * frame.interval_s
    sent = frame.chirp_weights() * np.exp(1j * turned)[:, None]
    return np.tensordot(sent, echoes, axes=1)


def random_echoes(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@given(order=ORDERS, empty=st.integers(0, 3))
def test_echoes_of_different_transmitters_are_orthogonal_over_a_round(order, empty):
    n_tx = len(order)
    codes = [Tdm(order=order), Bpm(order=order), Ddma(order=order, n_sub_bands=n_tx + empty)]
    for code in codes:
        weights = np.array(code.weights)
        times_sent = [sum(k in slot for slot in code.slot_transmitters) for k in range(n_tx)]

        assert (
            weights.shape
            == (len(code.slot_transmitters), n_tx)
            == (len(code.slot_transmitters), code.n_tx)
        )
        assert abs(weights[weights != 0]) == pytest.approx(1)
        np.testing.assert_allclose(
            weights.conj().T @ weights, np.diag(times_sent), rtol=0, atol=1e-13
        )


@pytest.mark.parametrize("n_tx", [1, 2, 3, 4, 5, 8, 12])
def test_binary_phases_are_rows_of_the_smallest_hadamard_matrix_with_enough_of_them(n_tx):
    order = np.random.default_rng(n_tx).permutation(n_tx)
    weights = np.array(Bpm(order=order).weights)
    size = 1 << (n_tx - 1).bit_length()

    assert weights.shape == (size, n_tx)
    np.testing.assert_array_equal(weights[:, order], hadamard(size)[:n_tx].T)


def test_two_transmitters_send_both_plus_and_then_one_of_them_minus():
    assert Bpm(order=(0, 1)).weights == ((1, 1), (1, -1))
    assert Bpm(order=(1, 0)).weights == ((1, 1), (-1, 1))


@pytest.mark.parametrize(("order", "n_sub_bands"), [((0, 1), 2), ((2, 0, 1), 4), ((1, 3, 0, 2), 6)])
def test_doppler_division_raises_each_transmitter_by_its_sub_band(radar, order, n_sub_bands):
    frame = coded(radar, Ddma(order=order, n_sub_bands=n_sub_bands), n_chirps=16).frame
    velocity = 3 * frame.velocity_resolution_m_per_s  # receding, on a bin
    doppler_hz = 2 * velocity / frame.chirp.wavelength_m
    own = np.fft.fftfreq(frame.n_chirps_total, frame.interval_s)
    for k, transmitter in enumerate(order):
        alone = np.zeros(len(order))
        alone[transmitter] = 1
        spectrum = np.fft.fft(slow_time(frame, velocity_m_per_s=velocity, echoes=alone))

        raised_hz = doppler_hz + k / (n_sub_bands * frame.interval_s)
        around_hz = 1 / frame.interval_s
        seen_hz = own[np.argmax(abs(spectrum))]
        off = (seen_hz - raised_hz + around_hz / 2) % around_hz - around_hz / 2
        assert off == pytest.approx(0, abs=1e-6 / frame.duration_s)
        assert abs(spectrum).max() == pytest.approx(frame.n_chirps_total)


def test_sub_bands_beyond_the_transmitters_stay_empty(radar):
    frame = coded(radar, Ddma(order=(2, 0, 1), n_sub_bands=5), n_chirps=16).frame
    velocity = 3 * frame.velocity_resolution_m_per_s
    spectrum = np.fft.fft(slow_time(frame, velocity_m_per_s=velocity, echoes=np.array([3, 1, 2])))
    bands = abs(spectrum.reshape(5, 16)[:, 3]) / frame.n_chirps_total

    np.testing.assert_allclose(bands, [2, 3, 1, 0, 0], atol=1e-12)


def test_a_table_of_phases_can_say_what_the_other_codes_say():
    turning = [[0, 2 * pi * slot / 4] for slot in range(4)]
    ddma = np.array(Ddma(order=(0, 1), n_sub_bands=4).weights)

    np.testing.assert_allclose(PhaseCode(phases_rad=turning).weights, ddma, atol=1e-15)
    signs = PhaseCode(phases_rad=np.array([[0, 0], [0, pi]])).weights
    np.testing.assert_allclose(signs, Bpm(order=(0, 1)).weights, atol=1e-15)


def test_the_code_repeats_from_round_to_round(radar):
    for code in TOGETHER:
        frame = coded(radar, code, n_chirps=3).frame
        assert frame.n_chirps_total == 3 * frame.n_slots == 3 * len(code.weights)
        np.testing.assert_array_equal(frame.chirp_weights(), code.weights * 3)
        assert frame.repetition_s == pytest.approx(frame.n_slots * frame.interval_s)


def test_a_code_as_long_as_the_frame_is_one_round(radar):
    phases = np.random.default_rng(71).uniform(-pi, pi, (48, 2))
    frame = coded(radar, PhaseCode(phases_rad=phases), n_chirps=1).frame

    assert (frame.n_slots, frame.n_chirps_total) == (48, 48)
    np.testing.assert_allclose(frame.chirp_weights(), np.exp(1j * phases), atol=1e-15)
    assert frame.duration_s == pytest.approx(48 * 35e-6)


def test_a_code_as_long_as_the_frame_tells_range_and_no_velocity_as_it_is(radar):
    phases = np.random.default_rng(71).uniform(-pi, pi, (48, 2))
    radar = coded(radar, PhaseCode(phases_rad=phases), n_chirps=1)
    found = dc.detect(seen_in_noise(radar, range_m=20.0, velocity_m_per_s=1.0, snr=0.01), radar)

    assert found.sizes["detection"] == 1
    assert abs(found.range.item() - 20.0) < 5 * found.range_std.item()
    assert np.isnan(found.velocity.item())


def test_one_transmitter_without_multiplexing_sends_in_every_chirp(radar):
    assert radar.frame.weights == ((1,),)
    assert (radar.frame.chirp_weights() == np.ones((128, 1))).all()
    assert radar.n_summed_maps == radar.array.n_rx


@given(
    order=ORDERS,
    empty=st.integers(0, 2),
    seed=st.integers(0, 2**32 - 1),
    velocity_bin=st.integers(-4, 3),
)
def test_powers_of_the_slots_add_up_to_those_of_all_echoes(radar, order, empty, seed, velocity_bin):
    rng = np.random.default_rng(seed)
    for code in (Bpm(order=order), Ddma(order=order, n_sub_bands=len(order) + empty)):
        frame = coded(radar, code, n_chirps=8).frame
        echoes = random_echoes(rng, len(order), 2, 5)  # tx, rx, sample
        velocity = velocity_bin * frame.velocity_resolution_m_per_s
        parted = split_slots(slow_time(frame, velocity_m_per_s=velocity, echoes=echoes), frame)

        assert parted.shape == (8, frame.n_slots * 2, 5)
        spectrum = np.fft.fft(parted, axis=0)[velocity_bin]
        for receiver in range(2):
            seen = (abs(spectrum[receiver::2]) ** 2).sum(axis=0)
            sent = (abs(echoes[:, receiver]) ** 2).sum(axis=0)
            np.testing.assert_allclose(seen, 8**2 * frame.n_slots * sent, rtol=1e-9)


def test_slots_of_a_code_become_channels_in_the_order_sent(radar):
    frame = coded(radar, Bpm(order=(2, 0, 1)), n_chirps=3).frame
    tag = np.array([0, 1, 2, 3] * 3)[:, None] * 10 + np.arange(2)
    samples = np.broadcast_to(tag[..., None], (12, 2, 5)).copy()

    parted = split_slots(samples, frame)

    assert parted[2, :, 4].tolist() == [0, 1, 10, 11, 20, 21, 30, 31]
    assert np.shares_memory(parted, samples)


def seen_in_noise(radar, *, range_m, velocity_m_per_s, snr):
    """Cube of a tone of unit power from each transmitter, at phases of its own, in noise."""
    chirp, n_tx = radar.frame.chirp, len(radar.array.tx_m)
    phases = np.random.default_rng(72).uniform(0, 2 * pi, (n_tx, radar.array.n_rx, 1))
    turned = np.arange(chirp.n_samples) * 2 * pi / chirp.sample_rate_hz
    tone = np.exp(1j * (phases + turned * chirp.beat_frequency_hz(range_m)))
    samples = slow_time(radar.frame, velocity_m_per_s=velocity_m_per_s, echoes=tone)
    samples = samples.astype(np.complex64)
    add_white_noise(samples, 1 / snr, np.random.default_rng(73))
    return label_cube(samples[None], radar, units="sqrt(W)")


@pytest.mark.parametrize("code", TOGETHER, ids=str)
def test_a_target_is_found_by_what_all_transmitters_send_together(radar, code):
    radar = coded(radar, code, n_chirps=64)
    frame, chirp = radar.frame, radar.frame.chirp
    range_m, velocity, snr = 20.0, 0.6 * frame.max_velocity_m_per_s, 10**-2.5

    cube = seen_in_noise(radar, range_m=range_m, velocity_m_per_s=velocity, snr=snr)
    found = dc.detect(cube, radar)

    assert found.sizes["detection"] == 1
    # The tone's velocity does not move its range, which `detect` corrects for at mid-frame.
    coupled_m = range_m - chirp.range_doppler_coupling_m(velocity)
    assert abs(found.range.item() - coupled_m) < 5 * found.range_std.item()
    assert abs(found.velocity.item() - velocity) < 5 * found.velocity_std.item()
    # The noise level comes from 320 cells of the map, the SNR itself scatters by 0.1 dB.
    gained_db = to_decibels(found.snr.item() / snr)
    assert gained_db == pytest.approx(to_decibels(radar.integration_gain), abs=1)


@pytest.mark.parametrize("code", [Bpm(order=(0, 2, 1)), Ddma(order=(0, 1), n_sub_bands=3)], ids=str)
def test_false_alarms_come_as_designed_where_slots_outnumber_transmitters(radar, code):
    radar = coded(radar, code, n_chirps=32, n_samples=64)
    assert radar.n_summed_maps > radar.n_channels
    hits, trials = alarms(radar, np.random.default_rng(74), n_frames=150)

    # 307 alarms, binomial but for the training cells that neighbours share: five standard
    # errors of 6 %. Thresholds for n_channels maps would let a quarter or less of them pass.
    low, high = binom.interval(1 - 1e-6, trials, 1e-3)
    assert low <= hits <= high


def test_transmitters_that_send_together_gather_more_energy_than_in_turns(radar):
    def gain(code):
        return coded(radar, code).integration_gain

    assert gain(Tdm(order=(1, 0))) == 256 * 128 * 2 * 2
    assert gain(Bpm(order=(0, 1))) == 2 * gain(Tdm(order=(0, 1)))
    assert gain(Bpm(order=(0, 1, 2))) == 4 * gain(Tdm(order=(0, 1, 2)))
    assert gain(Ddma(order=(0, 1), n_sub_bands=6)) == 6 * gain(Tdm(order=(0, 1)))
    assert gain(PhaseCode(phases_rad=[[0, 0, 0]])) == gain(Tdm(order=(0, 1, 2)))


def test_velocities_are_those_of_the_rounds(radar):
    frame = coded(radar, Ddma(order=(0, 1), n_sub_bands=6)).frame

    assert frame.max_velocity_m_per_s == pytest.approx(radar.frame.max_velocity_m_per_s / 6)
    assert frame.duration_s == pytest.approx(6 * radar.frame.duration_s)


def test_no_single_transmitter_is_named_where_several_send_in_a_chirp(radar):
    for code in TOGETHER:
        made = coded(radar, code, n_chirps=2)
        samples = np.zeros((1, made.frame.n_chirps_total, 2, 256), np.complex64)
        assert made.frame.tdm_order is None
        assert "transmitter" not in label_cube(samples, made, units="sqrt(W)").coords


@pytest.mark.parametrize("member", [Tdm, Bpm, Ddma])
@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ((0, 0), "every transmitter once"),
        ((), "at least one transmitter"),
        ("01", "at least one transmitter"),
        ((0, 1.0), "a whole number from 0 to 255"),
        ((0, 2**31 - 1), "a whole number from 0 to 255"),
    ],
)
def test_an_order_that_cannot_be_is_refused(member, order, expected):
    others = {"n_sub_bands": 4} if member is Ddma else {}
    with pytest.raises(InvalidSetting, match=f"{member.__name__}.order: .*{expected}"):
        member(order=order, **others)


@pytest.mark.parametrize("wrong", [2, 0, 3.0, 5000, None])
def test_sub_bands_must_be_enough_for_all_transmitters(wrong):
    with pytest.raises(InvalidSetting, match=r"Ddma\.n_sub_bands: "):
        Ddma(order=(0, 1, 2), n_sub_bands=wrong)


@pytest.mark.parametrize(
    ("phases", "named", "told"),
    [
        ([[0, 0], [0], [0, 0]], ".1", "a row of 1 phases; expected of 2 as the first row"),
        ([[0, 0], [0, 0, 0]], ".1", "a row of 3 phases; expected of 2"),
        ([[0, 0], [0, float("nan")]], ".1", "nan; expected one finite number"),
        ([[0, 1j]], ".0", "expected one finite number"),
        ([["0", 0]], ".0", "expected one finite number"),
        ([[], []], ".0", "a list of phases, one for each transmitter"),
        ([0, 1], ".0", "a list of phases, one for each transmitter"),
        ([], "", "at least one row"),
        ([[0, 1e9]], ".0", "at most 1e[+]06 rad"),
        (None, "", "at least one row"),
        (np.array(0.0), "", "at least one row"),
        ("00", "", "at least one row"),
    ],
)
def test_a_table_of_phases_that_is_none_is_refused_with_its_row(phases, named, told):
    with pytest.raises(InvalidSetting, match=rf"PhaseCode\.phases_rad{named}: .*{told}"):
        PhaseCode(phases_rad=phases)


@pytest.mark.parametrize(
    ("code", "n_tx", "told"),
    [
        (Bpm(order=(0, 1)), 3, "2 transmitter.*: 0, 1; expected the 3 in array.tx"),
        (Ddma(order=(0, 2), n_sub_bands=4), 2, "2 transmitters: 0, 2; .* the 2 in array.tx"),
        (PhaseCode(phases_rad=[[0, 0, 0]]), 2, "3 transmitters: 0, 1, 2; .* the 2 in array.tx"),
        (PhaseCode(phases_rad=[[0]]), 2, "1 transmitter.*: 0; expected the 2 in array.tx"),
    ],
)
def test_a_code_for_another_number_of_transmitters_is_refused(radar, code, n_tx, told):
    array = replace(radar.array, tx_m=[(0, 0.008 * k, 0) for k in range(n_tx)])

    with pytest.raises(InvalidSetting, match=rf"Radar\.frame\.multiplexing: {told}"):
        replace(radar, frame=replace(radar.frame, multiplexing=code), array=array)


def test_elements_at_one_place_are_named_by_kind_and_number():
    apart = Array(tx_m=[(0, 0, 0), (0, 1e-3, 0)], rx_m=[(0, 0, 0), (0, 2e-3, 0)])
    assert apart.find_coincident_elements() == ()
    assert Array().find_coincident_elements() == ()
    double = Array(tx_m=[(0, 0, 0), (0, 0, 0)], rx_m=[(0, 0, 1), (0, 1, 0), (0, 0, 1 + 1e-9)])
    assert double.find_coincident_elements() == (("tx", 0, 1), ("rx", 0, 2))
