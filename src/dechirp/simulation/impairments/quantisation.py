"""Quantisation and clipping by the ADC."""

import warnings

import numpy as np

from dechirp.core.checks import check_integer_fields, check_positive_fields
from dechirp.core.compiled_kernels import kernel
from dechirp.core.findings import Finding, PhysicsWarning
from dechirp.core.text import format_si
from dechirp.core.values import frozen_dataclass
from dechirp.radar.radar import Radar
from dechirp.scene.scene import Scene
from dechirp.simulation.blocks import apply_to_chirp_blocks
from dechirp.simulation.impairments.base import Receiver

# Part of a step beyond the last code: single precision separates 32767 from 32767.004.
_CLIP_TOLERANCE = 0.51


@frozen_dataclass
class Quantisation(Receiver):
    r"""Mid-tread rounding of I and Q, or of real samples, to `bits`, with clipping at full scale.

    A full-scale tone of power P has an amplitude of sqrt(P) in I and in Q, of sqrt(2 P) in real
    samples, which is the largest code, 2^(bits - 1) - 1 steps; the least code is one below minus
    that.
    Samples stay floats, each an integer number of steps; `extract_adc_codes` returns the integers.
    List
    it last: later impairments yield samples that are not codes.

    .. math:: SNR = 6.02 \, bits + 1.76 \; dB

    of a full-scale tone, within 0.15 dB from 6 bits on; the noise is step^2 / 12 in I and in Q, and
    white if echoes or noise exceed a step.

    References
    ----------
    W. R. Bennett, Spectra of quantized signals, Bell Syst. Tech. J., 1948.
    """

    bits: int = 12
    """Word length of each ADC, 2 to 16."""
    full_scale_w: float
    """Power at the antenna of the largest tone without clipping."""

    def __post_init__(self) -> None:
        check_integer_fields(self, "bits", at_least=2, at_most=16)
        check_positive_fields(self, "full_scale_w", at_least=1e-30, at_most=1e12)

    def step_size(self, radar: Radar) -> float:
        """Return the step of the ADC, sqrt(W)."""
        is_complex = radar.frame.chirp.sampling == "complex"
        peak = np.sqrt(self.full_scale_w if is_complex else 2 * self.full_scale_w)
        return float(peak / (2 ** (self.bits - 1) - 1))

    def noise_power_w(self, scene: Scene, radar: Radar) -> float:
        """Return the mean square of the rounding error, in I and Q together."""
        n_parts = 2 if radar.frame.chirp.sampling == "complex" else 1
        return n_parts * self.step_size(radar) ** 2 / 12

    def cube_attributes(self, radar: Radar) -> dict[str, object]:
        """Return `scale`, the step in sqrt(W), and `bits`."""
        return {"scale": self.step_size(radar), "bits": self.bits}

    def apply_to_samples(
        self, samples: np.ndarray, scene: Scene, radar: Radar, rng: np.random.Generator
    ) -> None:
        """Round and clip, and warn about clipped samples."""
        step, half = self.step_size(radar), 2 ** (self.bits - 1)
        limits = np.array([step, 1 / step, -half, half - 1, _CLIP_TOLERANCE], samples.real.dtype)
        n_clipped = []

        def quantise_block(chirps: np.ndarray) -> None:
            flat = chirps.reshape(-1)
            n_clipped.append(_quantise_and_count_clipped(flat.view(limits.dtype), limits))

        apply_to_chirp_blocks(samples, quantise_block)
        n_kept = samples[..., 0].size * radar.frame.chirp.n_samples
        n_numbers = n_kept * (2 if np.iscomplexobj(samples) else 1)
        if sum(n_clipped):
            clipped_share = min(sum(n_clipped) / n_numbers, 1)
            finding = Finding(
                level="warning",
                setting="impairments.quantisation.full_scale",
                value=f"{format_si(self.full_scale_w, 'w', 3)}, which clips {clipped_share:.2%}"
                " of the samples",
                expected="a full scale above the peak power of all signals together",
                fix="raise it, or attenuate the strongest signal with a filter before the ADC",
            )
            warnings.warn(PhysicsWarning(finding), stacklevel=2)


def _quantise_in_numpy(sample_values: np.ndarray, step_and_code_bounds: np.ndarray) -> int:
    """Plain twin of `_quantise_and_count_clipped`: equal bits."""
    step, per_step, min_code, max_code, tolerance = step_and_code_bounds
    steps = sample_values * per_step
    is_clipped = (steps > max_code + tolerance) | (steps < min_code - tolerance)
    sample_values[:] = np.clip(np.rint(steps), min_code, max_code) * step
    return int(is_clipped.sum())


@kernel(plain=_quantise_in_numpy, fastmath={"contract", "reassoc"})
def _quantise_and_count_clipped(sample_values: np.ndarray, step_and_code_bounds: np.ndarray) -> int:
    """Round to steps within bounds, in place; return the number of clipped values.

    `step_and_code_bounds` are the step, its inverse, the least and the largest code, and the
    clipping tolerance.
    """
    step, per_step, min_code, max_code, tolerance = step_and_code_bounds
    n_clipped = 0
    for k in range(len(sample_values)):
        steps = sample_values[k] * per_step
        n_clipped += (steps > max_code + tolerance) | (steps < min_code - tolerance)
        sample_values[k] = min(max(np.rint(steps), min_code), max_code) * step
    return n_clipped
