"""Deterministic claims on the waveform and its echo: slope, beat frequency and power."""

import numpy as np

from dechirp.certificate import published
from dechirp.certificate.claim import Check, Claim
from dechirp.certificate.reference_trials import (
    RCS_M2,
    REFERENCE_TARGET,
    motion_at_mid_frame,
    reference_radar,
    target_scene,
)
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.radar.chirp import Chirp
from dechirp.simulation.simulate import simulate_ideal_echoes


def evaluate_claims() -> tuple[Claim, ...]:
    """Return the claims on the waveform, in the order of the report."""
    return (
        _ramp_is_linear_claim(),
        _beat_frequency_follows_range_claim(),
        _echo_power_follows_radar_equation_claim(),
    )


def synthesise_ramp(chirp: Chirp, time_s: np.ndarray) -> np.ndarray:
    """Return the transmitted ramp, mixed down by its start frequency, at times from its start."""
    cycles = chirp.slope_hz_per_s * time_s**2 / 2
    return np.exp(2j * np.pi * (cycles % 1))


def dechirp_delayed_ramp(chirp: Chirp, *, delay_s: float) -> np.ndarray:
    """Return the ramp times the conjugate of its delayed copy, at the ADC sample times."""
    time_s = chirp.adc_start_s + np.arange(chirp.n_samples) / chirp.sample_rate_hz
    carrier = np.exp(2j * np.pi * (chirp.start_frequency_hz * delay_s % 1))
    return (
        carrier * synthesise_ramp(chirp, time_s) * synthesise_ramp(chirp, time_s - delay_s).conj()
    )


def times_and_instantaneous_frequency_hz(
    samples: np.ndarray, sample_rate_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) and instantaneous frequencies (Hz) between samples, from phase steps."""
    turns = np.angle(samples[1:] * samples[:-1].conj()) / (2 * np.pi)
    return (np.arange(turns.size) + 0.5) / sample_rate_hz, turns * sample_rate_hz


def _ramp_is_linear_claim() -> Claim:
    chirp = reference_radar().frame.chirp
    rate_hz = 4 * published.BANDWIDTH_HZ
    instants_s = np.arange(round(chirp.ramp_duration_s * rate_hz)) / rate_hz
    time_s, frequency_hz = times_and_instantaneous_frequency_hz(
        synthesise_ramp(chirp, instants_s), rate_hz
    )
    slope, start_hz = np.polyfit(time_s, frequency_hz, 1)
    error_hz = np.max(abs(frequency_hz - start_hz - slope * time_s))
    expected = published.BANDWIDTH_HZ / chirp.ramp_duration_s
    return Claim(
        id="chirp_linearity",
        claim="The ramp is linear and sweeps its bandwidth in its duration.",
        checks=(
            Check(
                name="slope of the synthesised chirp",
                unit="Hz/s",
                published=published.SLOPE_HZ_PER_S,
                measured=float(slope),
                at_least=expected * (1 - 1e-6),
                at_most=expected * (1 + 1e-6),
                limit=expected,
            ),
            Check(
                name="largest deviation from a straight line",
                unit="Hz",
                measured=float(error_hz),
                at_most=1.0,
                limit=0.0,
            ),
        ),
        note="The slope is a fit to the phase steps of the synthesised samples.",
    )


def _beat_frequency_follows_range_claim() -> Claim:
    chirp, range_m = reference_radar().frame.chirp, REFERENCE_TARGET.range_m
    echo = simulate_ideal_echoes(target_scene(range_m, 0.0), reference_radar()).values[0, 0, 0]
    _, frequency_hz = times_and_instantaneous_frequency_hz(echo, chirp.sample_rate_hz)
    expected = chirp.beat_frequency_hz(range_m)
    dechirped = dechirp_delayed_ramp(chirp, delay_s=2 * range_m / SPEED_OF_LIGHT)
    phase_error_rad = np.max(abs(np.angle(echo * dechirped.conj())))
    return Claim(
        id="beat_frequency_50m",
        claim="A stationary target at 50 m has the beat frequency 2 S R / c.",
        checks=(
            Check(
                name="beat frequency of the dechirped echo",
                unit="Hz",
                published=2 * published.SLOPE_HZ_PER_S * 50.0 / published.SPEED_OF_LIGHT,
                measured=float(np.mean(frequency_hz)),
                at_least=expected * (1 - 1e-6),
                at_most=expected * (1 + 1e-6),
                limit=expected,
            ),
            Check(
                name="phase difference from the ramp mixed with its delayed copy",
                unit="rad",
                measured=float(phase_error_rad),
                at_most=1e-6,
                limit=0.0,
            ),
        ),
        note="The published value follows from the report's formula with its slope and c = 3e8"
        " m/s.",
    )


def _echo_power_follows_radar_equation_claim() -> Claim:
    scene = target_scene(*REFERENCE_TARGET)
    measured = float(np.mean(abs(simulate_ideal_echoes(scene, reference_radar()).values) ** 2))
    hardware, wavelength_m = (
        reference_radar().require_hardware(),
        reference_radar().frame.chirp.wavelength_m,
    )
    denominator = (
        (4 * np.pi) ** 3 * motion_at_mid_frame(REFERENCE_TARGET).range_m ** 4 * hardware.loss
    )
    gain = float(hardware.tx_gain())
    expected = hardware.transmit_power_w * (gain * wavelength_m) ** 2 * RCS_M2 / denominator
    power_dbm, gain_db = (
        float(to_decibels(ratio)) for ratio in (hardware.transmit_power_w * 1e3, gain)
    )
    return Claim(
        id="echo_power_50m",
        claim="The echo of a car at 50 m has a power of picowatts.",
        checks=(
            Check(
                name="mean power of the echo",
                unit="W",
                published="picowatts",
                measured=measured,
                at_least=1e-12,
                at_most=1e-9,
                limit=expected,
            ),
            Check(
                name="mean power over the radar equation",
                unit="dB",
                measured=float(to_decibels(measured / expected)),
                at_least=-0.001,
                at_most=0.001,
                limit=0.0,
            ),
        ),
        note=f"Transmit power {power_dbm:.3g} dBm, antenna gain {gain_db:.3g} dBi, RCS of the car"
        " 10 dBsm.",
    )
