"""Phase errors of the sweep: each echo has the error now, less that when it left."""

from dataclasses import replace

import numpy as np
import pytest

import dechirp as dc
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.simulation import phase_error
from dechirp.simulation.echo_groups import direct_echo_groups, sample_window
from dechirp.simulation.impairments.polynomial_nonlinearity import PolynomialNonlinearity
from dechirp.simulation.simulate import simulate_ideal_echoes


def radar_of(*, sampling="complex", slope=15e12, sample_rate_hz=10e6, n_samples=256, n_tx=1):
    """77 GHz, four chirps whose samples begin after every echo; two receivers."""
    chirp = dc.Chirp(
        start_frequency_hz=77e9,
        slope_hz_per_s=slope,
        adc_start_s=3e-6,
        ramp_duration_s=4e-6 + n_samples / sample_rate_hz,
        sample_rate_hz=sample_rate_hz,
        n_samples=n_samples,
        sampling=sampling,
    )
    tdm = dc.multiplexing.Tdm(order=tuple(range(n_tx))) if n_tx > 1 else None
    return dc.Radar(
        frame=dc.Frame(
            chirp=chirp, n_chirps=4, interval_s=chirp.ramp_duration_s + 4e-6, multiplexing=tdm
        ),
        array=dc.Array(
            tx_m=[(0, 0.01 * k, 0) for k in range(n_tx)], rx_m=[(0, 0, 0), (0, 1.9e-3, 0)]
        ),
        hardware=dc.Hardware(transmit_power_w=0.016, antenna_gain=10.0, noise_factor=16.0),
    )


def at(*ranges_m):
    """Targets at rest of equal echoes."""
    return dc.Scene(
        targets=[
            dc.Target(name=f"at {r:g} m", position_m=(r, 0, 0), rcs_m2=(r / 10) ** 4)
            for r in ranges_m
        ]
    )


def sinusoids(rng, *, n_chirps, band_hz, rms_rad, steep):
    """Phases (n_chirps, n_times) of sums of 200 sinusoids, known at any time since ramp start."""
    frequency_hz = rng.uniform(0, band_hz, 200)
    sizes = 1 / np.maximum(frequency_hz, band_hz / 500) if steep else np.ones(200)
    sizes *= rms_rad * np.sqrt(2 / np.sum(sizes**2))
    angles = rng.uniform(0, 2 * np.pi, (n_chirps, 1, 200))

    def phase_rad(times_s):
        return np.cos(2 * np.pi * np.multiply.outer(times_s, frequency_hz) + angles) @ sizes

    return phase_rad


def turned(scene, radar, phase_rad, found=None):
    """What the stage makes of the echoes of a frame with the given phase."""
    kept = sample_window(radar, 0)
    found = found or phase_error.find_delay_spread(
        list(direct_echo_groups(scene, radar, 0, None)), kept, radar
    )
    wide = kept.widen(found.n_before, found.n_after)
    chirp = radar.frame.chirp
    longer = replace(
        chirp,
        adc_start_s=wide.first_sample_s,
        n_samples=wide.n_times,
        ramp_duration_s=chirp.ramp_duration_s + found.n_after / chirp.sample_rate_hz,
    )
    frame = replace(radar.frame, chirp=longer)
    # Its wavelength, and so its power, is a little another.
    echo = simulate_ideal_echoes(scene, replace(radar, frame=frame)).values[0]
    echo *= np.sqrt(chirp.wavelength_m**2 / longer.wavelength_m**2)
    seen = found.phase_window(wide)
    return phase_error.apply_phase_error(echo, phase_rad(seen.times_s), found, radar)


def summed(scene, radar, phase_rad):
    """One echo after the other, with the phase at each time and a delay before it."""
    times_s = sample_window(radar, 0).times_s
    total = 0
    for target in scene.targets:
        echo = simulate_ideal_echoes(replace(scene, targets=(target,)), radar).values[0]
        for receiver, rx_m in enumerate(radar.array.rx_m):
            back_m = np.linalg.norm(np.array(target.position_m) - rx_m)
            delay_s = (target.position_m[0] + back_m) / SPEED_OF_LIGHT
            left_rad = phase_rad(times_s) - phase_rad(times_s - delay_s)
            echo[:, receiver] *= np.exp(1j * left_rad)
        total = total + echo
    return total


def errors_db(scene, radar, phase_rad, found=None):
    """Of the stage, over the power of the phase noise: at the ends and within."""
    expected = summed(scene, radar, phase_rad)
    noise = expected - simulate_ideal_echoes(scene, radar).values[0]
    off = abs(turned(scene, radar, phase_rad, found) - expected) ** 2 / np.mean(abs(noise) ** 2)
    off = off.mean(axis=(0, 1))
    eighth = len(off) // 8
    ends = off[:4].mean(), off[-4:].mean()
    return to_decibels([*ends, off[eighth:-eighth].mean()])


