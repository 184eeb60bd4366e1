"""Errors of directions due to phases of channels without calibration."""

from dataclasses import replace

import numpy as np
import pytest
from test_angle_motion_compensation import HALF_M, make_mimo_radar, make_target

import dechirp as dc
from dechirp.experiments.scenario import RecordingSource
from dechirp.processing.angle.capon import Capon
from dechirp.processing.angle.fft import Fft
from dechirp.processing.angle.maximum_likelihood import MaximumLikelihood
from dechirp.processing.angle.music import Music
from dechirp.processing.channel_errors import channel_error_findings
from dechirp.processing.direction_finding import checked_direction_aperture, estimate_sources
from dechirp.processing.refine import SidelobeErrors
from nightly import nightly, nightly_except


def make_amplitudes(radar, azimuth_rad, antenna_phases_rad, noise_power, rng):
    """Return amplitudes of the elements, (n, 12), in noise; phases (n, n_tx + n_rx)."""
    n_tx = len(radar.array.tx_m)
    n_rx = len(radar.array.rx_m)
    of_transmitters = np.repeat(antenna_phases_rad[:, :n_tx], n_rx, axis=1)
    of_receivers = np.tile(antenna_phases_rad[:, n_tx:], (1, n_tx))
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    echoes = aperture.steering_vectors(azimuth_rad) * np.exp(1j * (of_transmitters + of_receivers))
    noise = rng.normal(size=(*echoes.shape, 2)) @ [1, 1j] * np.sqrt(noise_power / 2)[..., None]
    return echoes + noise


def estimate_azimuths(radar, amplitudes, noise_power, estimator=None):
    """Return azimuths and standard errors of targets at rest, by a Fourier transform by default."""
    estimator = estimator or Fft()
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    still = np.zeros(len(amplitudes))
    sources = estimate_sources(amplitudes, still, noise_power, radar, estimator, aperture)
    return sources.azimuth_rad, sources.azimuth_std_rad


def make_line(n_elements):
    return dc.Array(rx_m=tuple((0.0, n * HALF_M, 0.0) for n in range(n_elements)))


def make_radar(radar, n_tx, n_elements=12):
    if n_tx == 1:
        return replace(radar, array=make_line(n_elements))
    return make_mimo_radar(radar, dc.multiplexing.Tdm(order=(0, 1, 2)))


@nightly
@pytest.mark.parametrize("n_tx", [1, 3])
@pytest.mark.parametrize("phase_std_deg", [5, 20])
def test_stated_errors_contain_phases_of_channels(radar, n_tx, phase_std_deg):
    radar, rng, n_trials = make_radar(radar, n_tx), np.random.default_rng(3), 1200
    azimuth = rng.uniform(-1, 1, n_trials)
    phases = np.radians(phase_std_deg) * rng.normal(size=(n_trials, n_tx + 12 // n_tx))
    noise = np.full(n_trials, 1e-4)  # 40 dB in an element
    amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)

    # One by one: the channels of each trial are others.
    estimates = [estimate_azimuths(radar, amplitudes[[i]], noise[[i]]) for i in range(n_trials)]

    found, std = np.squeeze(estimates).T
    # Student's distribution with ten degrees of freedom (n_tx 1) has squares of variance 5, with
    # four a heavy tail: the mean of 1,200 varies by 0.07 or more. Without the channels it is 150.
    assert 0.6 < np.mean(((found - azimuth) / std) ** 2) < 1.3


@pytest.mark.parametrize("estimator", [Capon(), Music()], ids=["capon", "music"])
def test_directions_of_one_source_stay_in_its_main_lobe_with_phases_of_channels(radar, estimator):
    """Phases of channels let beams of Capon suppress a strong echo: higher peaks elsewhere."""
    radar, rng, n_trials = make_radar(radar, 1), np.random.default_rng(8), 1000
    azimuth = rng.uniform(-1, 1, n_trials)
    phases = np.radians(13) * rng.normal(size=(n_trials, 13))
    noise = np.full(n_trials, 1e-6)  # 60 dB in an element
    amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)

    found, _ = estimate_azimuths(radar, amplitudes, noise, estimator)

    # The main lobe of 12 elements at half a wavelength ends at a sine of 1/6.
    assert np.all(abs(np.sin(found) - np.sin(azimuth)) < 1 / 6)


