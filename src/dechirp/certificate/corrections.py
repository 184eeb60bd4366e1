"""Corrections of the reference report."""

import numpy as np

from dechirp.certificate import published, sensitivity
from dechirp.certificate.reference_trials import (
    REFERENCE_TARGET,
    reference_echo_zero_before_arrival,
    reference_radar,
)
from dechirp.core.units import SPEED_OF_LIGHT, to_decibels
from dechirp.core.values import frozen_dataclass


@frozen_dataclass
class Correction:
    """Wrong or contradictory statement of the report, with the correct one."""

    subject: str
    published: str
    correct: str
    reason: str


def list_corrections_of_published_report() -> tuple[Correction, ...]:
    """Return all corrections, with numbers computed from the reference radar."""
    return (
        _published_sample_count_correction(),
        _published_guard_cell_correction(),
        _published_slope_correction(),
        _published_sample_rate_unit_correction(),
        _published_sample_rate_correction(),
        _published_mirror_image_correction(),
        _published_residual_phase_correction(),
        _published_velocity_sign_correction(),
        _published_velocity_correction(),
        _published_amplitude_as_power_correction(),
    )


def _published_sample_count_correction() -> Correction:
    chirp = reference_radar().frame.chirp
    required_rate_hz = 1024 / chirp.ramp_duration_s
    return Correction(
        subject="samples of a chirp",
        published="1024 in one place, 2200 in another",
        correct=f"{chirp.n_samples}",
        reason=f"{chirp.sample_rate_hz / 1e6:g} MS/s for {chirp.ramp_duration_s * 1e6:.4f} µs are"
        f" {chirp.sample_rate_hz * chirp.ramp_duration_s:.0f} samples; 1024 samples would need"
        f" {required_rate_hz / 1e6:.1f} MS/s.",
    )


def _published_guard_cell_correction() -> Correction:
    wide_window, narrow_window = published.TRAINING_WINDOW, published.SMALL_GUARD_WINDOW
    masking_db = [
        float(
            -2
            * to_decibels(
                1
                - published.threshold_over_peak_amplitude(
                    reference_echo_zero_before_arrival(), window
                )
            )
        )
        for window in (narrow_window, wide_window)
    ]
    return Correction(
        subject="guard cells along range",
        published=f"{narrow_window.n_guard.range} in one place,"
        f" {wide_window.n_guard.range} in another",
        correct=f"{wide_window.n_guard.range} in a map with the report's zero padding",
        reason="The report uses both. Sidelobes of the target in the training window raise its own"
        f" threshold, by up to {masking_db[0]:.1f} dB with {narrow_window.n_guard.range} guard"
        f" cells and {masking_db[1]:.1f} dB with {wide_window.n_guard.range}; the rule is measured"
        " here with the latter.",
    )


def _published_slope_correction() -> Correction:
    slope = published.BANDWIDTH_HZ / reference_radar().frame.chirp.ramp_duration_s
    range_error_m = REFERENCE_TARGET.range_m * (slope / published.ROUNDED_SLOPE_HZ_PER_S - 1)
    return Correction(
        subject="slope of the ramp",
        published=f"{published.ROUNDED_SLOPE_HZ_PER_S:.0e} Hz/s in one place,"
        f" {published.SLOPE_HZ_PER_S:.3e} in another",
        correct=f"{slope:.4e} Hz/s",
        reason="150 MHz in 7.3333 µs. A range computed with the rounded slope is"
        f" {range_error_m:.2f} m too large at 50 m.",
    )


def _published_sample_rate_unit_correction() -> Correction:
    chirp = reference_radar().frame.chirp
    return Correction(
        subject="unit of the sample rate",
        published='"300 samples per second"',
        correct=f"{chirp.sample_rate_hz:.0e} samples per second",
        reason="At 300 samples per second the second sample would be taken"
        f" {1 / 300 / chirp.ramp_duration_s:.0f} chirp durations after the first.",
    )


