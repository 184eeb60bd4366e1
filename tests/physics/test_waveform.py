"""Waveform: ranges, velocities, times and limits of chirps and frames.

Reference scenario: 77 GHz, 150 MHz in 7.3333 us, 300 MS/s complex, 2200 samples, 128 chirps
back to back.
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
# Chirp with margins, typical of radar chips: 6 us of ramp before the samples, 2.8 us after.
CHIRP_WITH_MARGINS = Chirp(
    start_frequency_hz=77e9,
    slope_hz_per_s=30e12,
    adc_start_s=6e-6,
    ramp_duration_s=60e-6,
    sample_rate_hz=10e6,
    n_samples=512,
    sampling="complex",
)


def test_target_at_50_m_beats_at_6_8_mhz():
    # 2 x 20.4545 MHz/us x 50 m / c; 50.077 bins of 136.4 kHz with c exact.
    assert CHIRP.beat_frequency_hz(50.0) == pytest.approx(6.8229e6, rel=1e-4)
    assert 50.0 / CHIRP.range_resolution_m == pytest.approx(50.035, abs=1e-3)


@given(range_m=st.floats(0.0, 1e5))
def test_range_is_inverse_of_beat_frequency(range_m):
    assert CHIRP.range_m(CHIRP.beat_frequency_hz(range_m)) == pytest.approx(range_m, rel=1e-14)


def test_coupling_makes_receding_target_appear_farther():
    assert CHIRP.range_doppler_coupling_m(10.0) == pytest.approx(0.0377, abs=5e-5)
    assert CHIRP.range_doppler_coupling_m(-10.0) == -CHIRP.range_doppler_coupling_m(10.0)


def test_coupling_is_doppler_frequency_converted_to_range():
    doppler_hz = 2 * 10.0 / CHIRP.wavelength_m

    assert CHIRP.range_m(doppler_hz) == pytest.approx(CHIRP.range_doppler_coupling_m(10.0))


def test_real_samples_have_half_the_max_range_of_complex_ones():
    real_chirp = replace(CHIRP, sampling="real")

    assert CHIRP.max_range_m == pytest.approx(2198.5, abs=0.1)
    assert real_chirp.max_range_m == pytest.approx(CHIRP.max_range_m / 2)


def test_velocity_axis_uses_mid_band_frequency():
    assert FRAME.velocity_resolution_m_per_s == pytest.approx(2.0719, abs=1e-4)
    assert FRAME.max_velocity_m_per_s == pytest.approx(132.6, abs=0.05)
    # At the start of the ramp both would be B / 2 f0 = 0.097 % larger.
    resolution_at_ramp_start = 299_792_458.0 / 77e9 / (2 * FRAME.duration_s)
    assert resolution_at_ramp_start / FRAME.velocity_resolution_m_per_s == pytest.approx(
        1 + 75e6 / 77e9
    )


def test_only_sampled_bandwidth_resolves_range():
    assert CHIRP_WITH_MARGINS.sampled_bandwidth_hz == pytest.approx(30e12 * 51.2e-6)
    assert CHIRP_WITH_MARGINS.ramp_bandwidth_hz == pytest.approx(1.8e9)
    assert CHIRP_WITH_MARGINS.range_resolution_m == pytest.approx(299_792_458.0 / (2 * 1.536e9))


def test_wavelength_is_at_middle_of_samples_not_of_ramp():
    middle_hz = 77e9 + 30e12 * (6e-6 + 25.6e-6)

    assert CHIRP_WITH_MARGINS.mid_window_frequency_hz == pytest.approx(middle_hz)
    assert CHIRP_WITH_MARGINS.wavelength_m == pytest.approx(299_792_458.0 / middle_hz)


def test_mid_window_is_mean_sampling_instant():
    # Mean of 512 samples at 0.1 us: 25.55 us after the first.
    assert CHIRP_WITH_MARGINS.mid_window_s == pytest.approx(31.55e-6)


def test_mid_frame_is_mean_of_all_sampling_instants():
    # 63.5 intervals to the middle chirp, and 1099.5 samples into it.
    assert FRAME.mid_frame_s == pytest.approx(63.5 * 22e-6 / 3 + 1099.5 / 300e6)


def test_tdm_transmitters_share_chirps_and_velocity_span():
    tdm_frame = replace(FRAME, multiplexing=Tdm(order=(1, 2, 0)))

    assert (tdm_frame.n_slots, tdm_frame.n_chirps_total) == (3, 384)
    assert tdm_frame.repetition_s == pytest.approx(22e-6)
    assert tdm_frame.duration_s == pytest.approx(3 * FRAME.duration_s)
    assert tdm_frame.frame_start_s(2) == pytest.approx(6 * FRAME.duration_s)
    assert tdm_frame.max_velocity_m_per_s == pytest.approx(FRAME.max_velocity_m_per_s / 3)
    assert tdm_frame.velocity_resolution_m_per_s == pytest.approx(
        FRAME.velocity_resolution_m_per_s / 3
    )
    assert tdm_frame.velocity_bins_m_per_s() == pytest.approx(FRAME.velocity_bins_m_per_s() / 3)
    # 191.5 intervals to the middle of 384 chirps.
    assert tdm_frame.mid_frame_s == pytest.approx(191.5 * 22e-6 / 3 + 1099.5 / 300e6)


def test_frame_without_multiplexing_has_one_slot():
    assert (FRAME.n_slots, FRAME.n_chirps_total, FRAME.repetition_s) == (1, 128, FRAME.interval_s)
    assert replace(FRAME, multiplexing=Tdm(order=(0,))).n_chirps_total == 128


def test_frame_of_one_chirp_has_one_velocity_bin():
    single_chirp_frame = replace(FRAME, n_chirps=1)

    assert single_chirp_frame.duration_s == FRAME.interval_s
    assert single_chirp_frame.mid_frame_s == CHIRP.mid_window_s
    assert single_chirp_frame.velocity_bins_m_per_s().tolist() == [0]


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
def test_rejects_invalid_tdm_order(order, expected):
    with pytest.raises(InvalidSetting, match=f"Tdm.order: .*{expected}"):
        Tdm(order=order)


def test_tdm_order_accepts_any_sequence():
    assert Tdm(order=np.array([1, 0])) == Tdm(order=[1, 0]) == Tdm(order=(1, 0))


@pytest.mark.parametrize("value", ["tdm", (0, 1), Tdm])
def test_rejects_multiplexing_of_wrong_type(value):
    with pytest.raises(InvalidSetting, match=r"Frame\.multiplexing: .*give Tdm"):
        replace(FRAME, multiplexing=value)


@pytest.mark.parametrize(
    ("order", "n_tx", "message"),
    [
        (None, 2, r"missing, with 2 transmitters.*kind tdm with order \[0, 1\], or keep one"),
        ((0, 1), 1, r"2 transmitters: 0, 1; .* the 1 in array.tx: 0;"),
        ((0, 1), 3, r"2 transmitters: 0, 1; .* the 3 in array.tx: 0, 1, 2;"),
        ((0, 2), 2, r"2 transmitters: 0, 2; .* the 2 in array.tx: 0, 1;"),
    ],
)
def test_rejects_tdm_order_that_does_not_match_array(order, n_tx, message):
    frame = replace(FRAME, multiplexing=None if order is None else Tdm(order=order))
    array = Array(tx_m=[(0, 0.008 * k, 0) for k in range(n_tx)])

    with pytest.raises(InvalidSetting, match=rf"Radar\.frame\.multiplexing: {message}"):
        Radar(frame=frame, array=array)


def test_reference_frame_lasts_0_94_ms():
    assert FRAME.duration_s == pytest.approx(0.939e-3, abs=0.5e-6)


def test_frames_are_contiguous_without_period():
    assert FRAME.frame_start_s(3) == pytest.approx(3 * FRAME.duration_s)
    assert replace(FRAME, period_s=0.05).frame_start_s(3) == pytest.approx(0.15)


NUMBER_FIELDS = ["start_frequency_hz", "slope_hz_per_s", "ramp_duration_s", "sample_rate_hz"]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "1", True])
@pytest.mark.parametrize("field", NUMBER_FIELDS)
def test_rejects_invalid_chirp_numbers(field, value):
    with pytest.raises(InvalidSetting, match=f"Chirp.{field}"):
        replace(CHIRP, **{field: value})


# Values with mistaken units: 77 GHz given in GHz, 20 MHz/us in MHz/us, ms for s, and others.
OUT_OF_BOUNDS = [
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


@pytest.mark.parametrize(("owner", "field", "value", "bounds"), OUT_OF_BOUNDS)
def test_rejects_number_outside_bounds(owner, field, value, bounds):
    setting = f"{type(owner).__name__}.{field}"
    with pytest.raises(
        InvalidSetting, match=f"{setting}: .*a number from {bounds}; check the unit"
    ):
        replace(owner, **{field: value})


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "1", True])
def test_rejects_invalid_period(value):
    with pytest.raises(InvalidSetting, match=r"Frame\.period_s"):
        replace(FRAME, period_s=value)


@pytest.mark.parametrize("value", [-1, 0, 1, 2.5, float("nan"), True, 10**12])
def test_rejects_invalid_counts(value):
    with pytest.raises(InvalidSetting, match=r"Chirp\.n_samples"):
        replace(CHIRP, n_samples=value)
    if value != 1 or value is True:  # one chirp is a snapshot
        with pytest.raises(InvalidSetting, match=r"Frame\.n_chirps"):
            replace(FRAME, n_chirps=value)


def test_rejects_sampling_before_ramp():
    with pytest.raises(InvalidSetting, match=r"Chirp\.adc_start_s"):
        replace(CHIRP_WITH_MARGINS, adc_start_s=-1e-6)


def test_rejects_samples_after_end_of_ramp():
    with pytest.raises(InvalidSetting, match=r"Chirp\.ramp_duration_s: 50 us"):
        replace(CHIRP_WITH_MARGINS, ramp_duration_s=50e-6)


def test_rejects_unknown_sampling():
    with pytest.raises(InvalidSetting, match="complex or real"):
        replace(CHIRP, sampling="iq")


def test_rejects_interval_shorter_than_ramp():
    with pytest.raises(InvalidSetting, match="lengthen the interval"):
        replace(FRAME, interval_s=7e-6)


def test_rejects_period_shorter_than_chirps():
    with pytest.raises(InvalidSetting, match="lengthen the period"):
        replace(FRAME, period_s=0.5e-3)


def test_axes_have_step_of_resolution_and_end_at_limits(radar):
    frame, chirp = radar.frame, radar.frame.chirp
    ranges, velocities = chirp.range_bins_m(), frame.velocity_bins_m_per_s()

    assert ranges[0] == 0
    assert np.diff(ranges) == pytest.approx(chirp.range_resolution_m)
    assert ranges[-1] == pytest.approx(chirp.max_range_m - chirp.range_resolution_m)
    assert np.diff(velocities) == pytest.approx(frame.velocity_resolution_m_per_s)
    assert velocities[0] == pytest.approx(-frame.max_velocity_m_per_s)
    assert velocities[frame.n_chirps // 2] == 0
    # Zero padding divides the steps and keeps the limits.
    assert np.diff(chirp.range_bins_m(1024)) == pytest.approx(chirp.range_resolution_m / 4)
    assert frame.velocity_bins_m_per_s(512)[0] == pytest.approx(-frame.max_velocity_m_per_s)
    real_chirp = replace(chirp, sampling="real")
    assert real_chirp.range_bins_m().size == 129
    assert real_chirp.range_bins_m()[-1] == pytest.approx(real_chirp.max_range_m)
