"""What follows from a chirp and a frame, on the reference scenario.

77 GHz, 150 MHz in 7.3333 us, 300 MS/s complex, 2200 samples, 128 chirps back to back.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dechirp.core.errors import InvalidSetting
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.hardware import Hardware
from dechirp.radar.multiplexing.tdm import Tdm
from dechirp.radar.radar import Radar
from radars import REFERENCE_FRAME

FRAME, CHIRP = REFERENCE_FRAME, REFERENCE_FRAME.chirp
HARDWARE = Hardware(transmit_power_w=0.016, antenna_gain=100.0, noise_factor=16.0)
# A chirp as chips send it: 6 us of ramp before the samples, 2.8 us after.
EASED = Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    adc_start_s=6e-6,
    ramp_duration_s=60e-6,
    sample_rate_hz=10e6,
    n_samples=512,
    sampling="complex",
)


def test_a_target_at_50_m_beats_at_6_8_megahertz():
    # 2 x 20.4545 MHz/us x 50 m / c; 50.077 bins of 136.4 kHz with c exact.
    assert CHIRP.beat_frequency_hz(50.0) == pytest.approx(6.8229e6, rel=1e-4)
    assert 50.0 / CHIRP.range_resolution_m == pytest.approx(50.035, abs=1e-3)


@given(range_m=st.floats(0.0, 1e5))
def test_the_range_of_the_beat_frequency_of_a_range_is_that_range(range_m):
    assert CHIRP.range_m(CHIRP.beat_frequency_hz(range_m)) == pytest.approx(range_m, rel=1e-14)


def test_a_receding_target_seems_farther_by_the_coupling():
    assert CHIRP.range_doppler_coupling_m(10.0) == pytest.approx(0.0377, abs=5e-5)
    assert CHIRP.range_doppler_coupling_m(-10.0) == -CHIRP.range_doppler_coupling_m(10.0)


def test_the_coupling_is_the_doppler_frequency_read_as_a_range():
    doppler_hz = 2 * 10.0 / CHIRP.wavelength_m

    assert CHIRP.range_m(doppler_hz) == pytest.approx(CHIRP.range_doppler_coupling_m(10.0))


def test_complex_samples_see_the_whole_band_and_real_ones_half_of_it():
    real = replace(CHIRP, sampling="real")

    assert CHIRP.max_range_m == pytest.approx(2198.5, abs=0.1)
    assert real.max_range_m == pytest.approx(CHIRP.max_range_m / 2)


def test_velocity_is_read_at_the_middle_of_the_band():
    assert FRAME.velocity_resolution_m_per_s == pytest.approx(2.0719, abs=1e-4)
    assert FRAME.max_velocity_m_per_s == pytest.approx(132.6, abs=0.05)
    # At the start of the ramp both would be B / 2 f0 = 0.097 % larger.
    at_start = 299_792_458.0 / 77e9 / (2 * FRAME.duration_s)
    assert at_start / FRAME.velocity_resolution_m_per_s == pytest.approx(1 + 75e6 / 77e9)


def test_only_the_bandwidth_swept_while_sampling_resolves_range():
    assert EASED.sampled_bandwidth_hz == pytest.approx(30e12 * 51.2e-6)
    assert EASED.ramp_bandwidth_hz == pytest.approx(1.8e9)
    assert EASED.range_resolution_m == pytest.approx(299_792_458.0 / (2 * 1.536e9))


def test_the_wavelength_is_that_at_the_middle_of_the_samples_not_of_the_ramp():
    middle_hz = 77e9 + 30e12 * (6e-6 + 25.6e-6)

    assert EASED.mid_window_frequency_hz == pytest.approx(middle_hz)
    assert EASED.wavelength_m == pytest.approx(299_792_458.0 / middle_hz)


def test_the_middle_of_the_window_is_the_mean_sampling_instant():
    # Of 512 samples at 0.1 us the mean is 25.55 us after the first.
    assert EASED.mid_window_s == pytest.approx(31.55e-6)


def test_the_middle_of_the_frame_is_the_mean_of_all_sampling_instants():
    # 63.5 intervals to the middle chirp, and 1099.5 samples into it.
    assert FRAME.mid_frame_s == pytest.approx(63.5 * 22e-6 / 3 + 1099.5 / 300e6)


def test_transmitters_in_turns_share_the_chirps_and_the_velocities():
    turns = replace(FRAME, multiplexing=Tdm(order=(1, 2, 0)))

    assert (turns.n_slots, turns.n_chirps_total) == (3, 384)
    assert turns.repetition_s == pytest.approx(22e-6)
    assert turns.duration_s == pytest.approx(3 * FRAME.duration_s)
    assert turns.frame_start_s(2) == pytest.approx(6 * FRAME.duration_s)
    assert turns.max_velocity_m_per_s == pytest.approx(FRAME.max_velocity_m_per_s / 3)
    assert turns.velocity_resolution_m_per_s == pytest.approx(FRAME.velocity_resolution_m_per_s / 3)
    assert turns.velocity_bins_m_per_s() == pytest.approx(FRAME.velocity_bins_m_per_s() / 3)
    # 191.5 intervals to the middle of 384 chirps.
    assert turns.mid_frame_s == pytest.approx(191.5 * 22e-6 / 3 + 1099.5 / 300e6)


def test_a_frame_without_multiplexing_is_one_transmitter_in_every_chirp():
    assert (FRAME.n_slots, FRAME.n_chirps_total, FRAME.repetition_s) == (1, 128, FRAME.interval_s)
    assert replace(FRAME, multiplexing=Tdm(order=(0,))).n_chirps_total == 128


def test_one_chirp_is_a_frame_with_one_velocity_bin():
    snapshot = replace(FRAME, n_chirps=1)

    assert snapshot.duration_s == FRAME.interval_s
    assert snapshot.mid_frame_s == CHIRP.mid_window_s
    assert snapshot.velocity_bins_m_per_s().tolist() == [0]


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ((0, 0), "every transmitter once"),
        ((0, 1, 0), "every transmitter once"),
        ((), "at least one transmitter"),
        ("01", "at least one transmitter"),
        (0, "at least one transmitter"),
        (None, "at least one transmitter"),
        ((0, -1), "a whole number from 0"),
        ((0, 1.0), "a whole number from 0"),
        ((0, True), "a whole number from 0"),
    ],
)
def test_an_order_of_turns_that_cannot_be_is_refused(order, expected):
    with pytest.raises(InvalidSetting, match=f"Tdm.order: .*{expected}"):
        Tdm(order=order)


def test_an_order_may_be_any_collection_of_numbers():
    assert Tdm(order=np.array([1, 0])) == Tdm(order=[1, 0]) == Tdm(order=(1, 0))


@pytest.mark.parametrize("wrong", ["tdm", (0, 1), Tdm])
def test_multiplexing_that_is_none_of_the_family_is_refused(wrong):
    with pytest.raises(InvalidSetting, match=r"Frame\.multiplexing: .*give Tdm"):
        replace(FRAME, multiplexing=wrong)


@pytest.mark.parametrize(
    ("order", "n_tx", "told"),
    [
        (None, 2, r"none, with 2 transmitters.*kind tdm with order \[0, 1\], or keep one"),
        ((0, 1), 1, r"2 transmitters: 0, 1; .* the 1 in array.tx: 0;"),
        ((0, 1), 3, r"2 transmitters: 0, 1; .* the 3 in array.tx: 0, 1, 2;"),
        ((0, 2), 2, r"2 transmitters: 0, 2; .* the 2 in array.tx: 0, 1;"),
    ],
)
def test_a_radar_whose_transmitters_do_not_all_take_their_turn_is_refused(order, n_tx, told):
    frame = replace(FRAME, multiplexing=None if order is None else Tdm(order=order))
    array = Array(tx_m=[(0, 0.008 * k, 0) for k in range(n_tx)])

    with pytest.raises(InvalidSetting, match=rf"Radar\.frame\.multiplexing: {told}"):
        Radar(frame=frame, array=array)


def test_the_reference_frame_lasts_0_94_ms():
    assert FRAME.duration_s == pytest.approx(0.939e-3, abs=0.5e-6)


def test_frames_follow_without_a_gap_unless_a_period_is_given():
    assert FRAME.frame_start_s(3) == pytest.approx(3 * FRAME.duration_s)
    assert replace(FRAME, period_s=0.05).frame_start_s(3) == pytest.approx(0.15)


NUMBERS = ["start_frequency_hz", "slope_hz_per_s", "ramp_duration_s", "sample_rate_hz"]


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf"), "1", True])
@pytest.mark.parametrize("field", NUMBERS)
def test_a_chirp_of_numbers_that_cannot_be_is_refused(field, wrong):
    with pytest.raises(InvalidSetting, match=f"Chirp.{field}"):
        replace(CHIRP, **{field: wrong})


# Units that were mistaken: 77 GHz given in GHz, 20 MHz/us in MHz/us, ms for s, and worse.
ABSURD = [
    (CHIRP, "start_frequency_hz", 77.0, r"1e\+06 to 1e\+13"),
    (CHIRP, "start_frequency_hz", 7.7e19, r"1e\+06 to 1e\+13"),
    (CHIRP, "slope_hz_per_s", 0.5, r"1 to 1e\+18"),
    (CHIRP, "slope_hz_per_s", 1e19, r"1 to 1e\+18"),
    (CHIRP, "ramp_duration_s", 1e7, r"1e-12 to 1e\+06"),
    (CHIRP, "sample_rate_hz", 0.5, r"1 to 1e\+13"),
    (CHIRP, "sample_rate_hz", 1e14, r"1 to 1e\+13"),
    (CHIRP, "adc_start_s", 1e200, r"0 to 1e\+06"),
    (FRAME, "interval_s", 1e7, r"1e-12 to 1e\+06"),
    (FRAME, "period_s", 1e7, r"1e-12 to 1e\+06"),
    (HARDWARE, "transmit_power_w", 1e-16, r"1e-15 to 1e\+12"),
    (HARDWARE, "transmit_power_w", 1e13, r"1e-15 to 1e\+12"),
    (HARDWARE, "antenna_gain", 1e-7, r"1e-06 to 1e\+12"),
    (HARDWARE, "antenna_gain", 1e13, r"1e-06 to 1e\+12"),
    (HARDWARE, "noise_factor", 1e13, r"1 to 1e\+12"),
    (HARDWARE, "loss", 1e13, r"1 to 1e\+12"),
    (Array(), "rx_m", [[0, 1e7, 0]], r"-1e\+06 to 1e\+06"),
]


@pytest.mark.parametrize(("owner", "field", "wrong", "bounds"), ABSURD)
def test_a_number_that_no_radar_has_is_refused_with_the_bounds(owner, field, wrong, bounds):
    where = f"{type(owner).__name__}.{field}"
    with pytest.raises(InvalidSetting, match=f"{where}: .*a number from {bounds}; check the unit"):
        replace(owner, **{field: wrong})


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), float("inf"), "1", True])
def test_a_period_that_cannot_be_is_refused(wrong):
    with pytest.raises(InvalidSetting, match=r"Frame\.period_s"):
        replace(FRAME, period_s=wrong)


@pytest.mark.parametrize("wrong", [-1, 0, 1, 2.5, float("nan"), True, 10**12])
def test_counts_that_are_none_are_refused(wrong):
    with pytest.raises(InvalidSetting, match=r"Chirp\.n_samples"):
        replace(CHIRP, n_samples=wrong)
    if wrong != 1 or wrong is True:  # one chirp is a snapshot
        with pytest.raises(InvalidSetting, match=r"Frame\.n_chirps"):
            replace(FRAME, n_chirps=wrong)


def test_sampling_before_the_ramp_is_refused():
    with pytest.raises(InvalidSetting, match=r"Chirp\.adc_start_s"):
        replace(EASED, adc_start_s=-1e-6)


def test_samples_after_the_end_of_the_ramp_are_refused():
    with pytest.raises(InvalidSetting, match=r"Chirp\.ramp_duration_s: 5e-05 s"):
        replace(EASED, ramp_duration_s=50e-6)


def test_a_sampling_that_is_neither_complex_nor_real_is_refused():
    with pytest.raises(InvalidSetting, match="complex or real"):
        replace(CHIRP, sampling="iq")


def test_an_interval_shorter_than_the_ramp_is_refused():
    with pytest.raises(InvalidSetting, match="lengthen the interval"):
        replace(FRAME, interval_s=7e-6)


def test_a_period_shorter_than_its_chirps_is_refused():
    with pytest.raises(InvalidSetting, match="lengthen the period"):
        replace(FRAME, period_s=0.5e-3)


def test_axes_step_by_the_resolution_and_end_at_the_limits(radar):
    frame, chirp = radar.frame, radar.frame.chirp
    ranges, velocities = chirp.range_bins_m(), frame.velocity_bins_m_per_s()

    assert ranges[0] == 0
    assert np.diff(ranges) == pytest.approx(chirp.range_resolution_m)
    assert ranges[-1] == pytest.approx(chirp.max_range_m - chirp.range_resolution_m)
    assert np.diff(velocities) == pytest.approx(frame.velocity_resolution_m_per_s)
    assert velocities[0] == pytest.approx(-frame.max_velocity_m_per_s)
    assert velocities[frame.n_chirps // 2] == 0
    # Padding divides the steps and moves no limit.
    assert np.diff(chirp.range_bins_m(1024)) == pytest.approx(chirp.range_resolution_m / 4)
    assert frame.velocity_bins_m_per_s(512)[0] == pytest.approx(-frame.max_velocity_m_per_s)
    real = replace(chirp, sampling="real")
    assert real.range_bins_m().size == 129
    assert real.range_bins_m()[-1] == pytest.approx(real.max_range_m)