def _published_sample_rate_correction() -> Correction:
    chirp = reference_radar().frame.chirp
    beat_hz = chirp.beat_frequency_hz(published.MAX_RANGE_M)
    doppler_hz = 2 * published.MAX_VELOCITY_M_PER_S / chirp.wavelength_m
    required_rate_hz = beat_hz + 2 * doppler_hz
    return Correction(
        subject="sample rate",
        published=f"{chirp.sample_rate_hz / 1e6:g} MS/s for a beat frequency of 27 MHz",
        correct=f"{required_rate_hz / 1e6:.1f} MS/s of complex samples",
        reason=f"The beat frequency of an echo from 200 m is {beat_hz / 1e6:.2f} MHz; the Doppler"
        f" frequency adds up to ±{doppler_hz / 1e6:.2f} MHz. The published rate covers ranges up to"
        f" {chirp.max_range_m:.0f} m, which are not required, and needs"
        f" {chirp.sample_rate_hz / required_rate_hz:.0f} times the data.",
    )


def _published_mirror_image_correction() -> Correction:
    chirp = reference_radar().frame.chirp
    return Correction(
        subject="mirror image of the spectrum",
        published="the upper half is discarded as a mirror image",
        correct="spectra of complex samples have no mirror image",
        reason="With two mixers every bin is a different range, up to"
        f" {chirp.max_range_m:.0f} m. The discarded half contains the ranges beyond"
        f" {chirp.max_range_m / 2:.0f} m; only real samples have a mirror image.",
    )


def _published_residual_phase_correction() -> Correction:
    chirp = reference_radar().frame.chirp
    delay_s = 2 * REFERENCE_TARGET.range_m / SPEED_OF_LIGHT
    cycles = chirp.slope_hz_per_s * delay_s**2 / 2
    return Correction(
        subject="residual video phase",
        published="neglected as small",
        correct=f"{cycles:.3f} cycles at 50 m",
        reason="S τ² / 2 exceeds one cycle. It is harmless because it changes little from chirp to"
        " chirp: relative to the Doppler phase by"
        f" {chirp.beat_frequency_hz(REFERENCE_TARGET.range_m) / chirp.start_frequency_hz:.1e}.",
    )


def _published_velocity_sign_correction() -> Correction:
    return Correction(
        subject="sign of the velocity",
        published="positive is approaching",
        correct="positive is receding",
        reason="The report's own target has R = R0 + v t: with v = 10 m/s the range increases.",
    )


def _published_velocity_correction() -> Correction:
    range_m, velocity = published.find_strongest_report_rule_detection(
        reference_echo_zero_before_arrival()
    )
    _, axis = published.report_range_and_velocity_axes()
    next_lower = axis[np.searchsorted(axis, velocity) - 1]
    bin_width = reference_radar().frame.velocity_resolution_m_per_s
    return Correction(
        subject="measured velocity",
        published=f"{published.VELOCITY_M_PER_S:g} m/s",
        correct=f"{velocity:.2f} m/s on the report's axes, without noise",
        reason=f"The report's axis includes both end points, so its step is {axis[1] - axis[0]:.4f}"
        f" m/s and that of the transform {bin_width:.4f} m/s. Without interpolation the result is"
        f" {next_lower:.2f} or {velocity:.2f} m/s, not {published.VELOCITY_M_PER_S:g} m/s. The"
        f" range, {range_m:.2f} m, is as published because a cell happens to lie there.",
    )


def _published_amplitude_as_power_correction() -> Correction:
    threshold = sensitivity.report_threshold()
    snr_ratio = sensitivity.report_rule_required_snr() / sensitivity.chain_required_snr()
    return Correction(
        subject="amplitudes used as powers",
        published=f"{published.OFFSET_DB:g} dB above the noise",
        correct=f"{float(to_decibels(threshold)):.2f} dB above the mean noise power",
        reason="10 log₁₀ of an amplitude is half its level in decibels, and an amplitude factor of"
        " 15"
        " dB in power ratio is a power factor of 30 dB. The resulting false-alarm probability is"
        f" 10^{-threshold / np.log(10):.0f}, and the rule needs"
        f" {float(to_decibels(snr_ratio)):.1f} dB more SNR than 1e-6 requires.",
    )
