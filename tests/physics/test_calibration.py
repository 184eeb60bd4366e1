"""Calibration: what was put into a simulated array is measured, to the bound of the noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

import dechirp as dc
from dechirp.processing.calibration.calibrate import CalibrationResult
from dechirp.radar.modulations.triangular import Triangular
from noise import noise_cube, noisy

GAINS = (1.0, 1.4, 0.7, 1.1)  # of power, of the receivers
PHASES = (0.0, 0.5, -0.9, -0.6)
WAVE_M = 3.87e-3
RARE = 1e-6


def radar(
    code: dc.multiplexing.Tdm | dc.multiplexing.Bpm | dc.multiplexing.Ddma,
    sampling: str = "complex",
) -> dc.Radar:
    """Two transmitters and four receivers: a line of eight, half a wavelength apart."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=20e12,
        adc_start_s=2e-6,
        ramp_duration_s=16e-6,
        sample_rate_hz=10e6,
        n_samples=128,
        sampling=sampling,
    )
    half_m = WAVE_M / 2
    return dc.Radar(
        frame=dc.Frame(chirp=chirp, n_chirps=32, interval_s=20e-6, multiplexing=code),
        array=dc.Array(
            tx_m=[(0, 0, 0), (0, 4 * half_m, 0)], rx_m=[(0, n * half_m, 0) for n in range(4)]
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


TDM = radar(dc.multiplexing.Tdm(order=(0, 1)))
ALIKE = dc.impairments.ChannelMismatch(gains=(1.0,) * 4, phases_rad=(0.0,) * 4)
UNLIKE = dc.impairments.ChannelMismatch(gains=GAINS, phases_rad=PHASES)


def echo(of: dc.Radar, azimuth_deg: float, *impairments, range_m=20.0, elevation_deg=0.0):
    """A corner reflector at rest, without noise."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    towards = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    target = dc.Target(position_m=tuple(range_m * towards), rcs_m2=10.0)
    return dc.simulate(dc.Scene(targets=[target]), of, impairments=impairments)


def factors(calibration: dc.Calibration) -> np.ndarray:
    return np.array(calibration.gain) @ np.array([1, 1j])


def put_in(gains=GAINS, phases=PHASES, n_tx=2) -> np.ndarray:
    """Channel of each element: that of its receiver."""
    return np.tile(np.sqrt(gains) * np.exp(1j * np.array(phases)), n_tx)


def relative(found: CalibrationResult, channel: np.ndarray) -> np.ndarray:
    """Errors of the gains, relative to the truth, free of the common factor."""
    product = factors(found.calibration) * channel
    weight = 1 / np.array(found.gain_std) ** 2
    return product / (np.sum(weight * product) / weight.sum()) - 1


def misfits(errors: np.ndarray, stds: np.ndarray) -> float:
    return float(np.sum(np.abs(errors) ** 2 / np.asarray(stds) ** 2))


def within_law(total: float, n_free: int) -> bool:
    return bool(chi2.ppf(RARE / 2, n_free) < total < chi2.isf(RARE / 2, n_free))


@pytest.mark.parametrize(
    ("of", "per_sample_db"),
    [
        (TDM, -10),
        (radar(dc.multiplexing.Tdm(order=(1, 0))), -10),
        (radar(dc.multiplexing.Bpm(order=(0, 1))), -10),
        (radar(dc.multiplexing.Ddma(order=(0, 1), n_sub_bands=4)), -10),
        (radar(dc.multiplexing.Tdm(order=(0, 1)), "real"), -10),
    ],
    ids=["tdm", "tdm backwards", "bpm", "ddma", "real samples"],
)
def test_gains_are_those_that_were_put_in_to_the_bound_of_the_noise(of, per_sample_db):
    clean = echo(of, 25.0, UNLIKE)
    rng, total, n_free = np.random.default_rng(1), 0.0, 0

    for _ in range(12):
        cube = noisy(clean, per_sample_db, rng)
        found = dc.calibrate(cube, of, azimuth_rad=np.radians(25.0))
        total += misfits(relative(found, put_in()), np.array(found.gain_std))
        n_free += 2 * 7  # two parts of eight gains, less the common factor

    # The standard errors are the noise's own: neither too small nor too large.
    assert within_law(total, n_free)


def test_the_ratio_that_is_reported_is_that_of_the_link(code=TDM):
    clean = echo(code, -40.0, ALIKE)
    seen = [
        dc.calibrate(
            noisy(clean, -10.0, np.random.default_rng(seed)), code, azimuth_rad=-np.radians(40)
        )
        for seed in range(16)
    ]

    # -10 dB in a sample, 128 x 32 of them for each element: 26.1 dB. Of |a + w|^2 / noise the mean
    # is one more than that; its standard deviation is the square root of twice that.
    expected = 0.1 * 128 * 32
    measured = np.array([one.snr for one in seen])
    std_of_mean = np.sqrt(2 * expected / measured.size)
    assert measured.mean() == pytest.approx(expected + 1, abs=5 * std_of_mean + 0.03 * expected)


def test_places_are_found_from_several_angles_to_the_bound_of_the_noise():
    tx = ((0, 0, 0), (0, 0.2e-3, 0))
    rx = ((0, 0.1e-3, 0), (0, -0.15e-3, 0), (0, 0, 0), (0, 0.05e-3, 0))
    moved = dc.impairments.PositionErrors(tx_m=tx, rx_m=rx)
    angles = (-50.0, -20.0, 5.0, 30.0, 55.0)
    clean = [echo(TDM, angle, UNLIKE, moved) for angle in angles]
    truth = (np.array(tx)[:, None] + np.array(rx)).reshape(-1, 3)[:, 1]
    truth = truth - truth.mean()
    rng, gains, places, residuals = np.random.default_rng(2), 0.0, 0.0, []

    for _ in range(8):
        found = dc.calibrate(
            [noisy(one, -5.0, rng) for one in clean], TDM, azimuth_rad=np.radians(angles)
        )
        errors_m = np.array(found.calibration.position_error_m)[:, 1] - truth
        stds_m = np.array(found.position_std_m)[:, 1]
        places += misfits(errors_m - errors_m.mean(), stds_m)
        # At boresight the phases of gains rest on the places: all but free of them here.
        gains += misfits(relative(found, put_in()), np.array(found.gain_std))
        residuals.append(found.calibration.residual**2 * np.mean(found.snr))

    assert within_law(places, 8 * 7)
    assert within_law(gains, 8 * 14)
    # What is left is noise: 0.9 is what the smallest of the looks' ratios stand below their mean.
    assert np.mean(residuals) == pytest.approx(0.95, abs=0.15)


def test_heights_are_found_where_elevations_differ():
    rx = ((0, 0, 0.2e-3), (0, 0, -0.1e-3), (0, 0, 0), (0, 0, -0.1e-3))
    moved = dc.impairments.PositionErrors(rx_m=rx)
    at = [(-40, 0), (40, 0), (0, 25), (0, -25), (20, 20)]
    cubes = [echo(TDM, a, UNLIKE, moved, elevation_deg=e) for a, e in at]

    found = dc.calibrate(
        cubes,
        TDM,
        azimuth_rad=np.radians([a for a, _ in at]),
        elevation_rad=np.radians([e for _, e in at]),
    )

    errors_m = np.array(found.calibration.position_error_m)
    # 1 um is 0.1 degrees of phase; the wave of 20 m bends by less over 0.2 mm.
    np.testing.assert_allclose(errors_m, np.tile(rx, (2, 1)), atol=1e-6)
    assert found.calibration.residual < 1e-3


def test_one_angle_tells_no_place():
    found = dc.calibrate(echo(TDM, 10.0, UNLIKE), TDM, azimuth_rad=np.radians(10))

    assert found.calibration.position_error_m is None
    assert np.all(np.array(found.position_std_m) == 0)


def test_angles_are_right_after_calibration_and_were_wrong_before():
    calibration = dc.calibrate(echo(TDM, 0.0, UNLIKE), TDM, azimuth_rad=0.0).calibration
    corrected = replace(TDM, calibration=calibration)
    before, after, std = [], [], []
    rng = np.random.default_rng(3)

    for azimuth_deg in (-45.0, -15.0, 20.0, 50.0):
        cube = noisy(echo(TDM, azimuth_deg, UNLIKE), -10.0, rng)
        for of, errors in ((TDM, before), (corrected, after)):
            found = dc.detect(cube, of).sortby("snr", ascending=False).isel(detection=0)
            errors.append(float(found.azimuth) - np.radians(azimuth_deg))
        std.append(float(found.azimuth_std))

    assert np.max(np.abs(before)) > np.radians(1.0)
    assert np.all(np.abs(after) < 6 * np.array(std))


def test_places_that_were_measured_mend_angles_far_from_those_they_were_measured_at():
    moved = dc.impairments.PositionErrors(
        rx_m=((0, -0.3e-3, 0), (0, -0.1e-3, 0), (0, 0.1e-3, 0), (0, 0, 0))
    )
    angles = np.radians([-30.0, 0.0, 30.0])
    cubes = [echo(TDM, np.degrees(angle), moved) for angle in angles]
    with_places = dc.calibrate(cubes, TDM, azimuth_rad=angles).calibration
    without = dc.calibrate(cubes[1], TDM, azimuth_rad=0.0).calibration

    def off_deg(calibration: dc.Calibration) -> float:
        found = dc.detect(echo(TDM, 55.0, moved), replace(TDM, calibration=calibration))
        strongest = found.sortby("snr", ascending=False).isel(detection=0)
        return abs(float(np.degrees(strongest.azimuth)) - 55.0)

    assert off_deg(without) > 0.5
    assert off_deg(with_places) < 0.05


def test_a_reflector_may_stand_near():
    """At 1.2 m the wave bends by 2.7 degrees over these antennas; no more than 0.2 are left."""
    cube = echo(TDM, 30.0, UNLIKE, range_m=1.2)
    near = dc.calibrate(cube, TDM, azimuth_rad=np.radians(30), range_m=1.2)
    far = dc.calibrate(echo(TDM, 30.0, UNLIKE, range_m=40.0), TDM, azimuth_rad=np.radians(30))

    both = factors(near.calibration) / factors(far.calibration)
    both /= both.mean()
    assert np.degrees(np.abs(np.angle(both))).max() < 0.2


def test_the_range_offset_is_what_ranges_are_too_long_by():
    cube = echo(TDM, 0.0, ALIKE, range_m=20.0)

    calibration = dc.calibrate(cube, TDM, azimuth_rad=0.0, range_m=19.9).calibration
    found = dc.detect(cube, replace(TDM, calibration=calibration))

    assert calibration.range_offset_m == pytest.approx(0.1, abs=1e-3)
    strongest = found.sortby("snr", ascending=False).isel(detection=0)
    assert float(strongest.range) == pytest.approx(19.9, abs=1e-3)


def test_the_range_says_which_echo_is_meant():
    both = echo(TDM, 20.0, UNLIKE, range_m=20.0) + 10 * echo(TDM, -35.0, UNLIKE, range_m=30.0)

    found = dc.calibrate(both, TDM, azimuth_rad=np.radians(20), range_m=20.0)

    assert found.range_m[0] == pytest.approx(20.0, abs=0.01)
    # The other, 20 dB stronger and 17 cells away, is subtracted.
    assert np.abs(relative(found, put_in())).max() < 0.01


def test_what_moves_is_not_the_reflector():
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(20, 0, 0), rcs_m2=1.0),
            dc.Target(position_m=(30, 0, 0), velocity_m_per_s=(9, 0, 0), rcs_m2=1000.0),
        ]
    )

    found = dc.calibrate(dc.simulate(scene, TDM, seed=1), TDM, azimuth_rad=0.0)

    assert found.range_m[0] == pytest.approx(20.0, abs=0.05)


def test_frames_one_by_one_give_what_the_cube_gives():
    scene = dc.Scene(targets=[dc.Target(position_m=(20, 0, 0), rcs_m2=10.0)])
    cube = dc.simulate(scene, TDM, n_frames=3, seed=4)

    whole = dc.calibrate(cube, TDM, azimuth_rad=0.0)
    one_by_one = dc.calibrate(
        (cube.isel(frame=slice(i, i + 1)) for i in range(3)), TDM, azimuth_rad=0.0
    )
    first = dc.calibrate(cube.isel(frame=slice(0, 1)), TDM, azimuth_rad=0.0)

    assert whole == one_by_one
    # Three looks at the same: errors are smaller by the root of three.
    ratio = np.array(first.gain_std) / np.array(whole.gain_std)
    assert ratio.mean() == pytest.approx(np.sqrt(3), rel=0.1)


def test_a_new_calibration_replaces_gains_and_keeps_places():
    places = ((0.0, 1e-4, 0.0), *((0.0, 0.0, 0.0),) * 7)
    before = dc.Calibration(
        elements=[(tx, rx) for tx in range(2) for rx in range(4)],
        gain=[(0.5, 2.0)] * 8,
        position_error_m=places,
        range_offset_m=0.3,
    )
    cube = echo(TDM, 0.0, UNLIKE)

    again = dc.calibrate(cube, replace(TDM, calibration=before), azimuth_rad=0.0).calibration

    assert again.position_error_m == places
    assert again.range_offset_m == 0.3
    # Straight ahead, places to the side do not turn phases.
    np.testing.assert_allclose(
        factors(again), factors(dc.calibrate(cube, TDM, azimuth_rad=0.0).calibration), rtol=1e-6
    )


@pytest.mark.parametrize("wrong_deg", [-30.0, 65.0])
def test_an_angle_that_the_array_does_not_see_is_told(wrong_deg):
    cube = echo(TDM, 30.0, ALIKE)

    wrong = dc.calibrate(cube, TDM, azimuth_rad=np.radians(wrong_deg)).findings
    right = dc.calibrate(cube, TDM, azimuth_rad=np.radians(30.0)).findings

    assert [finding.setting for finding in wrong] == ["azimuth_rad"]
    assert "30 degrees even before" in wrong[0].value
    assert right == ()


def test_angles_that_no_array_explains_are_told():
    cubes = [echo(TDM, angle, ALIKE) for angle in (-40.0, 0.0, 40.0)]
    shuffled = [cubes[0], cubes[2], cubes[1]]

    found = dc.calibrate(shuffled, TDM, azimuth_rad=np.radians([-40.0, 0.0, 40.0]))

    assert any("inconsistent angles" in finding.value for finding in found.findings)
    assert found.calibration.residual > 0.2


def test_a_second_echo_beside_or_as_strong_is_told():
    own = echo(TDM, 0.0, ALIKE, range_m=20.0)
    beside = own + 0.5 * echo(TDM, 5.0, ALIKE, range_m=21.7)
    rival = own + echo(TDM, 5.0, ALIKE, range_m=20.0 * 2**0.5)

    near = dc.calibrate(beside, TDM, azimuth_rad=0.0, range_m=20.0).findings
    far = dc.calibrate(rival, TDM, azimuth_rad=0.0).findings

    assert any("within three range cells" in finding.value for finding in near)
    assert any(finding.setting == "range_m" for finding in far)


def test_a_weak_reflector_is_told_and_a_dead_receiver_refused():
    clean = echo(TDM, 0.0, ALIKE)

    weak = dc.calibrate(
        noisy(clean, -20.0, np.random.default_rng(5)), TDM, azimuth_rad=0.0
    ).findings
    assert any(
        "only 1" in finding.value and "dB over the noise" in finding.value for finding in weak
    )

    dead = noisy(clean, -10.0, np.random.default_rng(6))
    dead.values[:, :, 2] *= 0.03
    dead.values[:, :, 2] += noisy(0 * clean + 1e-30, 0.0, np.random.default_rng(7)).values[:, :, 2]
    noise = noise_cube(TDM, np.random.default_rng(8)).values
    dead.values[:, :, 2] += noise[:, :, 2] * float(np.sqrt(np.mean(abs(clean.values) ** 2) * 10))
    with pytest.raises(dc.InvalidSetting, match=r"element \[[01], 2\]"):
        dc.calibrate(dead, TDM, azimuth_rad=0.0)


def test_what_cannot_be_calibrated_is_refused():
    cube = echo(TDM, 0.0, ALIKE)
    noise = noise_cube(TDM, np.random.default_rng(9))
    lone = replace(TDM, frame=replace(TDM.frame, multiplexing=None), array=dc.Array())
    rising_and_falling = replace(
        TDM,
        frame=replace(TDM.frame, multiplexing=None, modulation=Triangular()),
        array=dc.Array(rx_m=TDM.array.rx_m),
    )
    refused = {
        "no static echo": (noise, TDM, {"azimuth_rad": 0.0}),
        "from 28.24 to 31.76 m": (cube, TDM, {"azimuth_rad": 0.0, "range_m": 30.0}),
        "several elements": (cube, lone, {"azimuth_rad": 0.0}),
        "modulation: triangular": (cube, rising_and_falling, {"azimuth_rad": 0.0}),
        "at least -1.5708 rad": (cube, TDM, {"azimuth_rad": 30.0}),
        "azimuth_rad: ": (cube, TDM, {"azimuth_rad": np.nan}),
        "elevation_rad: ": (cube, TDM, {"azimuth_rad": 0.0, "elevation_rad": 2.0}),
        "range_m: ": (cube, TDM, {"azimuth_rad": 0.0, "range_m": -1.0}),
        "2 angles for 1 recordings": ([cube], TDM, {"azimuth_rad": [0.0, 0.1]}),
        "0 angles for 0 recordings": ([], TDM, {"azimuth_rad": []}),
        "3 numbers for 2 recordings": (
            [cube] * 2,
            TDM,
            {"azimuth_rad": [0, 0.1], "range_m": [1] * 3},
        ),
    }
    for words, (given, of, told) in refused.items():
        with pytest.raises(dc.InvalidSetting, match=words):
            dc.calibrate(given, of, **told)


def test_a_calibration_that_cannot_be_is_refused():
    right = {"elements": [(0, 0), (0, 1)], "gain": [(1.0, 0.0), (0.5, 0.5)]}
    wrong = [
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
    dc.Calibration(**right)
    for changes, words in wrong:
        with pytest.raises(dc.InvalidSetting, match=words):
            dc.Calibration(**{**right, **changes})


def test_a_calibration_of_another_array_is_refused():
    two = dc.Calibration(elements=[(0, 0), (0, 1)], gain=[(1.0, 0.0), (0.5, 0.5)])
    with pytest.raises(dc.InvalidSetting, match=r"none for \[0, 2\], \[0, 3\].* and 3 more"):
        replace(TDM, calibration=two)


def test_the_order_of_the_elements_in_a_file_is_free():
    pairs = [(tx, rx) for tx in range(2) for rx in range(4)]
    gain = [(1.0 + n, 0.5 * n) for n in range(8)]
    straight = dc.Calibration(elements=pairs, gain=gain)
    backwards = dc.Calibration(elements=pairs[::-1], gain=gain[::-1])

    np.testing.assert_array_equal(
        replace(TDM, calibration=straight).element_corrections,
        replace(TDM, calibration=backwards).element_corrections,
    )
