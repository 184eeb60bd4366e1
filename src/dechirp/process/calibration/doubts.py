"""What makes a calibration doubtful: findings about the echoes it was measured with."""

from collections.abc import Iterator

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import decibels
from dechirp.process.calibration.element_errors import ElementErrors
from dechirp.process.calibration.reflector import Reflector
from dechirp.radar.radar import Radar

_WEAK = 100.0  # of signal over noise: 4 degrees
_BESIDE = 0.01  # a tenth of the amplitude, 6 degrees
_RIVAL = 0.1
_MISFIT = 0.2


def doubts(
    seen: list[Reflector],
    recording: np.ndarray,
    given: np.ndarray,
    towards: np.ndarray,
    errors: ElementErrors,
    snr: np.ndarray,
    radar: Radar,
    wavelength_m: float,
) -> tuple[Finding, ...]:
    """Everything that is doubtful; nothing where all is well.

    Parameters
    ----------
    seen, recording
        The reflector in each frame, and of which recording that frame is.
    given, towards
        Of each recording: whether its range was, and the unit vector to the reflector.
    errors, snr
        What was measured, and the least ratio in each element.
    """
    return (
        *(
            finding
            for place, told in enumerate(given)
            for finding in _other_echoes(
                [look for look, of in zip(seen, recording, strict=True) if of == place],
                bool(told),
                f"recording {place}" if len(given) > 1 else "the recording",
            )
        ),
        *_weak(snr, radar),
        *_elsewhere(seen[0], towards[0], radar, wavelength_m),
        *_inconsistent(errors, wavelength_m),
    )


def element_name(index: int, radar: Radar) -> str:
    """Transmitter and receiver of an element, as files name it."""
    n_rx = radar.array.n_rx
    return f"[{index // n_rx}, {index % n_rx}]"


def _other_echoes(looks: list[Reflector], given: bool, where: str) -> Iterator[Finding]:
    """Whether other echoes may be part of what was taken, or what was meant."""
    worst = max(looks, key=lambda look: look.beside)
    if worst.beside > _BESIDE:
        yield Finding(
            level="warning",
            setting="cube",
            got=f"another echo within three range cells of the reflector in {where},"
            f" {-float(decibels(worst.beside)):.1f} dB below it",
            need="20 dB or more below: it adds to some elements and takes from others",
            fix="Clear the place, or use a wider sweep.",
        )
    rival = max(looks, key=lambda look: look.next_power)
    if not given and rival.next_power > _RIVAL and rival.next_range_m is not None:
        yield Finding(
            level="warning",
            setting="range_m",
            got=f"not given, and in {where} echoes at rest at {rival.range_m:.4g} m, which was"
            f" taken, and at {rival.next_range_m:.4g} m,"
            f" {-float(decibels(rival.next_power)):.1f} dB below it",
            need="given where the reflector is not by far the strongest echo",
            fix="Say how far the reflector stands.",
        )


def _weak(snr: np.ndarray, radar: Radar) -> Iterator[Finding]:
    if snr.min() < _WEAK:
        worst = int(snr.argmin())
        degrees = np.degrees(1 / np.sqrt(2 * snr[worst]))
        yield Finding(
            level="warning",
            setting="cube",
            got=f"the reflector only {float(decibels(snr[worst])):.1f} dB over the noise in"
            f" element {element_name(worst, radar)}, which leaves {degrees:.1f} degrees of its"
            " phase unknown",
            need="20 dB or more in each element",
            fix="Record more chirps, or a larger reflector.",
        )


def _elsewhere(
    one: Reflector, towards: np.ndarray, radar: Radar, wavelength_m: float
) -> Iterator[Finding]:
    """Whether the array, if its channels are nearly alike, sees the reflector elsewhere."""
    azimuths = np.radians(np.arange(-90, 90.25, 0.5))
    level, up = np.hypot(towards[0], towards[1]), np.full(azimuths.shape, towards[2])
    scan = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), up], axis=-1)
    per_m = 2 * np.pi / wavelength_m

    def coherence(directions: np.ndarray) -> np.ndarray:
        summed = np.exp(1j * per_m * directions @ radar.elements_m.T) @ one.snapshot
        power = len(one.snapshot) * np.sum(abs(one.snapshot) ** 2)
        return np.asarray(abs(summed) ** 2 / power)

    over = coherence(scan)
    if over.max() > 0.8 and coherence(towards[None])[0] < 0.5:
        told = np.degrees(np.arctan2(towards[1], towards[0]))
        seen = np.degrees(azimuths[over.argmax()]) + 0.0  # no -0
        yield Finding(
            level="warning",
            setting="azimuth_rad",
            got=f"{told:.4g} degrees, while the array sees the reflector at {seen:.4g} degrees"
            " even before it is calibrated",
            need="where the reflector stands, left positive",
            fix="Check the sign of the angle, the order of the antennas, and the range.",
        )


def _inconsistent(errors: ElementErrors, wavelength_m: float) -> Iterator[Finding]:
    """Whether one array explains all directions."""
    largest_m = float(abs(errors.position_m).max())
    if errors.residual > max(_MISFIT, 3 * errors.noise):
        yield Finding(
            level="warning",
            setting="azimuth_rad",
            got=f"angles between which the array does not agree: {errors.residual:.2g} of the echo"
            f" is left after correction, noise would leave {errors.noise:.2g}",
            need="the angles at which the reflector stood, and nothing else in its cell",
            fix="Check the order of the recordings and the signs of the angles.",
        )
    elif largest_m > wavelength_m / 8:
        yield Finding(
            level="warning",
            setting="azimuth_rad",
            got=f"angles that put an element {largest_m * 1e3:.2g} mm beside its place",
            need="the angles at which the reflector stood: boards are made to 0.05 mm",
            fix="Check the order of the recordings and the signs of the angles, and the array.",
        )