@pytest.mark.parametrize("n_tx", [1, 3])
def test_exact_arrays_keep_the_errors_of_noise(radar, n_tx):
    radar, rng, n_trials = make_radar(radar, n_tx), np.random.default_rng(4), 6000
    azimuth = rng.uniform(-1, 1, n_trials)
    noise = np.full(n_trials, 1e-3)
    phases = np.zeros((n_trials, n_tx + 12 // n_tx))
    amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)

    found, std = estimate_azimuths(radar, amplitudes, noise)

    # The mean of 6,000 squares varies by 1.8 %, five times which is 9 %.
    assert np.mean(((found - azimuth) / std) ** 2) == pytest.approx(0.99, abs=0.09)


@nightly
def test_weak_echoes_have_the_errors_that_strong_ones_show(radar):
    radar, rng, n_trials = make_radar(radar, 1), np.random.default_rng(5), 1200
    noise = np.array([1e-4, 1e-2])  # 40 and 20 dB in an element
    squares = []
    for _ in range(n_trials):
        azimuth = rng.uniform(-1, 1, 2)
        phases = np.tile(np.radians(5) * rng.normal(size=13), (2, 1))
        amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)
        found, std = estimate_azimuths(radar, amplitudes, noise)
        squares.append(((found[1] - azimuth[1]) / std[1]) ** 2)

    # Noise of 4 degrees hides phases of 5 degrees: from the weak echo alone the mean is 1.6.
    assert 0.6 < np.mean(squares) < 1.3


@pytest.mark.parametrize("phase_std_rad", [0.0, 0.2])
def test_finding_recommends_to_calibrate_arrays_with_phases_of_their_own(radar, phase_std_rad):
    mismatch = dc.impairments.ChannelMismatch(phase_std_rad=phase_std_rad)
    scenario = dc.Scenario(
        radar=make_radar(radar, 1),
        scene=dc.Scene(targets=[make_target(-20, 3)]),
        impairments=(dc.impairments.ThermalNoise(), mismatch),
    )

    result = dc.run(scenario)

    findings = [str(finding) for finding in result.findings if "calibrate" in str(finding)]
    if phase_std_rad == 0:
        assert findings == []
    else:
        (finding,) = findings
        assert "phases of the channels differ" in finding
        assert "dechirp calibrate REFLECTOR --azimuth ANGLE" in finding
        assert "--set chain.angle.n_sources=2" in finding


def test_finding_recommends_no_estimator_of_two_sources_where_one_is_used(radar):
    (finding,) = channel_error_findings([0.3], radar, resolves_two_sources=True)

    assert "dechirp calibrate" in finding.fix and "n_sources" not in finding.fix


@nightly
@pytest.mark.parametrize("n_elements", [3, 4])
@pytest.mark.parametrize("phase_std_deg", [5, 20])
def test_few_elements_state_the_errors_of_typical_boards(radar, n_elements, phase_std_deg):
    radar, rng, n_trials = make_radar(radar, 1, n_elements), np.random.default_rng(8), 500
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    azimuth, noise = rng.uniform(-0.7, 0.7, n_trials), np.full(n_trials, 1e-5)
    phases = np.radians(phase_std_deg) * rng.normal(size=(n_trials, n_elements))
    gains = 1 + 0.12 * rng.normal(size=(n_trials, n_elements))  # 1 dB
    errors = rng.normal(size=(n_trials, n_elements, 2)) @ [1, 1j] * np.sqrt(noise[0] / 2)
    amplitudes = aperture.steering_vectors(azimuth) * gains * np.exp(1j * phases) + errors

    squares = []
    for trial in range(n_trials):
        found, std = estimate_azimuths(radar, amplitudes[[trial]], noise[[trial]])
        squares.append(((found[0] - azimuth[trial]) / std[0]) ** 2)

    # Two residuals or one have no mean of their own: Student's distribution with the prior of 10
    # degrees. From the noise alone, the mean is 10,000 and more.
    squares = np.array(squares)[np.isfinite(squares)]
    assert len(squares) > 0.9 * n_trials
    assert 0.02 < np.mean(squares) < 2


@pytest.mark.parametrize("n_elements", [8, 12])
@pytest.mark.parametrize("separation_deg", [3, 10])
def test_directions_of_merged_sources_state_their_separation(radar, n_elements, separation_deg):
    radar, rng, n_trials = make_radar(radar, 1, n_elements), np.random.default_rng(9), 300
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    azimuth = rng.uniform(-0.5, 0.5, n_trials)
    other = azimuth + np.radians(separation_deg)
    noise = np.full(n_trials, 10**-4.5)
    ratio = 0.8 * np.exp(2j * np.pi * rng.uniform(size=(n_trials, 1)))
    errors = rng.normal(size=(n_trials, n_elements, 2)) @ [1, 1j] * np.sqrt(noise[0] / 2)
    echoes = aperture.steering_vectors(azimuth) + ratio * aperture.steering_vectors(other)

    found, std = estimate_azimuths(radar, echoes + errors, noise)

    # The spread squared is half of the separation squared where both are in phase, and more if not:
    # at the middle between them, the square of the error to the nearer one is its share. Without
    # the spread, means are 400 to 25,000.
    nearest = np.minimum(abs(found - azimuth), abs(found - other))
    assert np.mean((nearest / std) ** 2) < 1


