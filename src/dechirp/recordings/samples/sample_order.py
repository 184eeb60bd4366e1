"""Choice of the order of raw samples that concentrates the energy in few beat frequencies."""

from collections.abc import Sequence

import numpy as np

from dechirp.core.findings import Finding


def spectral_concentration(samples: np.ndarray) -> float:
    """Return the sum of squared powers over the squared total power, of the mean beat spectrum.

    1 for one tone, 1 / n for n equal ones. Of complex samples, only the power that exceeds its
    mirror image counts: samples of one receiver in place of another's, or I in place of Q, split
    each tone into several on both sides.
    """
    spectrum = np.fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    power = np.mean(np.abs(spectrum) ** 2, axis=(0, 1))
    total = float(power.sum())
    if total == 0:
        return 0.0
    unmirrored_power = power
    if np.iscomplexobj(samples):
        unmirrored_power = np.maximum(power - np.roll(power[::-1], 1), 0)
    return float(np.sum(power * unmirrored_power)) / total**2


def choose_sample_order(
    names: Sequence[str], concentrations: Sequence[float], *, n_samples: int, setting: str, fix: str
) -> tuple[int, tuple[Finding, ...]]:
    """Return the index of the best order, and a finding; the first if no other is clearly better.

    Parameters
    ----------
    names : sequence of str
        Name of each order, for the finding.
    concentrations : sequence of float
        Concentration of the samples in each order, see `spectral_concentration`.
    n_samples : int
        Samples of a chirp.
    setting, fix : str
        Setting that selects the order, and how to give it.
    """
    best = int(np.argmax(concentrations))
    chosen_index = (
        best
        if _is_clearly_more_concentrated(concentrations[best], concentrations[0], n_samples)
        else 0
    )
    if len(names) == 1:
        return chosen_index, ()
    level = concentrations[chosen_index]
    other_level, name = max(
        (other_level, name)
        for index, (other_level, name) in enumerate(zip(concentrations, names, strict=True))
        if index != chosen_index
    )
    return chosen_index, (
        Finding(
            level="note"
            if _is_clearly_more_concentrated(level, other_level, n_samples)
            else "warning",
            setting=setting,
            value=f"missing, assumed to be {names[chosen_index]}: its energy lies in"
            f" {_format_equivalent_tone_count(level)} beat frequencies,"
            f" in {_format_equivalent_tone_count(other_level)} read as {name}",
            expected="the device that wrote the samples, which raw samples do not contain",
            fix=f"no action needed if the map looks right; else {fix}",
        ),
    )


def _is_clearly_more_concentrated(best: float, other: float, n_samples: int) -> bool:
    """Return whether one order of samples is right and the other wrong, by their concentrations.

    The right one has 1.6 to 12 times the next best in fourteen real captures, and 1.2 in a scene of
    two equal echoes, of which the wrong order keeps much. White noise has about one over the number
    of samples in any order.
    """
    return best > 1.15 * other and best > 2 / n_samples


def _format_equivalent_tone_count(concentration: float) -> str:
    """Format the number of equal tones with the same concentration, without mirrored energy."""
    return f"{1 / concentration:.3g}" if concentration > 1e-4 else "too many"