@pytest.mark.parametrize("steep", [False, True], ids=["white", "falling"])
@pytest.mark.parametrize(
    ("slope", "sample_rate_hz", "ranges_m"),
    [(15e12, 10e6, (0.5, 20, 60)), (10e12, 20e6, (5, 31.3, 150)), (30e12, 10e6, (2, 30))],
)
def test_every_echo_has_the_error_now_less_that_when_it_left(
    slope, sample_rate_hz, ranges_m, steep
):
    # Echoes over six tenths of the band; so weak that what is not linear in it is less.
    radar = radar_of(slope=slope, sample_rate_hz=sample_rate_hz)
    rng = np.random.default_rng(1)
    noise = sinusoids(rng, n_chirps=4, band_hz=0.4 * sample_rate_hz, rms_rad=0.003, steep=steep)

    first_db, last_db, within_db = errors_db(at(*ranges_m), radar, noise)

    # The noise is 45 to 50 dB below the echoes.
    assert first_db < -50
    assert last_db < -50
    assert within_db < -55


def test_echoes_over_most_of_the_band_have_it_nearly():
    radar = radar_of(slope=30e12, sample_rate_hz=20e6, n_samples=512)
    rng = np.random.default_rng(1)
    noise = sinusoids(rng, n_chirps=4, band_hz=8e6, rms_rad=0.003, steep=True)

    first_db, last_db, within_db = errors_db(at(0.5, 30, 85), radar, noise)

    assert max(first_db, last_db) < -28
    assert within_db < -45


def test_what_is_fast_for_a_slow_ramp_is_right_for_echoes_of_one_delay():
    # Samples 2200 farther off would be needed to tell delays apart.
    radar = radar_of(slope=20.4545e12, sample_rate_hz=300e6, n_samples=2200)
    radar = replace(radar, array=dc.Array())
    rng = np.random.default_rng(2)
    noise = sinusoids(rng, n_chirps=2, band_hz=100e6, rms_rad=0.003, steep=False)
    radar = replace(radar, frame=replace(radar.frame, n_chirps=2))

    assert errors_db(at(50), radar, noise).max() < -45


def test_the_first_echo_is_right_among_later_ones_whatever_the_ramp():
    # Leakage cancels nearly all that is fast: what is left would drown in what should be gone.
    radar = radar_of(slope=20.4545e12, sample_rate_hz=300e6, n_samples=2200)
    radar = replace(
        radar, frame=replace(radar.frame, n_chirps=2), array=dc.Array(rx_m=[(0, 0.05, 0)])
    )
    noise = sinusoids(
        np.random.default_rng(3), n_chirps=2, band_hz=100e6, rms_rad=0.003, steep=False
    )
    leakage, both = at(0.1), at(0.1, 190)
    kept = sample_window(radar, 0)
    of_both = phase_error.find_delay_spread(
        list(direct_echo_groups(both, radar, 0, None)), kept, radar
    )

    off_db = errors_db(leakage, radar, noise, found=of_both)

    assert off_db.max() < -25


def test_what_is_slow_for_a_slow_ramp_is_right_for_all_echoes():
    radar = radar_of(slope=20.4545e12, sample_rate_hz=300e6, n_samples=2200)
    radar = replace(radar, frame=replace(radar.frame, n_chirps=2))
    # An eighth of the window, times the slope: 18.7 MHz.
    noise = sinusoids(
        np.random.default_rng(2), n_chirps=2, band_hz=15e6, rms_rad=0.003, steep=False
    )

    assert errors_db(at(0.1, 30, 150), radar, noise).max() < -50


@pytest.mark.parametrize("sampling", ["complex", "real"])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.complex128, 1e-12), (np.complex64, 2e-6)])
def test_without_an_error_echoes_are_as_they_are(sampling, dtype, tolerance):
    radar, scene = radar_of(sampling=sampling, n_tx=2), at(1, 20, 45)
    none = PolynomialNonlinearity(error_hz=(0.0,))

    with_stage = dc.simulate(scene, radar, impairments=[none], dtype=dtype)
    without = dc.simulate(scene, radar, impairments=(), dtype=dtype)

    assert with_stage.dtype == without.dtype
    np.testing.assert_allclose(
        with_stage, without, rtol=0, atol=tolerance * float(abs(without).max())
    )


