"""Compression of the receiver: strong echoes are weakened, and mix with each other."""

import warnings

import numba
import numpy as np

from dechirp.core.checks import positive
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.echoes.pieces import in_pieces
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

# 1 - gain in amplitude at the compression point.
_LOST = 1 - 10 ** (-1 / 20)
# Below the compression point a tone loses 0.2 dB here, and products of two lie 31 dB under it.
_NEAR_DB = 6.0


@value
class Compression(Receiver):
    r"""A memoryless cubic, clipped where it would turn back.

    .. math:: y = x (1 - a |x|^2), \quad a = (1 - 10^{-1/20}) / P_{1dB},

    of complex samples, which are the envelope of what the amplifier gets. Up to
    \|x\|^2 = 1 / 3a, which is 4.9 dB above the compression point, the output grows; beyond it
    keeps its size and the phase of the input. Two tones have products of third order, the third
    intercept being 9.64 dB above the compression point. Of real samples x (1 - 2 a x^2 / 3): the
    same for one tone and for two, with harmonics besides. Samples know no other frequencies:
    products in the band alone, and such as alias into it.

    References
    ----------
    B. Razavi, RF Microelectronics, 2nd ed., 2011, 2.2.
    """

    p1db_w: float
    """Power of a tone at the antenna whose gain is 1 dB less than that of a weak one."""

    def __post_init__(self) -> None:
        positive(self, "p1db_w", at_least=1e-15, at_most=1e6)

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Compress, and warn where samples come within 6 dB of the compression point."""
        is_complex = np.iscomplexobj(samples)
        slope = _LOST / self.p1db_w * (1 if is_complex else 2 / 3)
        law = np.array([slope, 1 / (3 * slope), 1, 2 / 3], samples.real.dtype)
        peaks_w = [0.0]

        def compress(chirps: np.ndarray) -> None:
            flat = chirps.reshape(-1)
            if is_complex:
                peaks_w.append(_compress_pairs(flat.view(law.dtype), law))
            else:
                peaks_w.append(_compress(flat, law) / 2)

        in_pieces(samples, compress)
        below_db = float(decibels(self.p1db_w / max(*peaks_w, 1e-300 * self.p1db_w)))
        if below_db < _NEAR_DB:
            where = f"{abs(below_db):.2g} dB {'below' if below_db > 0 else 'above'}"
            finding = Finding(
                level="warning",
                setting="impairments.compression.p1db",
                got=f"samples reach powers {where} the compression point",
                need=f"{_NEAR_DB:.0f} dB and more below it for echoes to be as they are",
                fix="Expect weaker echoes and products of them, or take out what is so strong.",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _compress_pairs(parts: np.ndarray, law: np.ndarray) -> float:
    """Compress complex numbers, real and imaginary parts in turn; return the largest |x|^2.

    `law` has a, 1 / 3a, and two constants in the precision of the parts.
    """
    slope, limit, one, kept = law
    most = one - one
    for k in range(len(parts) // 2):
        power = parts[2 * k] * parts[2 * k] + parts[2 * k + 1] * parts[2 * k + 1]
        most = max(most, power)
        gain = one - slope * power if power < limit else kept * np.sqrt(limit / power)
        parts[2 * k] *= gain
        parts[2 * k + 1] *= gain
    return most


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _compress(parts: np.ndarray, law: np.ndarray) -> float:
    """Compress real numbers; return the largest x^2."""
    slope, limit, one, kept = law
    most = one - one
    for k in range(len(parts)):
        power = parts[k] * parts[k]
        most = max(most, power)
        parts[k] *= one - slope * power if power < limit else kept * np.sqrt(limit / power)
    return most
