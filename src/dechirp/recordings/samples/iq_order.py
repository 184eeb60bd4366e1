"""Order of I and Q in complex samples, inferred from the side of the spectrum with echoes."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.recordings.settings.base import Iq


def negative_beat_energy_fraction(samples: np.ndarray) -> float:
    """Return the fraction of the energy at negative beat frequencies, of samples (..., sample).

    DC, to which the mean of each chirp contributes, counts for neither side. An up-chirp has its
    echoes at positive beat frequencies; samples read with I and Q swapped are their conjugates
    times j, with the echoes on the other side. 0.5 for noise, and for silence.
    """
    spectrum = np.fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    energy = np.sum(np.abs(spectrum) ** 2, axis=tuple(range(samples.ndim - 1)))
    half = (energy.size + 1) // 2
    positive, negative = energy[1:half].sum(), energy[energy.size - half + 1 :].sum()
    both = float(positive + negative)
    return float(negative) / both if both > 0 else 0.5


def guess_iq_order(samples: np.ndarray) -> tuple[Iq, Finding]:
    """Guess the order of I and Q, from samples (..., sample) read with I first.

    Returns
    -------
    iq : {"iq", "qi"}
    finding
        The guess and its evidence.
    """
    negative = negative_beat_energy_fraction(samples)
    iq: Iq = "qi" if negative > 0.5 else "iq"
    positive_share = max(negative, 1 - negative)
    # Noise has equal sides within 0.1 dB over 64 chirps of 256 samples. 1 dB is 0.557.
    is_certain = positive_share > 0.557
    return iq, Finding(
        level="note" if is_certain else "warning",
        setting="iq",
        value=f"missing, assumed to be {iq}, with {positive_share:.1%} of the energy at positive"
        " beat frequencies",
        expected="the order in which I and Q of a sample were written",
        fix="no action needed if echoes appear at the right ranges; else give --iq"
        f" {'iq' if iq == 'qi' else 'qi'}"
        if is_certain
        else "give --iq iq or --iq qi: the sides hardly differ",
    )


def negative_beat_frequency_findings(samples: np.ndarray, iq: Iq) -> tuple[Finding, ...]:
    """Warn if echoes lie at negative beat frequencies, where an up-chirp has none."""
    negative = negative_beat_energy_fraction(samples)
    # Noise has equal sides; 6 dB are no coincidence.
    if negative <= 0.8:
        return ()
    return (
        Finding(
            level="warning",
            setting="iq",
            value=f"{iq}, with {negative:.1%} of the energy at negative beat frequencies",
            expected="echoes at positive beat frequencies, as of an up-chirp",
            fix=f"read it with --iq {'qi' if iq == 'iq' else 'iq'}",
        ),
    )
