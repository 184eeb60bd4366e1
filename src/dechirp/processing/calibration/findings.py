"""Findings on the quality of a calibration and of the echoes it was measured with."""

from collections.abc import Iterator

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import to_decibels
from dechirp.processing.calibration.element_errors import ElementErrors
from dechirp.processing.calibration.reflector import MeasuredReflector
from dechirp.radar.radar import Radar

_GOOD_SNR = 100.0  # 4 degrees of phase
_MAX_NEIGHBOUR_POWER = 0.01  # a tenth of the amplitude, 6 degrees
_MAX_RIVAL_POWER = 0.1
_MAX_RESIDUAL = 0.2


def calibration_findings(
    reflectors: list[MeasuredReflector],
    recording_of_reflector: np.ndarray,
    is_range_given: np.ndarray,
    unit_vectors: np.ndarray,
    errors: ElementErrors,
    snr: np.ndarray,
    radar: Radar,
    wavelength_m: float,
) -> tuple[Finding, ...]:
    """Return findings that put a calibration in doubt; none for a good one.

    Parameters
    ----------
    reflectors, recording_of_reflector
        The reflector in each frame, and the recording of that frame.
    is_range_given, unit_vectors
        For each recording: True if its range was given, and the unit vector to the reflector.
    errors, snr
        Fitted errors, and the smallest SNR of each element.
    """
    return (
        *(
            finding
            for index, is_given in enumerate(is_range_given)
            for finding in _other_echo_findings(
                [
                    measured
                    for measured, recording_index in zip(
                        reflectors, recording_of_reflector, strict=True
                    )
                    if recording_index == index
                ],
                bool(is_given),
                f"recording {index}" if len(is_range_given) > 1 else "the recording",
            )
        ),
        *_low_element_snr_findings(snr, radar),
        *(
            Finding(
                level="warning",
                setting="azimuth_rad",
                value=mismatch,
                expected="where the reflector stands, left positive",
                fix="check the sign of the angle, the order of the antennas, and the range",
            )
            for mismatch in [
                describe_direction_mismatch(reflectors[0], unit_vectors[0], radar, wavelength_m)
            ]
            if mismatch
        ),
        *_large_residual_or_position_findings(errors, wavelength_m),
    )


def element_tx_rx_label(index: int, radar: Radar) -> str:
    """Return transmitter and receiver of an element, in the form of the files."""
    n_rx = radar.array.n_rx
    return f"[{index // n_rx}, {index % n_rx}]"


def _other_echo_findings(
    reflectors: list[MeasuredReflector], is_range_given: bool, recording_name: str
) -> Iterator[Finding]:
    """Report other echoes near the reflector, or as strong as it."""
    worst = max(reflectors, key=lambda measured: measured.neighbour_power)
    if worst.neighbour_power > _MAX_NEIGHBOUR_POWER:
        yield Finding(
            level="warning",
            setting="cube",
            value=f"another echo within three range cells of the reflector in {recording_name},"
            f" {-float(to_decibels(worst.neighbour_power)):.1f} dB below it",
            expected="echoes at least 20 dB below the reflector, since they disturb the elements",
            fix="clear the surroundings, or use a wider sweep",
        )
    rival = max(reflectors, key=lambda measured: measured.next_power)
    if not is_range_given and rival.next_power > _MAX_RIVAL_POWER and rival.other_ranges_m:
        yield Finding(
            level="warning",
            setting="range_m",
            value=f"missing, with static echoes in {recording_name} at {rival.range_m:.4g} m (used)"
            f" and at {rival.other_ranges_m[0]:.4g} m,"
            f" {-float(to_decibels(rival.next_power)):.1f} dB below it",
            expected="a range where the reflector is not by far the strongest echo",
            fix="give the range of the reflector",
        )


def _low_element_snr_findings(element_snr: np.ndarray, radar: Radar) -> Iterator[Finding]:
    if element_snr.min() < _GOOD_SNR:
        worst = int(element_snr.argmin())
        degrees = np.degrees(1 / np.sqrt(2 * element_snr[worst]))
        yield Finding(
            level="warning",
            setting="cube",
            value=f"the reflector only {float(to_decibels(element_snr[worst])):.1f} dB over the"
            f" noise in element {element_tx_rx_label(worst, radar)}, which leaves"
            f" {degrees:.1f} degrees of its phase unknown",
            expected="20 dB or more in each element",
            fix="record more chirps, or a larger reflector",
        )


def describe_direction_mismatch(
    measured: MeasuredReflector, unit_vector: np.ndarray, radar: Radar, wavelength_m: float
) -> str | None:
    """Describe a reflector that a nearly ideal array measures in another direction; else None."""
    azimuths = np.radians(np.arange(-90, 90.25, 0.5))
    horizontal, up = (
        np.hypot(unit_vector[0], unit_vector[1]),
        np.full(azimuths.shape, unit_vector[2]),
    )
    scan = np.stack([horizontal * np.cos(azimuths), horizontal * np.sin(azimuths), up], axis=-1)
    per_m = 2 * np.pi / wavelength_m

    def coherence(directions: np.ndarray) -> np.ndarray:
        summed = np.exp(1j * per_m * directions @ radar.element_positions_m.T) @ measured.snapshot
        power = len(measured.snapshot) * np.sum(abs(measured.snapshot) ** 2)
        return np.asarray(abs(summed) ** 2 / power)

    scan_coherence = coherence(scan)
    if scan_coherence.max() > 0.8 and coherence(unit_vector[None])[0] < 0.5:
        given_deg = np.degrees(np.arctan2(unit_vector[1], unit_vector[0]))
        estimated_deg = np.degrees(azimuths[scan_coherence.argmax()]) + 0.0  # avoids -0
        return (
            f"{given_deg:.4g} degrees, while the array measures the reflector at"
            f" {estimated_deg:.4g} degrees even before it is calibrated"
        )
    return None


def _large_residual_or_position_findings(
    errors: ElementErrors, wavelength_m: float
) -> Iterator[Finding]:
    """Report directions or positions that one array cannot explain."""
    largest_m = float(abs(errors.position_m).max())
    if errors.residual > max(_MAX_RESIDUAL, 3 * errors.noise):
        yield Finding(
            level="warning",
            setting="azimuth_rad",
            value=f"inconsistent angles: a residual of {errors.residual:.2g} of the echo after"
            f" correction, where noise causes {errors.noise:.2g}",
            expected="the actual angles of the reflector, and no other echo in its cell",
            fix="check the order of the recordings and the signs of the angles",
        )
    elif largest_m > wavelength_m / 8:
        yield Finding(
            level="warning",
            setting="azimuth_rad",
            value=f"angles that move an element by {largest_m * 1e3:.2g} mm",
            expected="the actual angles of the reflector; boards are accurate to 0.05 mm",
            fix="check the order of the recordings and the signs of the angles, and the array",
        )
