"""Which part of a complex sample comes first: told by the side on which echoes lie."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.formats.settings.base import Iq


def energy_below_zero(samples: np.ndarray) -> float:
    """Share of the energy at negative beat frequencies, of samples (..., sample).

    DC, to which the mean of each chirp contributes, counts for neither side. An up-chirp has
    its echoes at positive beat frequencies; samples read with their parts exchanged are
    their conjugates, times j, with the echoes on the other side. 0.5 of noise, and of silence.
    """
    spectrum = np.fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    energy = np.sum(np.abs(spectrum) ** 2, axis=tuple(range(samples.ndim - 1)))
    half = (energy.size + 1) // 2
    positive, negative = energy[1:half].sum(), energy[energy.size - half + 1 :].sum()
    both = float(positive + negative)
    return float(negative) / both if both > 0 else 0.5


def guess(samples: np.ndarray) -> tuple[Iq, Finding]:
    """Order of the parts, from samples (..., sample) read with the in-phase part first.

    Returns
    -------
    iq : {"iq", "qi"}
    finding
        What was guessed, and from what.
    """
    negative = energy_below_zero(samples)
    iq: Iq = "qi" if negative > 0.5 else "iq"
    share = max(negative, 1 - negative)
    # Noise alone has equal sides: within 0.1 dB over 64 chirps of 256 samples. 1 dB is 0.557.
    certain = share > 0.557
    return iq, Finding(
        level="note" if certain else "warning",
        setting="iq",
        got=f"not given, taken as {iq}: {share:.1%} of the energy then lies at positive beat"
        " frequencies",
        need="the order in which the parts of a sample were written",
        fix="Nothing is to be done if echoes appear where they should; else give --iq"
        f" {'iq' if iq == 'qi' else 'qi'}."
        if certain
        else "The sides hardly differ: give --iq iq or --iq qi.",
    )


def on_the_wrong_side(samples: np.ndarray, iq: Iq) -> tuple[Finding, ...]:
    """Warn if echoes lie at negative beat frequencies, where an up-chirp has none."""
    negative = energy_below_zero(samples)
    # Noise alone has equal sides; 6 dB is no chance.
    if negative <= 0.8:
        return ()
    return (
        Finding(
            level="warning",
            setting="iq",
            got=f"{iq}, with {negative:.1%} of the energy at negative beat frequencies",
            need="echoes at positive beat frequencies, as an up-chirp gives",
            fix=f"Read it with --iq {'qi' if iq == 'iq' else 'iq'}.",
        ),
    )
