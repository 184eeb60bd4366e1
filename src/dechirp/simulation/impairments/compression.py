"""Gain compression of the receiver, with intermodulation of strong echoes."""

import warnings

import numpy as np

from dechirp.core.checks import check_positive_fields
from dechirp.core.compiled_kernels import kernel
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import to_decibels
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.blocks import apply_to_chirp_blocks
from dechirp.simulation.impairments.base import Receiver

# 1 - gain in amplitude at the compression point.
_AMPLITUDE_LOSS = 1 - 10 ** (-1 / 20)
# Backoff at which a tone loses 0.2 dB, and products of two tones lie 31 dB below it.
_MIN_BACKOFF_DB = 6.0


@frozen_dataclass
class Compression(Receiver):
    r"""Memoryless cubic gain compression, limited where the cubic would turn back.

    .. math:: y = x (1 - a |x|^2), \quad a = (1 - 10^{-1/20}) / P_{1dB},

    for complex samples, which are the envelope of the amplifier's input. Up to \|x\|^2 = 1 / 3a,
    which
    is 4.9 dB above the compression point, the output grows; beyond it, the amplitude is constant
    and
    the phase is that of the input. Two tones have third-order products with an intercept point
    9.64 dB above the compression point. Real samples use x (1 - 2 a x^2 / 3): the same for one tone
    and for two, with additional harmonics. Only products within the sampled band exist, and those
    that
    alias into it.

    References
    ----------
    B. Razavi, RF Microelectronics, 2nd ed., 2011, 2.2.
    """

    p1db_w: float
    """Power of a tone at the antenna with 1 dB less gain than a weak tone."""

    def __post_init__(self) -> None:
        check_positive_fields(self, "p1db_w", at_least=1e-15, at_most=1e6)

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Compress, and warn if samples come within 6 dB of the compression point."""
        is_complex = np.iscomplexobj(samples)
        slope = _AMPLITUDE_LOSS / self.p1db_w * (1 if is_complex else 2 / 3)
        coefficients = np.array([slope, 1 / (3 * slope), 1, 2 / 3], samples.real.dtype)
        peaks_w = [0.0]

        def compress(chirps: np.ndarray) -> None:
            flat = chirps.reshape(-1)
            if is_complex:
                peaks_w.append(
                    _compress_complex_and_find_peak_power(
                        flat.view(coefficients.dtype), coefficients
                    )
                )
            else:
                peaks_w.append(_compress_real_and_find_peak_power(flat, coefficients) / 2)

        apply_to_chirp_blocks(samples, compress)
        backoff_db = float(to_decibels(self.p1db_w / max(*peaks_w, 1e-300 * self.p1db_w)))
        if backoff_db < _MIN_BACKOFF_DB:
            backoff_text = f"{abs(backoff_db):.2g} dB {'below' if backoff_db > 0 else 'above'}"
            finding = Finding(
                level="warning",
                setting="impairments.compression.p1db",
                value=f"samples reach powers {backoff_text} the compression point",
                expected=f"at least {_MIN_BACKOFF_DB:.0f} dB below it for undistorted echoes",
                fix="expect weaker echoes and intermodulation, or remove the strongest signal",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)


def _compress_complex_in_numpy(interleaved_iq: np.ndarray, coefficients: np.ndarray) -> float:
    """Plain twin of `_compress_complex_and_find_peak_power`: equal within rounding."""
    slope, limit, unity, two_thirds = coefficients
    parts = interleaved_iq.reshape(-1, 2)
    power = np.sum(parts * parts, axis=1)
    gain = np.where(power < limit, unity - slope * power, two_thirds * np.sqrt(limit / power))
    parts *= gain[:, None]
    return power.max(initial=0)


@kernel(plain=_compress_complex_in_numpy, fastmath={"contract", "reassoc"})
def _compress_complex_and_find_peak_power(
    interleaved_iq: np.ndarray, coefficients: np.ndarray
) -> float:
    """Compress complex numbers, as alternating parts; return the largest |x|^2.

    `coefficients` are a, 1 / 3a, and the constants 1 and 2/3 in the precision of the parts.
    """
    slope, limit, unity, two_thirds = coefficients
    largest_power = unity - unity
    for k in range(len(interleaved_iq) // 2):
        power = (
            interleaved_iq[2 * k] * interleaved_iq[2 * k]
            + interleaved_iq[2 * k + 1] * interleaved_iq[2 * k + 1]
        )
        largest_power = max(largest_power, power)
        gain = unity - slope * power if power < limit else two_thirds * np.sqrt(limit / power)
        interleaved_iq[2 * k] *= gain
        interleaved_iq[2 * k + 1] *= gain
    return largest_power


def _compress_real_in_numpy(real_samples: np.ndarray, coefficients: np.ndarray) -> float:
    """Plain twin of `_compress_real_and_find_peak_power`: equal within rounding."""
    slope, limit, unity, two_thirds = coefficients
    power = real_samples * real_samples
    real_samples *= np.where(
        power < limit, unity - slope * power, two_thirds * np.sqrt(limit / power)
    )
    return power.max(initial=0)


@kernel(plain=_compress_real_in_numpy, fastmath={"contract", "reassoc"})
def _compress_real_and_find_peak_power(real_samples: np.ndarray, coefficients: np.ndarray) -> float:
    """Compress real numbers; return the largest x^2."""
    slope, limit, unity, two_thirds = coefficients
    largest_power = unity - unity
    for k in range(len(real_samples)):
        power = real_samples[k] * real_samples[k]
        largest_power = max(largest_power, power)
        real_samples[k] *= (
            unity - slope * power if power < limit else two_thirds * np.sqrt(limit / power)
        )
    return largest_power
