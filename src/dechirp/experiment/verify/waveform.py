"""Claims on the waveform and its echo: slope, beat frequency, power, gain, sign of Doppler."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dechirp.core.units import decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.echoes.kernels.direct import add_echoes
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import CONFIDENCE, Check, Claim
from dechirp.experiment.verify.looks import radar, scene, white_noise
from dechirp.experiment.verify.trials import Job
from dechirp.process.spectrum import Transform, mean_power, range_doppler
from dechirp.radar.budget import received_power_w
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar
from dechirp.scene.scene import truth
from dechirp.theory import intervals
from dechirp.theory.windows import taper

N_NOISE_FRAMES = 40
"""Of 281,600 cells each: their mean power is known to 0.03 %, 0.0013 dB."""


def claims(results: Mapping[str, np.ndarray]) -> tuple[Claim, ...]:
    """The claims of this file, in the order of the report."""
    return (
        _chirp_linearity(),
        _beat_frequency(),
        _integration_gain(results["noise in map"][:, 0]),
        _echo_power(),
        _blind_doppler(results["noise in map"]),
    )


def jobs() -> dict[str, Job]:
    """Trials that they rest on."""
    return {"noise in map": Job(work=noise_in_map, n_trials=N_NOISE_FRAMES, told={}, n_each=10)}


def synthesised(chirp: Chirp, sample_rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """The ramp that is sent, mixed down by its start frequency: times (s) and samples."""
    time_s = np.arange(round(chirp.ramp_duration_s * sample_rate_hz)) / sample_rate_hz
    cycles = chirp.slope_hz_per_s * time_s**2 / 2
    return time_s, np.exp(2j * np.pi * (cycles % 1))


def instantaneous_frequency_hz(
    samples: np.ndarray, sample_rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and frequencies between the samples of a complex signal, from its phase."""
    turns = np.angle(samples[1:] * samples[:-1].conj()) / (2 * np.pi)
    return (np.arange(turns.size) + 0.5) / sample_rate_hz, turns * sample_rate_hz


def _chirp_linearity() -> Claim:
    chirp = radar().frame.chirp
    rate_hz = 4 * published.BANDWIDTH_HZ
    _, samples = synthesised(chirp, rate_hz)
    time_s, frequency_hz = instantaneous_frequency_hz(samples, rate_hz)
    slope, start_hz = np.polyfit(time_s, frequency_hz, 1)
    error_hz = np.max(abs(frequency_hz - start_hz - slope * time_s))
    right = published.BANDWIDTH_HZ / chirp.ramp_duration_s
    return Claim(
        id="chirp_linearity",
        claim="The ramp rises in a straight line, by its bandwidth in its duration.",
        checks=(
            Check(
                name="slope of the synthesised chirp",
                unit="Hz/s",
                published=published.SLOPE_HZ_PER_S,
                measured=float(slope),
                at_least=right * (1 - 1e-6),
                at_most=right * (1 + 1e-6),
                limit=right,
            ),
            Check(
                name="largest departure from the line",
                unit="Hz",
                measured=float(error_hz),
                at_most=1.0,
                limit=0.0,
            ),
        ),
        note="The slope is fitted to the phase steps of the synthesised samples.",
    )


def _beat_frequency() -> Claim:
    chirp = radar().frame.chirp
    cube = clean_echoes(scene(50.0, 0.0), radar()).values[0, 0, 0]
    _, frequency_hz = instantaneous_frequency_hz(cube, chirp.sample_rate_hz)
    right = chirp.beat_frequency_hz(50.0)
    return Claim(
        id="beat_frequency_50m",
        claim="A target at rest at 50 m beats at 2 S R / c.",
        checks=(
            Check(
                name="beat frequency of the dechirped echo",
                unit="Hz",
                published=2 * published.SLOPE_HZ_PER_S * 50.0 / published.SPEED_OF_LIGHT,
                measured=float(np.mean(frequency_hz)),
                at_least=right * (1 - 1e-6),
                at_most=right * (1 + 1e-6),
                limit=right,
            ),
        ),
        note="Published: the report's formula with its slope and c = 3e8 m/s.",
    )


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