def test_an_error_of_the_carrier_turns_each_echo_by_its_delay():
    radar, ranges_m = radar_of(), (7.0, 40.0)
    error_hz = 300e3
    cubes = [dc.simulate(at(r), radar, impairments=(), dtype=np.complex128) for r in ranges_m]

    cube = dc.simulate(
        at(*ranges_m),
        radar,
        impairments=[PolynomialNonlinearity(error_hz=(error_hz,))],
        dtype=np.complex128,
    )

    expected = sum(
        one * np.exp(2j * np.pi * error_hz * 2 * r / SPEED_OF_LIGHT)
        for one, r in zip(cubes, ranges_m, strict=True)
    )
    # The second receiver is 1.9 mm off: 3e-6 rad. The rest rings from the ends.
    assert float(abs(cube - expected).max()) < 1e-3 * float(abs(expected).max())


def test_a_real_mixer_sees_the_real_part_of_what_a_complex_one_sees():
    bent = [PolynomialNonlinearity(error_hz=(0.0, 0.0, 1e5))]
    radar, scene = radar_of(), at(10, 30)

    both = dc.simulate(scene, radar, impairments=bent, dtype=np.complex128)
    real = dc.simulate(scene, radar_of(sampling="real"), impairments=bent, dtype=np.complex128)

    np.testing.assert_allclose(real, np.sqrt(2) * both.real, atol=1e-12 * float(abs(both).max()))


def test_the_phases_of_all_errors_add():
    radar, scene = radar_of(), at(10, 30)
    first, second = (0.0, 2e5), (1e5, 0.0, -1e5)
    both = tuple(np.add((*first, 0.0), second))

    listed = dc.simulate(
        scene,
        radar,
        impairments=[PolynomialNonlinearity(error_hz=e) for e in (first, second)],
        dtype=np.complex128,
    )
    at_once = dc.simulate(
        scene, radar, impairments=[PolynomialNonlinearity(error_hz=both)], dtype=np.complex128
    )

    np.testing.assert_allclose(listed, at_once, atol=1e-11 * float(abs(at_once).max()))


def test_a_radar_that_sees_nothing_hears_nothing():
    cube = dc.simulate(
        dc.Scene(targets=()), radar_of(), impairments=[PolynomialNonlinearity(error_hz=(1e5,))]
    )

    assert not cube.values.any()


def test_delays_reach_from_the_nearest_to_the_farthest_echo():
    radar = radar_of()
    scene = dc.Scene(
        targets=[
            dc.Target(position_m=(10, 0, 0), velocity_m_per_s=(-30, 0, 0)),
            dc.Target(position_m=(0, 50, 0), velocity_m_per_s=(0, 40, 0)),
        ]
    )
    found = phase_error.find_delay_spread(
        list(direct_echo_groups(scene, radar, 0, None)), sample_window(radar, 0), radar
    )
    samples_per_m = 2 / SPEED_OF_LIGHT * radar.frame.chirp.sample_rate_hz

    assert found.mid_delay - found.half_spread <= 10 * samples_per_m
    assert found.mid_delay + found.half_spread >= 50 * samples_per_m
    # To a sample and the rounding of it.
    assert found.half_spread <= 20 * samples_per_m + 2


def test_what_is_summed_besides_is_at_most_a_quarter_of_the_window():
    for slope in (1e9, 1e11, 1e13):
        radar = radar_of(slope=slope, n_samples=128)
        found = phase_error.find_delay_spread([], sample_window(radar, 0), radar)
        assert 0 < found.n_before == found.n_after <= 16


@pytest.mark.parametrize("n_samples", [2, 3, 9, 40])
@pytest.mark.filterwarnings("ignore:impairments. an oscillator")
@pytest.mark.parametrize("slope", [15e12, 300e12])
def test_few_samples_hardly_tell_delays_apart_and_are_turned_all_the_same(n_samples, slope):
    radar, error_hz = radar_of(n_samples=n_samples, slope=slope), 3e4
    bent = PolynomialNonlinearity(error_hz=(error_hz,))
    alone = [dc.simulate(at(r), radar, impairments=(), dtype=np.complex128) for r in (1, 2)]

    cube = dc.simulate(at(1, 2), radar, impairments=[bent], dtype=np.complex128)

    first, last = np.exp(2j * np.pi * error_hz * np.array([2, 4]) / SPEED_OF_LIGHT)
    # The wrong one of the two delays for both echoes, and as much again.
    wrong = 4 * abs(last - first) * float(abs(alone[0]).max())
    assert float(abs(cube - alone[0] * first - alone[1] * last).max()) < wrong


def test_a_ramp_too_slow_to_tell_of_all_of_the_error_says_so(radar):
    chirp = replace(radar.frame.chirp, slope_hz_per_s=1e12)
    slow = replace(radar, frame=replace(radar.frame, chirp=chirp, n_chirps=2))
    noise = dc.impairments.PhaseNoise(offset_hz=[1e5], level_per_hz=[1e-9])
    with pytest.warns(dc.PhysicsWarning, match=r"fs\^2 / S = 100 samples") as told:
        dc.simulate(dc.Scene(), slow, impairments=[noise])
    assert len(told) == 1
