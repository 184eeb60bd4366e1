"""Simultaneous multiplexing (BPM, DDMA, phase codes): codes, slots and detection."""

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
from dechirp.processing.virtual_array import split_chirps_into_slots
from dechirp.radar.array import Array
from dechirp.radar.cube import label_cube
from dechirp.radar.multiplexing.bpm import Bpm
from dechirp.radar.multiplexing.ddma import Ddma
from dechirp.radar.multiplexing.phase_code import PhaseCode
from dechirp.radar.multiplexing.tdm import Tdm
from nightly import nightly, nightly_except
from noise_cubes import count_false_alarms

ORDERS = st.integers(1, 6).flatmap(lambda n: st.permutations(range(n)))
SIMULTANEOUS_CODES = [
    Bpm(order=(1, 0)),
    Bpm(order=(2, 0, 1)),
    Ddma(order=(0, 1), n_sub_bands=3),
    Ddma(order=(2, 0, 1), n_sub_bands=4),
    PhaseCode(phases_rad=[[0, 0], [pi / 2, -pi / 2]]),
    PhaseCode(phases_rad=[[0, None, 0], [None, 0, None], [0, None, pi]]),
]


def build_coded_radar(radar, multiplexing, *, n_chirps=None, n_samples=None):
    """Build the radar with transmitters two wavelengths apart and this multiplexing."""
    chirp = replace(radar.frame.chirp, n_samples=n_samples or radar.frame.chirp.n_samples)
    frame = replace(
        radar.frame,
        chirp=chirp,
        n_chirps=n_chirps or radar.frame.n_chirps,
        multiplexing=multiplexing,
    )
    tx_m = [(0, 0.0078 * k, 0) for k in range(multiplexing.n_tx)]
    return replace(radar, frame=frame, array=replace(radar.array, tx_m=tx_m))


def simulate_slow_time(frame, *, velocity_m_per_s, echoes):
    """Simulate the chirps (chirp, ...) that receivers get from target echoes (tx, ...)."""
    chirps = np.arange(frame.n_chirps_total)
    phases_rad = 4 * pi * velocity_m_per_s / frame.chirp.wavelength_m * chirps * frame.interval_s
    weights = frame.chirp_weights() * np.exp(1j * phases_rad)[:, None]
    return np.tensordot(weights, echoes, axes=1)