def _echo_power() -> Claim:
    seen = scene(50.0, 10.0)
    measured = float(np.mean(abs(clean_echoes(seen, radar()).values) ** 2))
    at_m = float(truth(seen, radar()).range[0, 0])
    right = float(received_power_w(radar(), range_m=at_m, rcs_m2=10.0))
    hardware = radar().known_hardware()
    power_dbm, gain_db = (
        float(decibels(x)) for x in (hardware.transmit_power_w * 1e3, hardware.antenna_gain)
    )
    return Claim(
        id="echo_power_50m",
        claim="The echo of a car at 50 m carries picowatts.",
        checks=(
            Check(
                name="mean power of the samples of the echo",
                unit="W",
                published="picowatts",
                measured=measured,
                at_least=1e-12,
                at_most=1e-9,
                limit=right,
            ),
            Check(
                name="over the radar equation",
                unit="dB",
                measured=float(decibels(measured / right)),
                at_least=-0.001,
                at_most=0.001,
                limit=0.0,
            ),
        ),
        note=f"With {power_dbm:.3g} dBm, antennas of {gain_db:.3g} dBi and a car of 10 dBsm.",
    )


def noise_in_map(rng: np.random.Generator, n_trials: int) -> np.ndarray:
    """Mean power of a map of noise of unit power in each sample: complex, real, (n_trials, 2)."""
    shape = (radar().frame.n_chirps, 1, radar().frame.chirp.n_samples)
    out = np.empty((n_trials, 2))
    for trial in range(n_trials):
        samples = white_noise(rng, shape)
        one_mixer = np.float32(np.sqrt(2)) * samples.real
        out[trial, 0] = _map(samples, radar()).mean()
        # The rows about DC and half the sample rate are their own image.
        out[trial, 1] = _map(one_mixer, _with_one_mixer())[:, 2:-2].mean()
    return out


def _map(samples: np.ndarray, by: Radar) -> np.ndarray:
    """Power (velocity, range) under a rectangular window; a tone on a bin keeps its power."""
    frame = by.frame
    over = [
        Transform(window="rectangular", n_points=n, n_bins=n)
        for n in (frame.chirp.n_samples, frame.n_chirps)
    ]
    return mean_power(range_doppler(samples, frame.chirp.sampling, *over))


def _with_one_mixer() -> Radar:
    frame = radar().frame
    return replace(radar(), frame=replace(frame, chirp=replace(frame.chirp, sampling="real")))


def _blind_doppler(noise: np.ndarray) -> Claim:
    still = [_image_db(mixers, slope_hz_per_s=0.0, half=False) for mixers in (1, 2)]
    swept = radar().frame.chirp.slope_hz_per_s
    lost_db = decibels(noise[:, 1] / noise[:, 0])
    low, high = intervals.mean(lost_db, confidence=CONFIDENCE)
    ranges = [by.frame.chirp.max_range_m for by in (_with_one_mixer(), radar())]
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
                measured=_image_db(1, slope_hz_per_s=swept, half=False),
                at_least=-0.01,
                at_most=0.01,
                limit=0.0,
            ),
            Check(
                name="ramp, one mixer, in the half that is kept: at minus the velocity",
                unit="dB",
                measured=_image_db(1, slope_hz_per_s=swept, half=True),
                at_most=-60.0,
            ),
            Check(
                name="noise of the image band: SNR of two mixers over one",
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
                name="unambiguous range of one mixer over two",
                unit="1",
                measured=ranges[0] / ranges[1],
                at_least=0.5,
                at_most=0.5,
                limit=0.5,
            ),
        ),
        note="The report's argument holds for a carrier without a ramp. With one, the echo keeps"
        " its sign, at half the range and 3 dB.",
    )


def _image_db(n_mixers: int, *, slope_hz_per_s: float, half: bool) -> float:
    """Power of the map at minus the velocity of a target over that at its own.

    At minus its range as well, unless only the half of positive ranges is looked at. A
    target at 50 m and 10 m/s, Hann windows.
    """
    frame, chirp = radar().frame, radar().frame.chirp
    samples = np.zeros((frame.n_chirps, 1, chirp.n_samples), np.complex128)
    add_echoes(
        samples,
        np.ones(1),
        np.array([[50.0, 0.0, 0.0]]),
        np.array([[10.0, 0.0, 0.0]]),
        np.zeros(3),
        np.zeros((1, 3)),
        chirp.start_frequency_hz,
        slope_hz_per_s,
        frame.interval_s,
        0.0,
        chirp.sample_rate_hz,
    )
    sampled = samples.real if n_mixers == 1 else samples
    tapers = [taper("hann", n) for n in (frame.n_chirps, chirp.n_samples)]
    power = abs(np.fft.fft2(sampled[:, 0] * np.outer(*tapers))) ** 2
    ahead = power[: frame.n_chirps // 2]  # receding velocities
    row, column = np.unravel_index(np.argmax(ahead), ahead.shape)
    image = power[-row, column if half else -column]
    return float(decibels(image / power[row, column]))
