"""Claims on the transforms: what they gain, and what one mixer leaves them of the velocity."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dechirp.core.units import decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.echoes.kernels import direct
from dechirp.echoes.kernels.base import Scatterers, Sent
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim
from dechirp.experiment.verify.looks import REFERENCE, radar, scene, white_noise
from dechirp.experiment.verify.trials import Job
from dechirp.process.spectrum import Transform, mean_power
from dechirp.radar.radar import Radar
from dechirp.theory import intervals
from dechirp.theory.windows import Window, taper

N_NOISE_FRAMES = 40
"""Of 281,600 cells each: their mean power is known to 0.03 %, 0.0013 dB."""


def claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """The claims of this file, in the order of the report."""
    noise = results["noise in map"]
    return _integration_gain(noise[:, 0]), _blind_doppler(noise)


def jobs() -> dict[str, Job]:
    """Trials that they rest on."""
    return {"noise in map": Job(work=noise_in_map, n_trials=N_NOISE_FRAMES, told={}, n_each=10)}


def one_mixer_radar() -> Radar:
    """The reference radar with real samples."""
    frame = radar().frame
    return replace(radar(), frame=replace(frame, chirp=replace(frame.chirp, sampling="real")))


def noise_in_map(rng: np.random.Generator, n_trials: int) -> np.ndarray:
    """Mean power of a map of noise of unit power in each sample: complex, real, (n_trials, 2)."""
    shape = (radar().frame.n_chirps, 1, radar().frame.chirp.n_samples)
    out = np.empty((n_trials, 2))
    for trial in range(n_trials):
        samples = white_noise(rng, shape)
        one_mixer = np.float32(np.sqrt(2)) * samples.real
        out[trial, 0] = _map(samples, radar()).mean()
        # The rows about DC and half the sample rate are their own image.
        out[trial, 1] = _map(one_mixer, one_mixer_radar())[:, 2:-2].mean()
    return out


def _map(samples: np.ndarray, by: Radar, window: Window = "rectangular") -> np.ndarray:
    """Power of a frame (velocity, range); a tone on a bin keeps its power."""
    frame = by.frame
    over_range, over_velocity = (
        Transform(window=window, n_points=n, n_bins=n)
        for n in (frame.chirp.n_samples, frame.n_chirps)
    )
    return mean_power(samples, frame.chirp.sampling, over_range, over_velocity)


def _echo_map(by: Radar, window: Window = "rectangular") -> np.ndarray:
    """Map of the reference target without noise."""
    samples = clean_echoes(scene(*REFERENCE), by).values[0]
    single = np.complex64 if by.frame.chirp.sampling == "complex" else np.float32
    return _map(samples.astype(single), by, window)


def _integration_gain(noise: np.ndarray) -> Claim:
    """From the peak of an echo on a bin, and the mean of the noise in the map."""
    frame, chirp = radar().frame, radar().frame.chirp
    row, column = 5, 50
    doppler_hz = row / frame.duration_s
    velocity = doppler_hz * chirp.wavelength_m / 2
    # At mid-frame the echo beats at the bin, Doppler frequency included.
    at_m = chirp.range_m(column * chirp.sample_rate_hz / chirp.n_samples - doppler_hz)
    clean = clean_echoes(scene(at_m - velocity * frame.mid_frame_s, velocity), radar())
    power = np.mean(abs(clean.values) ** 2)
    peak = _map(clean.values[0].astype(np.complex64), radar()).max() / power
    gains_db = decibels(peak / noise)
    low, high = intervals.mean(gains_db, confidence=CONFIDENCE)
    right = float(decibels(radar().integration_gain))
    return Claim(
        id="integration_gain",
        claim="Both transforms together raise the SNR by the number of samples times chirps.",
        checks=(
            Check(
                name="SNR of the peak in the map over that in one sample",
                unit="dB",
                published=54.5,
                measured=float(np.mean(gains_db)),
                low=low,
                high=high,
                at_least=right - 0.05,
                at_most=right + 0.05,
                limit=right,
                trials=noise.size,
            ),
        ),
        note="Rectangular windows, an echo on a bin: neither costs anything.",
    )


def _blind_doppler(noise: np.ndarray) -> Claim:
    still = [_image_db(carrier_echo(n_mixers)) for n_mixers in (1, 2)]
    swept = clean_echoes(scene(*REFERENCE), one_mixer_radar()).values[0, :, 0]
    kept = _echo_map(one_mixer_radar(), "hann")
    row, column = np.unravel_index(np.argmax(kept), kept.shape)
    # Zero velocity is the middle row.
    turned_db = float(decibels(kept[-row % len(kept), column] / kept[row, column]))
    peaks = [_echo_map(by).max() for by in (radar(), one_mixer_radar())]
    lost_db = decibels(peaks[0] / noise[:, 0] / (peaks[1] / noise[:, 1]))
    low, high = intervals.mean(lost_db, confidence=CONFIDENCE)
    ranges = [by.frame.chirp.max_range_m for by in (one_mixer_radar(), radar())]
    return Claim(
        id="blind_doppler",
        claim="Without a ramp one mixer loses the sign of the velocity; with a ramp the half"
        " spectrum that it keeps retains it.",
        checks=(
            Check(
                name="no ramp, one mixer: image at minus the velocity",
                unit="dB",
                published="sign lost",
                measured=still[0],
                at_least=-0.01,
                at_most=0.01,
                limit=0.0,
            ),
            Check(
                name="no ramp, two mixers: the same cell",
                unit="dB",
                measured=still[1],
                at_most=-60.0,
            ),
            Check(
                name="ramp, one mixer: image at minus range and minus velocity",
                unit="dB",
                measured=_image_db(swept),
                at_least=-0.01,
                at_most=0.01,
                limit=0.0,
            ),
            Check(
                name="ramp, one mixer, in the half that is kept: at minus the velocity",
                unit="dB",
                measured=turned_db,
                at_most=-60.0,
            ),
            Check(
                name="ramp, one mixer, in the half that is kept: velocity of the peak",
                unit="m/s",
                measured=float(radar().frame.velocity_bins_m_per_s()[row]),
                at_least=REFERENCE.velocity_m_per_s - radar().frame.velocity_resolution_m_per_s,
                at_most=REFERENCE.velocity_m_per_s + radar().frame.velocity_resolution_m_per_s,
                limit=REFERENCE.velocity_m_per_s,
            ),
            Check(
                name="SNR in the map of two mixers over that of one",
                unit="dB",
                measured=float(np.mean(lost_db)),
                low=low,
                high=high,
                at_least=2.96,
                at_most=3.06,
                limit=float(decibels(2)),
                trials=len(noise),
            ),
            Check(
                name="unambiguous range of one mixer over two, by design",
                unit="1",
                measured=ranges[0] / ranges[1],
                at_least=0.5,
                at_most=0.5,
                limit=0.5,
            ),
        ),
        note="The images of one mixer follow from the symmetry of real samples; that the kept"
        " half holds no second one does not. So the report's argument holds for a carrier"
        " without a ramp; with one, the echo keeps its sign, at half the range and 3 dB.",
    )


def carrier_echo(n_mixers: int) -> np.ndarray:
    """Echo of the reference target without a ramp, (chirp, sample)."""
    frame, chirp = radar().frame, radar().frame.chirp
    samples = np.zeros((frame.n_chirps, 1, chirp.n_samples), np.complex128)
    here_m = np.zeros((1, 3))
    path_m = np.array([[[REFERENCE.range_m, 0.0, 0.0]], [[REFERENCE.velocity_m_per_s, 0.0, 0.0]]])
    direct.add(
        samples,
        Scatterers(path_m, np.ones(1), np.ones((1, 1)), np.ones((1, 1))),
        Sent(
            starts_s=frame.chirps_s,
            weights=frame.sent_weights(),
            tx_m=here_m,
            rx_m=here_m,
            start_frequency_hz=chirp.start_frequency_hz,
            slope_hz_per_s=0.0,
            adc_start_s=0.0,
            sample_rate_hz=chirp.sample_rate_hz,
        ),
    )
    return samples[:, 0].real if n_mixers == 1 else samples[:, 0]


def _image_db(samples: np.ndarray) -> float:
    """Power of the whole spectrum at minus range and velocity over that at the receding peak.

    `samples` (chirp, sample), Hann windows; every frequency is kept, as no receiver does of
    real samples.
    """
    tapers = [taper("hann", n) for n in samples.shape]
    power = abs(np.fft.fft2(samples * np.outer(*tapers))) ** 2
    receding = power[: len(power) // 2]
    row, column = np.unravel_index(np.argmax(receding), receding.shape)
    return float(decibels(power[-row, -column] / power[row, column]))