def draw_random_echoes(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@given(order=ORDERS, empty=st.integers(0, 3))
def test_transmitter_codes_are_orthogonal_over_a_round(order, empty):
    n_tx = len(order)
    codes = [Tdm(order=order), Bpm(order=order), Ddma(order=order, n_sub_bands=n_tx + empty)]
    for code in codes:
        weights = np.array(code.weights)
        n_transmissions = [sum(k in slot for slot in code.slot_transmitters) for k in range(n_tx)]

        assert (
            weights.shape
            == (len(code.slot_transmitters), n_tx)
            == (len(code.slot_transmitters), code.n_tx)
        )
        assert abs(weights[weights != 0]) == pytest.approx(1)
        np.testing.assert_allclose(
            weights.conj().T @ weights, np.diag(n_transmissions), rtol=0, atol=1e-13
        )


@pytest.mark.parametrize("n_tx", [1, 2, 3, 4, 5, 8, 12])
def test_bpm_weights_are_rows_of_smallest_sufficient_hadamard_matrix(n_tx):
    order = np.random.default_rng(n_tx).permutation(n_tx)
    weights = np.array(Bpm(order=order).weights)
    size = 1 << (n_tx - 1).bit_length()

    assert weights.shape == (size, n_tx)
    np.testing.assert_array_equal(weights[:, order], hadamard(size)[:n_tx].T)


def test_bpm_of_two_transmitters_sends_sum_then_difference():
    assert Bpm(order=(0, 1)).weights == ((1, 1), (1, -1))
    assert Bpm(order=(1, 0)).weights == ((1, 1), (-1, 1))


@pytest.mark.parametrize(("order", "n_sub_bands"), [((0, 1), 2), ((2, 0, 1), 4), ((1, 3, 0, 2), 6)])
def test_ddma_shifts_each_transmitter_by_its_sub_band(radar, order, n_sub_bands):
    frame = build_coded_radar(radar, Ddma(order=order, n_sub_bands=n_sub_bands), n_chirps=16).frame
    velocity = 3 * frame.velocity_resolution_m_per_s  # receding, on a bin
    doppler_hz = 2 * velocity / frame.chirp.wavelength_m
    frequencies_hz = np.fft.fftfreq(frame.n_chirps_total, frame.interval_s)
    for k, transmitter in enumerate(order):
        echoes = np.zeros(len(order))
        echoes[transmitter] = 1
        spectrum = np.fft.fft(simulate_slow_time(frame, velocity_m_per_s=velocity, echoes=echoes))

        shifted_hz = doppler_hz + k / (n_sub_bands * frame.interval_s)
        span_hz = 1 / frame.interval_s
        peak_hz = frequencies_hz[np.argmax(abs(spectrum))]
        error_hz = (peak_hz - shifted_hz + span_hz / 2) % span_hz - span_hz / 2
        assert error_hz == pytest.approx(0, abs=1e-6 / frame.duration_s)
        assert abs(spectrum).max() == pytest.approx(frame.n_chirps_total)


def test_surplus_sub_bands_stay_empty(radar):
    frame = build_coded_radar(radar, Ddma(order=(2, 0, 1), n_sub_bands=5), n_chirps=16).frame
    velocity = 3 * frame.velocity_resolution_m_per_s
    spectrum = np.fft.fft(
        simulate_slow_time(frame, velocity_m_per_s=velocity, echoes=np.array([3, 1, 2]))
    )
    bands = abs(spectrum.reshape(5, 16)[:, 3]) / frame.n_chirps_total

    np.testing.assert_allclose(bands, [2, 3, 1, 0, 0], atol=1e-12)


def test_phase_code_reproduces_ddma_and_bpm():
    phases_rad = [[0, 2 * pi * slot / 4] for slot in range(4)]
    ddma = np.array(Ddma(order=(0, 1), n_sub_bands=4).weights)

    np.testing.assert_allclose(PhaseCode(phases_rad=phases_rad).weights, ddma, atol=1e-15)
    signs = PhaseCode(phases_rad=np.array([[0, 0], [0, pi]])).weights
    np.testing.assert_allclose(signs, Bpm(order=(0, 1)).weights, atol=1e-15)


def test_code_repeats_in_each_round(radar):
    for code in SIMULTANEOUS_CODES:
        frame = build_coded_radar(radar, code, n_chirps=3).frame
        assert frame.n_chirps_total == 3 * frame.n_slots == 3 * len(code.weights)
        np.testing.assert_array_equal(frame.chirp_weights(), code.weights * 3)
        assert frame.repetition_s == pytest.approx(frame.n_slots * frame.interval_s)


def test_code_of_frame_length_is_one_round(radar):
    phases = np.random.default_rng(71).uniform(-pi, pi, (48, 2))
    frame = build_coded_radar(radar, PhaseCode(phases_rad=phases), n_chirps=1).frame

    assert (frame.n_slots, frame.n_chirps_total) == (48, 48)
    np.testing.assert_allclose(frame.chirp_weights(), np.exp(1j * phases), atol=1e-15)
    assert frame.duration_s == pytest.approx(48 * 35e-6)


def test_code_of_frame_length_measures_range_without_velocity(radar):
    phases = np.random.default_rng(71).uniform(-pi, pi, (48, 2))
    radar = build_coded_radar(radar, PhaseCode(phases_rad=phases), n_chirps=1)
    detections = dc.detect(
        simulate_noisy_target(radar, range_m=20.0, velocity_m_per_s=1.0, snr=0.01), radar
    )

    assert detections.sizes["detection"] == 1
    assert abs(detections.range.item() - 20.0) < 5 * detections.range_std.item()
    assert np.isnan(detections.velocity.item())


def test_single_transmitter_sends_in_every_chirp(radar):
    assert radar.frame.weights == ((1,),)
    assert (radar.frame.chirp_weights() == np.ones((128, 1))).all()
    assert radar.n_summed_maps == radar.array.n_rx


@given(
    order=ORDERS,
    empty=st.integers(0, 2),
    seed=st.integers(0, 2**32 - 1),
    velocity_bin=st.integers(-4, 3),
)
def test_slot_powers_sum_to_power_of_all_echoes(radar, order, empty, seed, velocity_bin):
    rng = np.random.default_rng(seed)
    for code in (Bpm(order=order), Ddma(order=order, n_sub_bands=len(order) + empty)):
        frame = build_coded_radar(radar, code, n_chirps=8).frame
        echoes = draw_random_echoes(rng, len(order), 2, 5)  # tx, rx, sample
        velocity = velocity_bin * frame.velocity_resolution_m_per_s
        channels = split_chirps_into_slots(
            simulate_slow_time(frame, velocity_m_per_s=velocity, echoes=echoes), frame
        )

        assert channels.shape == (8, frame.n_slots * 2, 5)
        spectrum = np.fft.fft(channels, axis=0)[velocity_bin]
        for receiver in range(2):
            slot_power = (abs(spectrum[receiver::2]) ** 2).sum(axis=0)
            echo_power = (abs(echoes[:, receiver]) ** 2).sum(axis=0)
            np.testing.assert_allclose(slot_power, 8**2 * frame.n_slots * echo_power, rtol=1e-9)


def test_code_slots_become_channels_in_transmit_order(radar):
    frame = build_coded_radar(radar, Bpm(order=(2, 0, 1)), n_chirps=3).frame
    tag = np.array([0, 1, 2, 3] * 3)[:, None] * 10 + np.arange(2)
    samples = np.broadcast_to(tag[..., None], (12, 2, 5)).copy()

    channels = split_chirps_into_slots(samples, frame)

    assert channels[2, :, 4].tolist() == [0, 1, 10, 11, 20, 21, 30, 31]
    assert np.shares_memory(channels, samples)


def simulate_noisy_target(radar, *, range_m, velocity_m_per_s, snr):
    """Simulate a cube with a tone of unit power and random phase per transmitter, in noise."""
    chirp, n_tx = radar.frame.chirp, len(radar.array.tx_m)
    phases = np.random.default_rng(72).uniform(0, 2 * pi, (n_tx, radar.array.n_rx, 1))
    phase_per_hz = np.arange(chirp.n_samples) * 2 * pi / chirp.sample_rate_hz
    tone = np.exp(1j * (phases + phase_per_hz * chirp.beat_frequency_hz(range_m)))
    samples = simulate_slow_time(radar.frame, velocity_m_per_s=velocity_m_per_s, echoes=tone)
    samples = samples.astype(np.complex64)
    add_white_noise(samples, 1 / snr, np.random.default_rng(73))
    return label_cube(samples[None], radar, units="W**0.5")


@pytest.mark.parametrize(
    "code", nightly_except(SIMULTANEOUS_CODES[1::2], SIMULTANEOUS_CODES), ids=str
)
def test_detects_target_with_simultaneous_transmitters(radar, code):
    radar = build_coded_radar(radar, code, n_chirps=64)
    frame, chirp = radar.frame, radar.frame.chirp
    range_m, velocity, snr = 20.0, 0.6 * frame.max_velocity_m_per_s, 10**-2.5

    cube = simulate_noisy_target(radar, range_m=range_m, velocity_m_per_s=velocity, snr=snr)
    detections = dc.detect(cube, radar)

    assert detections.sizes["detection"] == 1
    # The tone has no range walk, for which `detect` corrects at mid-frame.
    coupled_m = range_m - chirp.range_doppler_coupling_m(velocity)
    assert abs(detections.range.item() - coupled_m) < 5 * detections.range_std.item()
    assert abs(detections.velocity.item() - velocity) < 5 * detections.velocity_std.item()
    # The noise level comes from 320 cells of the map, the SNR itself scatters by 0.1 dB.
    gain_db = to_decibels(detections.snr.item() / snr)
    assert gain_db == pytest.approx(to_decibels(radar.integration_gain), abs=1)


@nightly
@pytest.mark.parametrize("code", [Bpm(order=(0, 2, 1)), Ddma(order=(0, 1), n_sub_bands=3)], ids=str)
def test_false_alarm_rate_matches_design_with_more_slots_than_transmitters(radar, code):
    radar = build_coded_radar(radar, code, n_chirps=32, n_samples=64)
    assert radar.n_summed_maps > radar.n_channels
    hits, trials = count_false_alarms(radar, np.random.default_rng(74), n_frames=150)

    # 307 alarms, binomial except for training cells shared by neighbours: five standard errors
    # of 6 %. Thresholds for n_channels maps would pass a quarter of them or less.
    low, high = binom.interval(1 - 1e-6, trials, 1e-3)
    assert low <= hits <= high


def test_simultaneous_codes_integrate_more_energy_than_tdm(radar):
    def compute_gain(code):
        return build_coded_radar(radar, code).integration_gain

    assert compute_gain(Tdm(order=(1, 0))) == 256 * 128 * 2 * 2
    assert compute_gain(Bpm(order=(0, 1))) == 2 * compute_gain(Tdm(order=(0, 1)))
    assert compute_gain(Bpm(order=(0, 1, 2))) == 4 * compute_gain(Tdm(order=(0, 1, 2)))
    assert compute_gain(Ddma(order=(0, 1), n_sub_bands=6)) == 6 * compute_gain(Tdm(order=(0, 1)))
    assert compute_gain(PhaseCode(phases_rad=[[0, 0, 0]])) == compute_gain(Tdm(order=(0, 1, 2)))


def test_velocity_span_and_duration_follow_rounds(radar):
    frame = build_coded_radar(radar, Ddma(order=(0, 1), n_sub_bands=6)).frame

    assert frame.max_velocity_m_per_s == pytest.approx(radar.frame.max_velocity_m_per_s / 6)
    assert frame.duration_s == pytest.approx(6 * radar.frame.duration_s)


def test_simultaneous_codes_have_no_transmitter_label(radar):
    for code in SIMULTANEOUS_CODES:
        coded_radar = build_coded_radar(radar, code, n_chirps=2)
        samples = np.zeros((1, coded_radar.frame.n_chirps_total, 2, 256), np.complex64)
        assert coded_radar.frame.tdm_order is None
        assert "transmitter" not in label_cube(samples, coded_radar, units="W**0.5").coords


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
def test_rejects_invalid_transmitter_order(member, order, expected):
    options = {"n_sub_bands": 4} if member is Ddma else {}
    with pytest.raises(InvalidSetting, match=f"{member.__name__}.order: .*{expected}"):
        member(order=order, **options)


@pytest.mark.parametrize("n_sub_bands", [2, 0, 3.0, 5000, None])
def test_rejects_invalid_number_of_sub_bands(n_sub_bands):
    with pytest.raises(InvalidSetting, match=r"Ddma\.n_sub_bands: "):
        Ddma(order=(0, 1, 2), n_sub_bands=n_sub_bands)


@pytest.mark.parametrize(
    ("phases", "row", "message"),
    [
        ([[0, 0], [0], [0, 0]], ".1", "a row of 1 phases; expected 2 phases, one for each"),
        ([[0, 0], [0, 0, 0]], ".1", "a row of 3 phases; expected 2"),
        ([[0, 0], [0, float("nan")]], ".1", "nan; expected one finite number"),
        ([[0, 1j]], ".0", "expected one finite number"),
        ([["0", 0]], ".0", "expected one finite number"),
        ([[], []], ".0", "a list of phases, one for each transmitter"),
        ([0, 1], ".0", "a list of phases, one for each transmitter"),
        ([], "", "at least one row"),
        ([[0, 1e9]], ".0", "at most 1e[+]06 rad"),
        ([[0, 0], [None, None]], ".1", "a row without a phase"),
        ([[0, None], [0, None]], "", "no phase of transmitter 1"),
        (None, "", "at least one row"),
        (np.array(0.0), "", "at least one row"),
        ("00", "", "at least one row"),
    ],
)
def test_rejects_invalid_phase_table_with_its_row(phases, row, message):
    with pytest.raises(InvalidSetting, match=rf"PhaseCode\.phases_rad{row}: .*{message}"):
        PhaseCode(phases_rad=phases)


@pytest.mark.parametrize(
    ("code", "n_tx", "message"),
    [
        (Bpm(order=(0, 1)), 3, "2 transmitter.*: 0, 1; expected the 3 in array.tx"),
        (Ddma(order=(0, 2), n_sub_bands=4), 2, "2 transmitters: 0, 2; .* the 2 in array.tx"),
        (PhaseCode(phases_rad=[[0, 0, 0]]), 2, "3 transmitters: 0, 1, 2; .* the 2 in array.tx"),
        (PhaseCode(phases_rad=[[0]]), 2, "1 transmitter.*: 0; expected the 2 in array.tx"),
    ],
)
def test_rejects_code_with_wrong_number_of_transmitters(radar, code, n_tx, message):
    array = replace(radar.array, tx_m=[(0, 0.008 * k, 0) for k in range(n_tx)])

    with pytest.raises(InvalidSetting, match=rf"Radar\.frame\.multiplexing: {message}"):
        replace(radar, frame=replace(radar.frame, multiplexing=code), array=array)


def test_coincident_elements_are_listed_by_kind_and_index():
    separate_array = Array(tx_m=[(0, 0, 0), (0, 1e-3, 0)], rx_m=[(0, 0, 0), (0, 2e-3, 0)])
    assert separate_array.find_coincident_elements() == ()
    assert Array().find_coincident_elements() == ()
    coincident_array = Array(
        tx_m=[(0, 0, 0), (0, 0, 0)], rx_m=[(0, 0, 1), (0, 1, 0), (0, 0, 1 + 1e-9)]
    )
    assert coincident_array.find_coincident_elements() == (("tx", 0, 1), ("rx", 0, 2))
