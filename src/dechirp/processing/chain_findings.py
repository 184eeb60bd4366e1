"""Findings about the settings of a chain for a radar, such as self-masking."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import to_decibels
from dechirp.processing.angle.aperture import radar_aperture
from dechirp.processing.cfar.base import Cfar, MapNoise
from dechirp.processing.chain import Chain
from dechirp.processing.direction_finding import assumes_targets_at_rest, can_resolve_directions
from dechirp.processing.spectrum import (
    Transform,
    rows_with_circular_noise,
    velocities_with_circular_noise,
)
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar
from dechirp.theory.cfar import cell_averaging_factor


def self_masking_loss(cfar: Cfar, noise: MapNoise) -> float:
    """Return the SNR to exceed the threshold relative to that without self-masking.

    For a target on a bin, in noise of the mean power: with a_i the window's response in the
    training cells and Z the estimator, snr = factor Z(1 + snr a). A ratio of at least 1; infinite
    where a target raises its threshold as fast as its power. Accurate to a few per cent, as the
    factor is that for independent cells.
    """
    window = cfar.training_window
    offsets = window.training_cell_offsets(window.half_range)
    factor = cfar.offset or cell_averaging_factor(
        cfar.false_alarm_probability or 0.5, n_training=len(offsets), n_summed=noise.n_channels
    )
    response = _window_power_response(noise.doppler_transform, offsets[:, 0])
    response *= _window_power_response(noise.range_transform, offsets[:, 1])

    unmasked_snr = required_snr = factor * float(
        cfar.estimator.statistic(np.ones(len(offsets)), offsets)
    )
    while required_snr < 1e9 * unmasked_snr:
        previous_snr = required_snr
        required_snr = factor * float(
            cfar.estimator.statistic(1 + previous_snr * response, offsets)
        )
        if required_snr <= previous_snr * (1 + 1e-6):
            return required_snr / unmasked_snr
    return np.inf


def _window_power_response(transform: Transform, bins: np.ndarray) -> np.ndarray:
    """Return the power at bins from a tone on a bin, relative to the tone's."""
    cycles = np.arange(transform.n_points)[:, None] * bins / transform.n_bins
    amplitude = transform.weights @ np.exp(2j * np.pi * cycles) / transform.weights.sum()
    return np.asarray(abs(amplitude) ** 2)


def chain_findings(radar: Radar, chain: Chain) -> list[Finding]:
    """List the findings about the maps that a chain computes for a radar."""
    noise, training, guard = (
        chain.map_noise_statistics(radar),
        chain.cfar.n_training,
        chain.cfar.n_guard,
    )
    findings = [
        remark for method in chain.mitigation for remark in method.limitation_findings(radar)
    ]
    if training.range:
        findings += _self_masking_findings(
            "range", guard.range, noise.range_transform, chain.cfar, noise
        )
    if training.velocity:
        findings += _self_masking_findings(
            "velocity", guard.velocity, noise.doppler_transform, chain.cfar, noise
        )
    error = chain.cfar.false_alarm_probability_error(noise)
    if error:
        findings.append(
            Finding(
                level="note" if error < 0.05 else "warning",
                setting="chain.cfar.estimator",
                value=f"a factor for {chain.cfar.estimator.kind()} in cells correlated by windows"
                f" or padding, calibrated by simulation, with a standard error of {error:.1%}"
                " of the false-alarm probability",
                expected="an exact factor, where the probability must be closer than that",
                fix="choose cell-averaging, whose factor is exact, or leave it",
            )
        )
    chirp, n_rows = radar.frame.chirp, noise.range_transform.n_bins // 2 + 1
    if chirp.sampling == "real":
        rows = rows_with_circular_noise(chirp, noise.range_transform)
        searched_m = chirp.range_bins_m(noise.range_transform.n_bins)[[rows.start, rows.stop - 1]]
        is_circular = velocities_with_circular_noise(noise.doppler_transform)
        echoes = "echoes"
        if is_circular.any():
            velocity_bins = radar.frame.velocity_bins_m_per_s(noise.doppler_transform.n_bins)
            slowest = float(abs(velocity_bins[is_circular]).min())
            echoes += f" within {slowest:.3g} m/s of zero velocity or of the largest one"
        findings.append(
            Finding(
                level="note",
                setting="radar.frame.chirp.sampling",
                value=f"real samples: {echoes} are sought from {searched_m[0]:.4g} to"
                f" {searched_m[1]:.4g} m, without {rows.start} and {n_rows - rows.stop} rows",
                expected="noise independent of its mirror image, for false alarms as designed",
                fix="sample faster for targets farther away; those up to half a cell outside are"
                " found",
            )
        )
    if chain.angle is not None and can_resolve_directions(radar):
        findings += chain.angle.array_ambiguity_findings(radar_aperture(radar, chain.field_of_view))
        findings += _motion_findings(radar.frame)
    return findings


def _motion_findings(frame: Frame) -> list[Finding]:
    """Warn if transmitters take turns in a single round, which measures no velocity."""
    if not assumes_targets_at_rest(frame):
        return []
    slot_times_s = frame.doppler_phase_times_s
    rad_per_m_per_s = 4 * np.pi * np.ptp(slot_times_s) / frame.chirp.wavelength_m
    return [
        Finding(
            level="warning",
            setting="radar.frame.n_chirps",
            value=f"one round of {len(slot_times_s)} slots, which measures no velocity: directions"
            " are those of targets at rest, and each m/s of radial velocity turns the phase"
            f" between the first and the last slot by {np.degrees(rad_per_m_per_s):.3g} degrees",
            expected="a static scene, or two rounds or more to compensate the motion",
            fix="nothing is to be done if nothing moves; else record more rounds a frame",
        )
    ]


def _self_masking_findings(
    axis: str, n_guard: int, transform: Transform, cfar: Cfar, noise: MapNoise
) -> list[Finding]:
    """Warn if a target would raise its own threshold."""
    needed = int(np.ceil(transform.main_lobe_half_width_bins)) - 1
    if n_guard >= needed:
        return []
    loss = self_masking_loss(cfar, noise)
    consequence = f"costs {to_decibels(loss):.1f} dB" if np.isfinite(loss) else "hides every target"
    return [
        Finding(
            level="warning",
            setting=f"chain.cfar.n_guard.{axis}",
            value=f"{n_guard} guard cells inside a main lobe of"
            f" {transform.main_lobe_half_width_bins:.3g} bins"
            f" on each side, which {consequence}",
            expected=f"{needed} or more, or a target raises its own threshold",
            fix="widen the guard, or pad less",
        )
    ]
