"""The converter: samples in steps, within its full scale."""

import warnings

import numba
import numpy as np

from dechirp.core.checks import count, positive
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.values import value
from dechirp.echoes.impairments.base import Receiver
from dechirp.echoes.pieces import in_pieces
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene

# Of a step, past the last code: single precision tells 32767 from 32767.004.
_BEYOND = 0.51


@value
class Quantisation(Receiver):
    r"""Mid-tread rounding of I and Q, or of real samples, to `bits`; clipped at full scale.

    A tone of full scale, of power P, has an amplitude of sqrt(P) in I and in Q, of sqrt(2 P)
    where samples are real, which is the largest code, 2^(bits - 1) - 1 steps; the least is one
    below minus that. Samples stay floats, each a whole number of steps; `codes` gives the
    numbers. To be listed last: what acts after it makes samples that are no codes.

    .. math:: SNR = 6.02 \, bits + 1.76 \; dB

    of a tone of full scale, within 0.15 dB from 6 bits on; the noise is step^2 / 12 in I and in
    Q, and white where echoes or noise exceed a step.

    References
    ----------
    W. R. Bennett, Spectra of quantized signals, Bell Syst. Tech. J., 1948.
    """

    bits: int = 12
    """Of each converter, 2 to 16."""
    full_scale_w: float
    """Power at the antenna of the largest tone that is not clipped."""

    def __post_init__(self) -> None:
        count(self, "bits", at_least=2, at_most=16)
        positive(self, "full_scale_w", at_least=1e-30, at_most=1e12)

    def scale(self, radar: Radar) -> float:
        """Step of the converter, sqrt(W)."""
        is_complex = radar.frame.chirp.sampling == "complex"
        peak = np.sqrt(self.full_scale_w if is_complex else 2 * self.full_scale_w)
        return float(peak / (2 ** (self.bits - 1) - 1))

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Mean square of rounding, in I and Q together."""
        n_parts = 2 if radar.frame.chirp.sampling == "complex" else 1
        return n_parts * self.scale(radar) ** 2 / 12

    def attributes(self, radar: Radar) -> dict[str, object]:
        """`scale`, sqrt(W) for a step, and `bits`."""
        return {"scale": self.scale(radar), "bits": self.bits}

    def apply(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Round and clip, and warn of what is clipped."""
        step, half = self.scale(radar), 2 ** (self.bits - 1)
        law = np.array([step, 1 / step, -half, half - 1, _BEYOND], samples.real.dtype)
        n_clipped = []

        def round_(chirps: np.ndarray) -> None:
            flat = chirps.reshape(-1)
            n_clipped.append(_round(flat.view(law.dtype), law))

        in_pieces(samples, round_)
        n_kept = samples[..., 0].size * radar.frame.chirp.n_samples
        n_numbers = n_kept * (2 if np.iscomplexobj(samples) else 1)
        if sum(n_clipped):
            share = min(sum(n_clipped) / n_numbers, 1)
            finding = Finding(
                level="warning",
                setting="impairments.quantisation.full_scale",
                got=f"{self.full_scale_w:.3g} W, which clips {share:.2%} of what it converts",
                need="above the power of all samples together for them to be as they are",
                fix="Raise it, or cut what is so strong with a filter before the converter.",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "reassoc"})
def _round(parts: np.ndarray, law: np.ndarray) -> int:
    """Round to steps within bounds, in place; return how many were beyond.

    `law`: the step, its inverse, the least and the largest code, and how far past them is beyond.
    """
    step, per_step, least, most, beyond = law
    n_clipped = 0
    for k in range(len(parts)):
        steps = parts[k] * per_step
        n_clipped += (steps > most + beyond) | (steps < least - beyond)
        parts[k] = min(max(np.rint(steps), least), most) * step
    return n_clipped
