"""Where the reference report contradicts itself or is wrong, with the right value."""

import numpy as np

from dechirp.core.units import SPEED_OF_LIGHT, decibels
from dechirp.core.values import value
from dechirp.experiment.verify import published, sensitivity
from dechirp.experiment.verify.looks import REFERENCE, late_echo, radar


@value
class Correction:
    """One statement of the report, and what is right instead."""

    subject: str
    published: str
    right: str
    why: str


def corrections() -> tuple[Correction, ...]:
    """All of them, every number computed here and now."""
    return (
        _samples(),
        _guard(),
        _slope(),
        _unit_of_rate(),
        _sample_rate(),
        _mirror_image(),
        _residual_phase(),
        _direction(),
        _velocity(),
        _amplitude(),
    )


def _samples() -> Correction:
    chirp = radar().frame.chirp
    would_hz = 1024 / chirp.ramp_duration_s
    return Correction(
        subject="samples of a chirp",
        published="1024 in one place, 2200 in another",
        right=f"{chirp.n_samples}",
        why=f"{chirp.sample_rate_hz / 1e6:g} MS/s for {chirp.ramp_duration_s * 1e6:.4f} µs are"
        f" {chirp.sample_rate_hz * chirp.ramp_duration_s:.0f}; 1024 would take"
        f" {would_hz / 1e6:.1f} MS/s.",
    )


def _guard() -> Correction:
    wide, narrow = published.RING, published.OTHER_RING
    costs_db = [
        float(-2 * decibels(1 - published.leakage(late_echo(), ring))) for ring in (narrow, wide)
    ]
    return Correction(
        subject="guard cells along range",
        published=f"{narrow.n_guard.range} in one place, {wide.n_guard.range} in another",
        right=f"{wide.n_guard.range} in a map that is padded like its",
        why="The report does not decide. Sidelobes of the target in the ring raise its own"
        f" threshold, by up to {costs_db[0]:.1f} dB with {narrow.n_guard.range} guard cells and"
        f" {costs_db[1]:.1f} dB with {wide.n_guard.range}; its rule is measured here with the"
        " latter.",
    )


def _slope() -> Correction:
    slope = published.BANDWIDTH_HZ / radar().frame.chirp.ramp_duration_s
    off_m = REFERENCE.range_m * (slope / published.ROUNDED_SLOPE_HZ_PER_S - 1)
    return Correction(
        subject="slope of the ramp",
        published=f"{published.ROUNDED_SLOPE_HZ_PER_S:.0e} Hz/s in one place,"
        f" {published.SLOPE_HZ_PER_S:.3e} in another",
        right=f"{slope:.4e} Hz/s",
        why=f"150 MHz in 7.3333 µs. A range read with the rounded slope is {off_m:.2f} m too"
        " long at 50 m.",
    )


def _unit_of_rate() -> Correction:
    chirp = radar().frame.chirp
    return Correction(
        subject="unit of the sample rate",
        published='"300 samples per second"',
        right=f"{chirp.sample_rate_hz:.0e} samples per second",
        why=f"At 300 a second the chirp would end {1 / 300 / chirp.ramp_duration_s:.0f} times"
        " over before the second sample.",
    )


def _sample_rate() -> Correction:
    chirp = radar().frame.chirp
    beat_hz = chirp.beat_frequency_hz(published.MAX_RANGE_M)
    doppler_hz = 2 * published.MAX_VELOCITY_M_PER_S / chirp.wavelength_m
    need_hz = beat_hz + 2 * doppler_hz
    return Correction(
        subject="sample rate",
        published=f"{chirp.sample_rate_hz / 1e6:g} MS/s for a beat of 27 MHz",
        right=f"{need_hz / 1e6:.1f} MS/s of complex samples",
        why=f"The echo from 200 m beats at {beat_hz / 1e6:.2f} MHz, Doppler adds"
        f" {doppler_hz / 1e6:.2f} MHz either way. The rest samples out to"
        f" {chirp.max_range_m:.0f} m: {chirp.sample_rate_hz / need_hz:.0f} times the data, for"
        " nothing that was asked for.",
    )


def _mirror_image() -> Correction:
    chirp = radar().frame.chirp
    return Correction(
        subject="mirror image of the spectrum",
        published="the upper half is cut off as a mirror image",
        right="complex samples have none",
        why=f"Of two mixers every bin is a range of its own, out to {chirp.max_range_m:.0f} m."
        f" Cutting off half throws away the ranges beyond {chirp.max_range_m / 2:.0f} m; only"
        " real samples have a mirror image.",
    )


def _residual_phase() -> Correction:
    chirp = radar().frame.chirp
    delay_s = 2 * REFERENCE.range_m / SPEED_OF_LIGHT
    cycles = chirp.slope_hz_per_s * delay_s**2 / 2
    return Correction(
        subject="residual video phase",
        published="neglected as small",
        right=f"{cycles:.3f} cycles at 50 m",
        why="S τ² / 2 is more than a turn. It does no harm because it hardly changes from"
        f" chirp to chirp: relative to the Doppler frequency by"
        f" {chirp.beat_frequency_hz(REFERENCE.range_m) / chirp.start_frequency_hz:.1e}.",
    )


def _direction() -> Correction:
    return Correction(
        subject="sign of the velocity",
        published="positive is approaching",
        right="positive is receding",
        why="The report's own target has R = R0 + v t: with v = 10 m/s the range grows.",
    )


def _velocity() -> Correction:
    range_m, velocity = published.strongest(late_echo())
    _, axis = published.axes_m_and_m_per_s()
    below = axis[np.searchsorted(axis, velocity) - 1]
    right = radar().frame.velocity_resolution_m_per_s
    return Correction(
        subject="velocity that is found",
        published=f"{published.VELOCITY_M_PER_S:g} m/s",
        right=f"{velocity:.2f} m/s on its own axes, without noise",
        why=f"Its axis counts both end points, so that it steps {axis[1] - axis[0]:.4f} m/s where"
        f" the transform steps {right:.4f}, and nothing is interpolated: it can say {below:.2f} or"
        f" {velocity:.2f}, not {published.VELOCITY_M_PER_S:g}. Its range, {range_m:.2f} m, is as"
        " published: a cell happens to lie there.",
    )


def _amplitude() -> Correction:
    threshold = sensitivity.report_threshold()
    apart = sensitivity.needed_by_report() / sensitivity.needed_in_map()
    return Correction(
        subject="amplitude taken as power",
        published=f"{published.OFFSET_DB:g} dB over the noise",
        right=f"{float(decibels(threshold)):.2f} dB over the mean power of the noise",
        why="10 log₁₀ of an amplitude is half its decibels, and 15 dB times an amplitude is 30 dB"
        f" of power. Its false-alarm probability is 10^{-threshold / np.log(10):.0f}, and it needs"
        f" {float(decibels(apart)):.1f} dB more than 1e-6 asks for.",
    )