@pytest.mark.parametrize("n_tx", nightly_except([1], [1, 3]))
@pytest.mark.parametrize("phase_std_deg", nightly_except(1, [0, 10]))
def test_two_sources_in_a_cell_contain_phases_of_channels(radar, n_tx, phase_std_deg):
    radar, rng, n_trials = make_radar(radar, n_tx), np.random.default_rng(10), 150
    noise, still = np.array([10**-4.5]), np.zeros(1)
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    squares = []
    for _ in range(n_trials):
        azimuth = rng.uniform(-0.6, 0) + np.array([0, 0.5])
        phases = np.tile(np.radians(phase_std_deg) * rng.normal(size=n_tx + 12 // n_tx), (2, 1))
        echoes = make_amplitudes(radar, azimuth, phases, np.zeros(2), rng)
        errors = rng.normal(size=(1, 12, 2)) @ [1, 1j] * np.sqrt(noise / 2)
        echo = echoes[:1] + 0.8 * np.exp(2j * np.pi * rng.uniform()) * echoes[1:] + errors
        sources = estimate_sources(
            echo, still, noise, radar, MaximumLikelihood(n_sources=2), aperture
        )
        order = np.argsort(sources.azimuth_rad)
        deviation = (sources.azimuth_rad[order] - azimuth) / sources.azimuth_std_rad[order]
        squares.extend(deviation**2)

    # 300 squares vary by 8 %, five times which is 0.4; the phases are a Student's distribution with
    # a heavier tail, stated on the wide side. Without the channels, the mean is 2,000.
    assert 0.3 < np.mean(squares) < 1.5


def test_extended_echoes_do_not_widen_the_errors_of_an_exact_point_target(radar):
    radar, rng = make_radar(radar, 1), np.random.default_rng(6)
    noise = np.full(7, 1e-5)
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    stated_rad = []
    for _ in range(50):
        azimuth = rng.uniform(-0.7, 0.7, 7)
        amplitudes = make_amplitudes(radar, azimuth, np.zeros((7, 13)), noise, rng)
        # All but the first are two scatterers, a quarter of a beamwidth apart.
        amplitudes[1:] += 0.5 * 1j * aperture.steering_vectors(azimuth[1:] + 0.05)
        _, std = estimate_azimuths(radar, amplitudes, noise)
        stated_rad.append(std[0])
    _, noise_std = estimate_azimuths(
        radar, make_amplitudes(radar, np.zeros(1), np.zeros((1, 13)), noise[:1], rng), noise[:1]
    )

    # Within +-0.7 rad, the beam is at most 1 / cos 0.7 = 1.31 times as wide.
    assert np.median(stated_rad) < 1.5 * noise_std[0]


def test_curved_waves_of_near_targets_do_not_widen_errors(radar):
    radar = make_radar(radar, 1)
    stated_rad = [
        float(detections.azimuth_std[int(np.argmax(detections.snr.values))])
        for range_m in (3.0, 30.0)
        for target in (dc.Target(position_m=(range_m, 0, 0), rcs_m2=range_m**4 / 1e3),)
        for detections in (
            dc.detect(dc.simulate(dc.Scene(targets=[target]), radar, seed=1), radar),
        )
    ]

    # Equal SNR; the wave is 13 degrees ahead at the ends of the array at 3 m, ten times the noise.
    assert stated_rad[0] == pytest.approx(stated_rad[1], rel=0.2)


def test_note_states_that_pairs_of_elements_do_not_show_their_phases(radar, tmp_path):
    radar = replace(radar, array=make_line(2))
    scene = dc.Scene(targets=[make_target(-20, 3)])
    cube = dc.simulate(scene, radar, impairments=(dc.impairments.ThermalNoise(),), seed=1)
    path = tmp_path / "pair.h5"
    dc.write(dc.recording_from_cube(cube, radar), path)

    result = dc.run(dc.Scenario(recording=RecordingSource(path=str(path))))

    (note,) = (str(finding) for finding in result.findings if "noise alone" in str(finding))
    assert "2 elements have no phases" in note and "5 receivers of one transmitter" in note


@nightly
def test_sidelobes_from_the_same_direction_do_not_hide_phases_of_channels(radar):
    radar, rng, n_trials = make_radar(radar, 1), np.random.default_rng(11), 400
    aperture = checked_direction_aperture(radar, dc.FieldOfView())
    noise, squares = np.array([1e-6]), []
    for _ in range(n_trials):
        azimuth = rng.uniform(-1, 1, 1)
        phases = np.radians(1.5) * rng.normal(size=(1, 13))
        amplitudes = make_amplitudes(radar, azimuth, phases, noise, rng)
        # An extended echo of the same direction, 26 dB weaker, changes the amplitude alone.
        sidelobe = 0.05 * np.exp(2j * np.pi * rng.uniform()) * aperture.steering_vectors(azimuth)
        errors = SidelobeErrors(sidelobe[:, None], *np.ones((3, 1)))
        sources = estimate_sources(
            amplitudes + sidelobe, np.zeros(1), noise, radar, Fft(), aperture, sidelobes=errors
        )
        squares.append(((sources.azimuth_rad[0] - azimuth[0]) / sources.azimuth_std_rad[0]) ** 2)

    # As above, for Student's distribution with ten degrees of freedom: the mean of 400 varies by
    # 0.11. Without the channels, whose residual passed as sidelobes, it is 336.
    assert 0.5 < np.mean(squares) < 1.5
