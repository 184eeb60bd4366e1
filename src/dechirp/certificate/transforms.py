"""Claims on the transforms: integration gain, and velocity measurement with one mixer."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dechirp.certificate.claim import CONFIDENCE, Check, Claim
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    complex_white_noise,
    reference_radar,
    target_scene,
)
from dechirp.certificate.trials import Job
from dechirp.core.units import to_decibels
from dechirp.processing.spectrum import Transform, mean_range_doppler_power
from dechirp.radar.radar import Radar
from dechirp.simulation.kernels import direct
from dechirp.simulation.kernels.base import Scatterers, Transmission
from dechirp.simulation.simulate import simulate_ideal_echoes
from dechirp.theory import confidence_intervals
from dechirp.theory.windows import Window, window_weights

N_NOISE_FRAMES = 40
"""Number of noise frames of 281,600 cells each; their mean power is known to 0.03 %, 0.0013 dB."""


def evaluate_claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """Return the claims on the transforms, in the order of the report."""
    noise = results["noise in map"]
    return _integration_gain_claim(noise[:, 0]), _velocity_sign_with_one_mixer_claim(noise)


def map_noise_trial_jobs() -> dict[str, Job]:
    """Return the jobs that the claims need."""
    return {
        "noise in map": Job(
            work=measure_mean_map_noise_power, n_trials=N_NOISE_FRAMES, arguments={}, block_size=10
        )
    }


def real_sampling_radar() -> Radar:
    """Return the reference radar with one mixer, so with real samples."""
    frame = reference_radar().frame
    return replace(
        reference_radar(), frame=replace(frame, chirp=replace(frame.chirp, sampling="real"))
    )


def measure_mean_map_noise_power(rng: np.random.Generator, n_trials: int) -> np.ndarray:
    """Return the mean power of noise maps of complex and of real samples, (n_trials, 2).

    The noise has unit power per sample.
    """
    shape = (reference_radar().frame.n_chirps, 1, reference_radar().frame.chirp.n_samples)
    mean_power_per_map = np.empty((n_trials, 2))
    for trial in range(n_trials):
        samples = complex_white_noise(rng, shape)
        real_samples = np.float32(np.sqrt(2)) * samples.real
        mean_power_per_map[trial, 0] = _range_doppler_power(samples, reference_radar()).mean()
        # The columns around DC and half the sample rate contain their own image.
        mean_power_per_map[trial, 1] = _range_doppler_power(real_samples, real_sampling_radar())[
            :, 2:-2
        ].mean()
    return mean_power_per_map


def _range_doppler_power(
    samples: np.ndarray, radar: Radar, window: Window = "rectangular"
) -> np.ndarray:
    """Return the power map (velocity, range) of a frame; a tone on a bin keeps its power."""
    frame = radar.frame
    over_range, over_velocity = (
        Transform(window=window, n_points=n, n_bins=n)
        for n in (frame.chirp.n_samples, frame.n_chirps)
    )
    return mean_range_doppler_power(samples, frame.chirp.sampling, over_range, over_velocity)


def _echo_power_map(radar: Radar, window: Window = "rectangular") -> np.ndarray:
    """Return the power map of the reference target without noise."""
    samples = simulate_ideal_echoes(target_scene(*REFERENCE_TARGET), radar).values[0]
    dtype = np.complex64 if radar.frame.chirp.sampling == "complex" else np.float32
    return _range_doppler_power(samples.astype(dtype), radar, window)


def _integration_gain_claim(mean_noise_power: np.ndarray) -> Claim:
    """Compare the peak of an echo on a bin with the mean noise of the map."""
    frame, chirp = reference_radar().frame, reference_radar().frame.chirp
    row, column = 5, 50
    doppler_hz = row / frame.duration_s
    velocity = doppler_hz * chirp.wavelength_m / 2
    # At mid-frame the beat frequency, including the Doppler frequency, lies on the bin.
    range_m = chirp.range_m(column * chirp.sample_rate_hz / chirp.n_samples - doppler_hz)
    echo = simulate_ideal_echoes(
        target_scene(range_m - velocity * frame.mid_frame_s, velocity), reference_radar()
    )
    power = np.mean(abs(echo.values) ** 2)
    peak = (
        _range_doppler_power(echo.values[0].astype(np.complex64), reference_radar()).max() / power
    )
    gains_db = to_decibels(peak / mean_noise_power)
    low, high = confidence_intervals.mean_interval(gains_db, confidence=CONFIDENCE)
    expected_db = float(to_decibels(reference_radar().integration_gain))
    return Claim(
        id="integration_gain",
        claim="Both transforms together increase the SNR by the number of samples times the number"
        " of chirps.",
        checks=(
            Check(
                name="peak SNR of the map over the SNR per sample",
                unit="dB",
                published=54.5,
                measured=float(np.mean(gains_db)),
                low=low,
                high=high,
                at_least=expected_db - 0.05,
                at_most=expected_db + 0.05,
                limit=expected_db,
                trials=mean_noise_power.size,
            ),
        ),
        note="Rectangular windows and an echo on a bin, so there is no window or straddling loss.",
    )


def _velocity_sign_with_one_mixer_claim(mean_noise_power: np.ndarray) -> Claim:
    carrier_image_db = [
        _mirror_image_level_db(unmodulated_carrier_echo(n_mixers)) for n_mixers in (1, 2)
    ]
    ramp_echo = simulate_ideal_echoes(
        target_scene(*REFERENCE_TARGET), real_sampling_radar()
    ).values[0, :, 0]
    half_map = _echo_power_map(real_sampling_radar(), "hann")
    row, column = np.unravel_index(np.argmax(half_map), half_map.shape)
    # Zero velocity is the middle row.
    mirrored_db = float(to_decibels(half_map[-row % len(half_map), column] / half_map[row, column]))
    peaks = [_echo_power_map(radar).max() for radar in (reference_radar(), real_sampling_radar())]
    snr_loss_db = to_decibels(
        peaks[0] / mean_noise_power[:, 0] / (peaks[1] / mean_noise_power[:, 1])
    )
    low, high = confidence_intervals.mean_interval(snr_loss_db, confidence=CONFIDENCE)
    ranges = [radar.frame.chirp.max_range_m for radar in (real_sampling_radar(), reference_radar())]
    return Claim(
        id="blind_doppler",
        claim="One mixer loses the sign of the velocity without a ramp; with a ramp the retained"
        " half"
        " of the spectrum contains it.",
        checks=(
            Check(
                name="no ramp, one mixer: image at the negative velocity",
                unit="dB",
                published="sign lost",
                measured=carrier_image_db[0],
                at_least=-0.01,
                at_most=0.01,
                limit=0.0,
            ),
            Check(
                name="no ramp, two mixers: image at the negative velocity",
                unit="dB",
                measured=carrier_image_db[1],
                at_most=-60.0,
            ),
            Check(
                name="ramp, one mixer: image at negative range and negative velocity",
                unit="dB",
                measured=_mirror_image_level_db(ramp_echo),
                at_least=-0.01,
                at_most=0.01,
                limit=0.0,
            ),
            Check(
                name="ramp, one mixer, retained half: level at the negative velocity",
                unit="dB",
                measured=mirrored_db,
                at_most=-60.0,
            ),
            Check(
                name="ramp, one mixer, retained half: velocity of the peak",
                unit="m/s",
                measured=float(reference_radar().frame.velocity_bins_m_per_s()[row]),
                at_least=REFERENCE_TARGET.velocity_m_per_s
                - reference_radar().frame.velocity_resolution_m_per_s,
                at_most=REFERENCE_TARGET.velocity_m_per_s
                + reference_radar().frame.velocity_resolution_m_per_s,
                limit=REFERENCE_TARGET.velocity_m_per_s,
            ),
            Check(
                name="map SNR with two mixers over that with one mixer",
                unit="dB",
                measured=float(np.mean(snr_loss_db)),
                low=low,
                high=high,
                at_least=2.96,
                at_most=3.06,
                limit=float(to_decibels(2)),
                trials=len(mean_noise_power),
            ),
            Check(
                name="unambiguous range with one mixer over that with two, by design",
                unit="1",
                measured=ranges[0] / ranges[1],
                at_least=0.5,
                at_most=0.5,
                limit=0.5,
            ),
        ),
        note="The images of one mixer follow from the symmetry of real samples. This symmetry does"
        " not imply a second image in the retained half. The report's argument therefore holds for"
        " a carrier without a ramp; with a ramp, one mixer halves the range and costs 3 dB, but the"
        " sign of the velocity is unambiguous.",
    )


def unmodulated_carrier_echo(n_mixers: int) -> np.ndarray:
    """Return the echo of the reference target for a carrier without a ramp, (chirp, sample)."""
    frame, chirp = reference_radar().frame, reference_radar().frame.chirp
    samples = np.zeros((frame.n_chirps, 1, chirp.n_samples), np.complex128)
    origin_m = np.zeros((1, 3))
    motion_m = np.array(
        [[[REFERENCE_TARGET.range_m, 0.0, 0.0]], [[REFERENCE_TARGET.velocity_m_per_s, 0.0, 0.0]]]
    )
    direct.add_echoes(
        samples,
        Scatterers(motion_m, np.ones(1), np.ones((1, 1)), np.ones((1, 1))),
        Transmission(
            starts_s=frame.chirp_starts_s,
            weights=frame.chirp_weights(),
            tx_m=origin_m,
            rx_m=origin_m,
            start_frequency_hz=chirp.start_frequency_hz,
            slope_hz_per_s=0.0,
            adc_start_s=0.0,
            sample_rate_hz=chirp.sample_rate_hz,
        ),
    )
    return samples[:, 0].real if n_mixers == 1 else samples[:, 0]


def _mirror_image_level_db(samples: np.ndarray) -> float:
    """Return the level of the image at negative range and velocity over the receding peak.

    `samples` (chirp, sample) are transformed with Hann windows. The spectrum is not cut to positive
    frequencies, contrary to a receiver of real samples.
    """
    tapers = [window_weights("hann", n) for n in samples.shape]
    power = abs(np.fft.fft2(samples * np.outer(*tapers))) ** 2
    receding = power[: len(power) // 2]
    row, column = np.unravel_index(np.argmax(receding), receding.shape)
    return float(to_decibels(power[-row, -column] / power[row, column]))
