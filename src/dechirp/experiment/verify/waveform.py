"""Claims on the waveform and its echo, which no chance touches: slope, beat frequency, power."""

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.echoes.echo import clean_echoes
from dechirp.experiment.verify import published
from dechirp.experiment.verify.claim import Check, Claim
from dechirp.experiment.verify.looks import RCS_M2, REFERENCE, at_mid_frame, radar, scene
from dechirp.radar.chirp import Chirp


def claims() -> tuple[Claim, ...]:
    """The claims of this file, in the order of the report."""
    return _chirp_linearity(), _beat_frequency(), _echo_power()


def synthesised(chirp: Chirp, time_s: np.ndarray) -> np.ndarray:
    """The ramp that is sent, mixed down by its start frequency, at times from its start."""
    cycles = chirp.slope_hz_per_s * time_s**2 / 2
    return np.exp(2j * np.pi * (cycles % 1))


def dechirped(chirp: Chirp, *, delay_s: float) -> np.ndarray:
    """The ramp times the conjugate of itself so much later, at the samples of the converter."""
    time_s = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    carrier = np.exp(2j * np.pi * (chirp.start_frequency_hz * delay_s % 1))
    return carrier * synthesised(chirp, time_s) * synthesised(chirp, time_s - delay_s).conj()


def instantaneous_frequency_hz(
    samples: np.ndarray, sample_rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times (s) and frequencies between the samples of a complex signal, from its phase."""
    turns = np.angle(samples[1:] * samples[:-1].conj()) / (2 * np.pi)
    return (np.arange(turns.size) + 0.5) / sample_rate_hz, turns * sample_rate_hz


def _chirp_linearity() -> Claim:
    chirp = radar().frame.chirp
    rate_hz = 4 * published.BANDWIDTH_HZ
    instants_s = np.arange(round(chirp.ramp_duration_s * rate_hz)) / rate_hz
    time_s, frequency_hz = instantaneous_frequency_hz(synthesised(chirp, instants_s), rate_hz)
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
    chirp, range_m = radar().frame.chirp, REFERENCE.range_m
    echo = clean_echoes(scene(range_m, 0.0), radar()).values[0, 0, 0]
    _, frequency_hz = instantaneous_frequency_hz(echo, chirp.sample_rate_hz)
    right = chirp.beat_frequency_hz(range_m)
    mixed = dechirped(chirp, delay_s=2 * range_m / SPEED_OF_LIGHT)
    apart_rad = np.max(abs(np.angle(echo * mixed.conj())))
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
            Check(
                name="phase of the echo against the ramp mixed with itself, delayed",
                unit="rad",
                measured=float(apart_rad),
                at_most=1e-6,
                limit=0.0,
            ),
        ),
        note="Published: the report's formula with its slope and c = 3e8 m/s.",
    )


def _echo_power() -> Claim:
    seen = scene(*REFERENCE)
    measured = float(np.mean(abs(clean_echoes(seen, radar()).values) ** 2))
    hardware, wavelength_m = radar().known_hardware(), radar().frame.chirp.wavelength_m
    spread = (4 * np.pi) ** 3 * at_mid_frame(REFERENCE).range_m ** 4 * hardware.loss
    gain = float(hardware.tx_gain())
    right = hardware.transmit_power_w * (gain * wavelength_m) ** 2 * RCS_M2 / spread
    power_dbm, gain_db = (float(decibels(x)) for x in (hardware.transmit_power_w * 1e3, gain))
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
                name="over the radar equation, written out here",
                unit="dB",
                measured=float(decibels(measured / right)),
                at_least=-0.001,
                at_most=0.001,
                limit=0.0,
            ),
        ),
        note=f"With {power_dbm:.3g} dBm, antennas of {gain_db:.3g} dBi and a car of 10 dBsm.",
    )
