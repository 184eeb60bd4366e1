"""Antenna calibration: gains, positions, range offset, findings and rejected recordings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import dechirp as dc
from dechirp.processing.calibration.calibrate import CalibrationResult
from dechirp.radar.modulations.triangular import Triangular
from nightly import nightly_except
from noise_cubes import add_noise, simulate_noise_cube

GAINS = (1.0, 1.4, 0.7, 1.1)  # power gains of the receivers
PHASES = (0.0, 0.5, -0.9, -0.6)
WAVELENGTH_M = 3.87e-3
TAIL_PROBABILITY = 1e-6


def make_radar(
    code: dc.multiplexing.Tdm | dc.multiplexing.Bpm | dc.multiplexing.Ddma,
    sampling: str = "complex",
) -> dc.Radar:
    """Return a radar with two transmitters and four receivers: a uniform linear array of eight."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=16e-6,
        sample_rate_hz=10e6,
        n_samples=128,
        sampling=sampling,
    )
    half_m = WAVELENGTH_M / 2
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=32, interval_s=20e-6, multiplexing=code),
        array=dc.Array(
            tx_m=[(0, 0, 0), (0, 4 * half_m, 0)], rx_m=[(0, n * half_m, 0) for n in range(4)]
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


TDM_RADAR = make_radar(dc.multiplexing.Tdm(order=(0, 1)))
EQUAL_CHANNELS = dc.impairments.ChannelMismatch(gains=(1.0,) * 4, phases_rad=(0.0,) * 4)
MISMATCHED_CHANNELS = dc.impairments.ChannelMismatch(gains=GAINS, phases_rad=PHASES)


def simulate_reflector(
    radar: dc.Radar, azimuth_deg: float, *impairments, range_m=20.0, elevation_deg=0.0
):
    """Simulate a static corner reflector without noise."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    target = dc.Target(position_m=tuple(range_m * direction), rcs_m2=10.0)
    return dc.simulate(dc.Scene(targets=[target]), radar, impairments=impairments)


def complex_gains(calibration: dc.Calibration) -> np.ndarray:
    return np.array(calibration.gain) @ np.array([1, 1j])


def channel_gains(gains=GAINS, phases=PHASES, n_tx=2) -> np.ndarray:
    """Return the complex gain of each element, which is that of its receiver."""
    return np.tile(np.sqrt(gains) * np.exp(1j * np.array(phases)), n_tx)


def relative_gain_errors(result: CalibrationResult, channel: np.ndarray) -> np.ndarray:
    """Return the relative gain errors without the common factor."""
    product = complex_gains(result.calibration) * channel
    weight = 1 / np.array(result.gain_std) ** 2
    return product / (np.sum(weight * product) / weight.sum()) - 1


def chi_square(errors: np.ndarray, stds: np.ndarray) -> float:
    return float(np.sum(np.abs(errors) ** 2 / np.asarray(stds) ** 2))


def is_chi_square(total: float, n_free: int) -> bool:
    return bool(
        chi2.ppf(TAIL_PROBABILITY / 2, n_free) < total < chi2.isf(TAIL_PROBABILITY / 2, n_free)
    )


@pytest.mark.parametrize(
    ("radar", "snr_db"),
    nightly_except(
        2,
        [
            (TDM_RADAR, -10),
            (make_radar(dc.multiplexing.Tdm(order=(1, 0))), -10),
            (make_radar(dc.multiplexing.Bpm(order=(0, 1))), -10),
            (make_radar(dc.multiplexing.Ddma(order=(0, 1), n_sub_bands=4)), -10),
            (make_radar(dc.multiplexing.Tdm(order=(0, 1)), "real"), -10),
        ],
    ),
    ids=["tdm", "tdm reversed", "bpm", "ddma", "real samples"],
)
def test_gain_errors_match_reported_standard_errors(radar, snr_db):
    clean = simulate_reflector(radar, 25.0, MISMATCHED_CHANNELS)
    rng, total, n_free = np.random.default_rng(1), 0.0, 0

    for _ in range(12):
        cube = add_noise(clean, snr_db, rng)
        result = dc.calibrate(cube, radar, azimuth_rad=np.radians(25.0))
        total += chi_square(
            relative_gain_errors(result, channel_gains()), np.array(result.gain_std)
        )
        n_free += 2 * 7  # real and imaginary parts of eight gains, minus the common factor

    # The standard errors are neither too small nor too large.
    assert is_chi_square(total, n_free)


def test_reported_snr_matches_link_budget(radar=TDM_RADAR):
    clean = simulate_reflector(radar, -40.0, EQUAL_CHANNELS)
    results = [
        dc.calibrate(
            add_noise(clean, -10.0, np.random.default_rng(seed)), radar, azimuth_rad=-np.radians(40)
        )
        for seed in range(16)
    ]

    # -10 dB per sample and 128 x 32 samples per element: 26.1 dB. The mean of |a + w|^2 / noise is
    # one more than that; its standard deviation is the square root of twice that.
    expected = 0.1 * 128 * 32
    measured = np.array([result.snr for result in results])
    std_of_mean = np.sqrt(2 * expected / measured.size)
    assert measured.mean() == pytest.approx(expected + 1, abs=5 * std_of_mean + 0.03 * expected)


def test_position_errors_from_several_angles_match_standard_errors():
    tx = ((0, 0, 0), (0, 0.2e-3, 0))
    rx = ((0, 0.1e-3, 0), (0, -0.15e-3, 0), (0, 0, 0), (0, 0.05e-3, 0))
    position_errors = dc.impairments.PositionErrors(tx_m=tx, rx_m=rx)
    angles = (-50.0, -20.0, 5.0, 30.0, 55.0)
    clean = [
        simulate_reflector(TDM_RADAR, angle, MISMATCHED_CHANNELS, position_errors)
        for angle in angles
    ]
    truth = (np.array(tx)[:, None] + np.array(rx)).reshape(-1, 3)[:, 1]
    truth = truth - truth.mean()
    rng, gain_chi_square, position_chi_square, residuals = np.random.default_rng(2), 0.0, 0.0, []

    for _ in range(8):
        result = dc.calibrate(
            [add_noise(clean_cube, -5.0, rng) for clean_cube in clean],
            TDM_RADAR,
            azimuth_rad=np.radians(angles),
        )
        errors_m = np.array(result.calibration.position_error_m)[:, 1] - truth
        stds_m = np.array(result.position_std_m)[:, 1]
        position_chi_square += chi_square(errors_m - errors_m.mean(), stds_m)
        # Gain phases at boresight depend on the positions, and hardly on them here.
        gain_chi_square += chi_square(
            relative_gain_errors(result, channel_gains()), np.array(result.gain_std)
        )
        residuals.append(result.calibration.residual**2 * np.mean(result.snr))

    assert is_chi_square(position_chi_square, 8 * 7)
    assert is_chi_square(gain_chi_square, 8 * 14)
    # The residual is noise: the smallest of the per-recording SNRs are 0.9 of their mean.
    assert np.mean(residuals) == pytest.approx(0.95, abs=0.15)


def test_estimates_heights_from_several_elevations():
    rx = ((0, 0, 0.2e-3), (0, 0, -0.1e-3), (0, 0, 0), (0, 0, -0.1e-3))
    position_errors = dc.impairments.PositionErrors(rx_m=rx)
    directions_deg = [(-40, 0), (40, 0), (0, 25), (0, -25), (20, 20)]
    cubes = [
        simulate_reflector(TDM_RADAR, a, MISMATCHED_CHANNELS, position_errors, elevation_deg=e)
        for a, e in directions_deg
    ]

    result = dc.calibrate(
        cubes,
        TDM_RADAR,
        azimuth_rad=np.radians([a for a, _ in directions_deg]),
        elevation_rad=np.radians([e for _, e in directions_deg]),
    )

    errors_m = np.array(result.calibration.position_error_m)
    # 1 um is 0.1 degrees of phase; the curvature of a wave from 20 m is smaller over 0.2 mm.
    np.testing.assert_allclose(errors_m, np.tile(rx, (2, 1)), atol=1e-6)
    assert result.calibration.residual < 1e-3


def test_single_angle_yields_no_positions():
    result = dc.calibrate(
        simulate_reflector(TDM_RADAR, 10.0, MISMATCHED_CHANNELS),
        TDM_RADAR,
        azimuth_rad=np.radians(10),
    )

    assert result.calibration.position_error_m is None
    assert np.all(np.array(result.position_std_m) == 0)


def test_calibration_removes_azimuth_bias():
    calibration = dc.calibrate(
        simulate_reflector(TDM_RADAR, 0.0, MISMATCHED_CHANNELS), TDM_RADAR, azimuth_rad=0.0
    ).calibration
    calibrated_radar = replace(TDM_RADAR, calibration=calibration)
    uncalibrated_errors, calibrated_errors, std = [], [], []
    rng = np.random.default_rng(3)

    for azimuth_deg in (-45.0, -15.0, 20.0, 50.0):
        cube = add_noise(
            simulate_reflector(TDM_RADAR, azimuth_deg, MISMATCHED_CHANNELS), -10.0, rng
        )
        for radar, errors in (
            (TDM_RADAR, uncalibrated_errors),
            (calibrated_radar, calibrated_errors),
        ):
            detection = dc.detect(cube, radar).sortby("snr", ascending=False).isel(detection=0)
            errors.append(float(detection.azimuth) - np.radians(azimuth_deg))
        std.append(float(detection.azimuth_std))

    assert np.max(np.abs(uncalibrated_errors)) > np.radians(1.0)
    assert np.all(np.abs(calibrated_errors) < 6 * np.array(std))


def test_position_calibration_corrects_angles_outside_measured_span():
    position_errors = dc.impairments.PositionErrors(
        rx_m=((0, -0.3e-3, 0), (0, -0.1e-3, 0), (0, 0.1e-3, 0), (0, 0, 0))
    )
    angles = np.radians([-30.0, 0.0, 30.0])
    cubes = [simulate_reflector(TDM_RADAR, np.degrees(angle), position_errors) for angle in angles]
    position_calibration = dc.calibrate(cubes, TDM_RADAR, azimuth_rad=angles).calibration
    gain_calibration = dc.calibrate(cubes[1], TDM_RADAR, azimuth_rad=0.0).calibration

    def azimuth_error_deg(calibration: dc.Calibration) -> float:
        detections = dc.detect(
            simulate_reflector(TDM_RADAR, 55.0, position_errors),
            replace(TDM_RADAR, calibration=calibration),
        )
        strongest = detections.sortby("snr", ascending=False).isel(detection=0)
        return abs(float(np.degrees(strongest.azimuth)) - 55.0)

    assert azimuth_error_deg(gain_calibration) > 0.5
    assert azimuth_error_deg(position_calibration) < 0.05


def test_near_reflector_yields_far_field_gains():
    """Allow 0.2 of the 2.7 degrees by which the wave from 1.2 m is curved over the array."""
    cube = simulate_reflector(TDM_RADAR, 30.0, MISMATCHED_CHANNELS, range_m=1.2)
    near_result = dc.calibrate(cube, TDM_RADAR, azimuth_rad=np.radians(30), range_m=1.2)
    far_result = dc.calibrate(
        simulate_reflector(TDM_RADAR, 30.0, MISMATCHED_CHANNELS, range_m=40.0),
        TDM_RADAR,
        azimuth_rad=np.radians(30),
    )

    gain_ratio = complex_gains(near_result.calibration) / complex_gains(far_result.calibration)
    gain_ratio /= gain_ratio.mean()
    assert np.degrees(np.abs(np.angle(gain_ratio))).max() < 0.2


def test_range_offset_equals_range_error_of_reflector():
    cube = simulate_reflector(TDM_RADAR, 0.0, EQUAL_CHANNELS, range_m=20.0)

    calibration = dc.calibrate(cube, TDM_RADAR, azimuth_rad=0.0, range_m=19.9).calibration
    detections = dc.detect(cube, replace(TDM_RADAR, calibration=calibration))

    assert calibration.range_offset_m == pytest.approx(0.1, abs=1e-3)
    strongest = detections.sortby("snr", ascending=False).isel(detection=0)
    assert float(strongest.range) == pytest.approx(19.9, abs=1e-3)


def test_range_selects_reflector_among_stronger_echoes():
    cube = simulate_reflector(
        TDM_RADAR, 20.0, MISMATCHED_CHANNELS, range_m=20.0
    ) + 10 * simulate_reflector(TDM_RADAR, -35.0, MISMATCHED_CHANNELS, range_m=30.0)

    result = dc.calibrate(cube, TDM_RADAR, azimuth_rad=np.radians(20), range_m=20.0)

    assert result.range_m[0] == pytest.approx(20.0, abs=0.01)
    # The other echo, 20 dB stronger and 17 cells away, is subtracted.
    assert np.abs(relative_gain_errors(result, channel_gains())).max() < 0.01


def test_ignores_moving_target():
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(20, 0, 0), rcs_m2=1.0),
            dc.Target(position_m=(30, 0, 0), velocity_m_per_s=(9, 0, 0), rcs_m2=1000.0),
        ]
    )

    result = dc.calibrate(dc.simulate(scene, TDM_RADAR, seed=1), TDM_RADAR, azimuth_rad=0.0)

    assert result.range_m[0] == pytest.approx(20.0, abs=0.05)


def test_iterated_frames_equal_cube():
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), rcs_m2=10.0)])
    cube = dc.simulate(scene, TDM_RADAR, n_frames=3, seed=4)

    cube_result = dc.calibrate(cube, TDM_RADAR, azimuth_rad=0.0)
    frames_result = dc.calibrate(
        (cube.isel(frame=slice(i, i + 1)) for i in range(3)), TDM_RADAR, azimuth_rad=0.0
    )
    first_frame_result = dc.calibrate(cube.isel(frame=slice(0, 1)), TDM_RADAR, azimuth_rad=0.0)

    assert cube_result == frames_result
    # Three frames of the same target reduce errors by sqrt(3).
    ratio = np.array(first_frame_result.gain_std) / np.array(cube_result.gain_std)
    assert ratio.mean() == pytest.approx(np.sqrt(3), rel=0.1)


def test_recalibration_replaces_gains_and_keeps_positions():
    position_errors_m = ((0.0, 1e-4, 0.0), *((0.0, 0.0, 0.0),) * 7)
    previous = dc.Calibration(
        elements=[(tx, rx) for tx in range(2) for rx in range(4)],
        gain=[(0.5, 2.0)] * 8,
        position_error_m=position_errors_m,
        range_offset_m=0.3,
    )
    cube = simulate_reflector(TDM_RADAR, 0.0, MISMATCHED_CHANNELS)

    recalibration = dc.calibrate(
        cube, replace(TDM_RADAR, calibration=previous), azimuth_rad=0.0
    ).calibration

    assert recalibration.position_error_m == position_errors_m
    assert recalibration.range_offset_m == 0.3
    # Lateral positions do not change phases at boresight.
    np.testing.assert_allclose(
        complex_gains(recalibration),
        complex_gains(dc.calibrate(cube, TDM_RADAR, azimuth_rad=0.0).calibration),
        rtol=1e-6,
    )


@pytest.mark.parametrize("wrong_deg", [-30.0, 65.0])
def test_warns_of_implausible_reflector_angle(wrong_deg):
    cube = simulate_reflector(TDM_RADAR, 30.0, EQUAL_CHANNELS)

    wrong_angle_findings = dc.calibrate(
        cube, TDM_RADAR, azimuth_rad=np.radians(wrong_deg), range_m=20.0
    ).findings
    right_angle_findings = dc.calibrate(cube, TDM_RADAR, azimuth_rad=np.radians(30.0)).findings

    assert [finding.setting for finding in wrong_angle_findings] == ["azimuth_rad"]
    assert "30 degrees even before" in wrong_angle_findings[0].value
    assert right_angle_findings == ()


def test_strongest_echo_in_another_direction_is_refused_without_range():
    wall = simulate_reflector(TDM_RADAR, 0.0, EQUAL_CHANNELS, range_m=26.0)
    cube = 0.3 * simulate_reflector(TDM_RADAR, 30.0, EQUAL_CHANNELS, range_m=20.0) + wall
    azimuth = np.radians(30.0)

    with pytest.raises(dc.InvalidSetting, match=r"^range_m: missing, .* 26 m, .* next .* 20 m,"):
        dc.calibrate(cube, TDM_RADAR, azimuth_rad=azimuth)

    assert dc.calibrate(cube, TDM_RADAR, azimuth_rad=azimuth, range_m=20.0).findings == ()


def test_warns_of_inconsistent_angles():
    cubes = [simulate_reflector(TDM_RADAR, angle, EQUAL_CHANNELS) for angle in (-40.0, 0.0, 40.0)]
    shuffled = [cubes[0], cubes[2], cubes[1]]

    result = dc.calibrate(shuffled, TDM_RADAR, azimuth_rad=np.radians([-40.0, 0.0, 40.0]))

    assert any("inconsistent angles" in finding.value for finding in result.findings)
    assert result.calibration.residual > 0.2


def test_warns_of_second_echo_near_or_equally_strong():
    reflector = simulate_reflector(TDM_RADAR, 0.0, EQUAL_CHANNELS, range_m=20.0)
    cube_with_near_echo = reflector + 0.5 * simulate_reflector(
        TDM_RADAR, 5.0, EQUAL_CHANNELS, range_m=21.7
    )
    cube_with_equal_echo = reflector + simulate_reflector(
        TDM_RADAR, 5.0, EQUAL_CHANNELS, range_m=20.0 * 2**0.5
    )

    near_findings = dc.calibrate(
        cube_with_near_echo, TDM_RADAR, azimuth_rad=0.0, range_m=20.0
    ).findings
    equal_findings = dc.calibrate(cube_with_equal_echo, TDM_RADAR, azimuth_rad=0.0).findings

    assert any("within three range cells" in finding.value for finding in near_findings)
    assert any(finding.setting == "range_m" for finding in equal_findings)


def test_warns_of_weak_reflector_and_rejects_dead_receiver():
    clean = simulate_reflector(TDM_RADAR, 0.0, EQUAL_CHANNELS)

    weak_findings = dc.calibrate(
        add_noise(clean, -20.0, np.random.default_rng(5)), TDM_RADAR, azimuth_rad=0.0
    ).findings
    assert any(
        "only 1" in finding.value and "dB over the noise" in finding.value
        for finding in weak_findings
    )

    dead_receiver_cube = add_noise(clean, -10.0, np.random.default_rng(6))
    dead_receiver_cube.values[:, :, 2] *= 0.03
    dead_receiver_cube.values[:, :, 2] += add_noise(
        0 * clean + 1e-30, 0.0, np.random.default_rng(7)
    ).values[:, :, 2]
    noise = simulate_noise_cube(TDM_RADAR, np.random.default_rng(8)).values
    dead_receiver_cube.values[:, :, 2] += noise[:, :, 2] * float(
        np.sqrt(np.mean(abs(clean.values) ** 2) * 10)
    )
    with pytest.raises(dc.InvalidSetting, match=r"element \[[01], 2\]"):
        dc.calibrate(dead_receiver_cube, TDM_RADAR, azimuth_rad=0.0)


def test_rejects_unusable_recordings_and_angles():
    cube = simulate_reflector(TDM_RADAR, 0.0, EQUAL_CHANNELS)
    noise = simulate_noise_cube(TDM_RADAR, np.random.default_rng(9))
    single_element_radar = replace(
        TDM_RADAR, frame=replace(TDM_RADAR.frame, multiplexing=None), array=dc.Array()
    )
    triangular_radar = replace(
        TDM_RADAR,
        frame=replace(TDM_RADAR.frame, multiplexing=None, modulation=Triangular()),
        array=dc.Array(rx_m=TDM_RADAR.array.rx_m),
    )
    cases = {
        "no static echo": (noise, TDM_RADAR, {"azimuth_rad": 0.0}),
        "from 28.24 to 31.76 m": (cube, TDM_RADAR, {"azimuth_rad": 0.0, "range_m": 30.0}),
        "several elements": (cube, single_element_radar, {"azimuth_rad": 0.0}),
        "modulation: triangular": (cube, triangular_radar, {"azimuth_rad": 0.0}),
        "at least -1.5708 rad": (cube, TDM_RADAR, {"azimuth_rad": 30.0}),
        "azimuth_rad: ": (cube, TDM_RADAR, {"azimuth_rad": np.nan}),
        "elevation_rad: ": (cube, TDM_RADAR, {"azimuth_rad": 0.0, "elevation_rad": 2.0}),
        "range_m: ": (cube, TDM_RADAR, {"azimuth_rad": 0.0, "range_m": -1.0}),
        "2 angles for 1 recordings": ([cube], TDM_RADAR, {"azimuth_rad": [0.0, 0.1]}),
        "0 angles for 0 recordings": ([], TDM_RADAR, {"azimuth_rad": []}),
        "3 numbers for 2 recordings": (
            [cube] * 2,
            TDM_RADAR,
            {"azimuth_rad": [0, 0.1], "range_m": [1] * 3},
        ),
    }
    for message, (recordings, radar, options) in cases.items():
        with pytest.raises(dc.InvalidSetting, match=message):
            dc.calibrate(recordings, radar, **options)


def test_rejects_invalid_calibration():
    valid_settings = {"elements": [(0, 0), (0, 1)], "gain": [(1.0, 0.0), (0.5, 0.5)]}
    invalid_cases = [
        ({"elements": [(0, 0), (0, 0)]}, "twice"),
        ({"elements": [(0, 0)]}, "a list of 2"),
        ({"elements": [(0, -1), (0, 0)]}, r"elements\.0"),
        ({"elements": [(0,), (0, 1)]}, "two numbers"),
        ({"elements": []}, "a list of pairs"),
        ({"gain": [(1.0, 0.0), (0.0, 0.0)]}, r"gain\.1: .* magnitude"),
        ({"gain": [(1.0, np.nan), (1.0, 0.0)]}, r"gain\.0"),
        ({"gain": [1.0, 2.0]}, "two numbers"),
        ({"position_error_m": [(0, 0, 0)]}, "one for each of the 2 elements"),
        ({"position_error_m": [(0, 0, 0), (0, 1.0, 0)]}, "check the unit"),
        ({"range_offset_m": np.inf}, "range_offset_m"),
        ({"residual": -1.0}, "residual"),
    ]
    dc.Calibration(**valid_settings)
    for changes, message in invalid_cases:
        with pytest.raises(dc.InvalidSetting, match=message):
            dc.Calibration(**{**valid_settings, **changes})


def test_rejects_calibration_of_another_array():
    calibration = dc.Calibration(elements=[(0, 0), (0, 1)], gain=[(1.0, 0.0), (0.5, 0.5)])
    with pytest.raises(dc.InvalidSetting, match=r"none for \[0, 2\], \[0, 3\].* and 3 more"):
        replace(TDM_RADAR, calibration=calibration)


def test_element_order_of_calibration_is_arbitrary():
    pairs = [(tx, rx) for tx in range(2) for rx in range(4)]
    gain = [(1.0 + n, 0.5 * n) for n in range(8)]
    ascending = dc.Calibration(elements=pairs, gain=gain)
    descending = dc.Calibration(elements=pairs[::-1], gain=gain[::-1])

    np.testing.assert_array_equal(
        replace(TDM_RADAR, calibration=ascending).element_corrections,
        replace(TDM_RADAR, calibration=descending).element_corrections,
    )
