"""Findings on the beat spectrum: the sides of an I/Q mixer, and whether there are echoes."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.spans import spans
from dechirp.core.units import decibels
from dechirp.process.health.recorded import Recorded

_WRONG_SIDE = 0.8
_MIRRORED = 0.995
_STRONG_IMAGE = 1e-2  # -20 dB: a mixer without any correction has -25 to -40 dB


def sides(recorded: Recorded) -> list[Finding]:
    """Samples that are real, in the wrong order, or with an image; empty of real samples."""
    if not recorded.is_complex:
        return []
    mirrored = recorded.of("mirrored")
    known = mirrored[np.isfinite(mirrored)]
    if known.size and np.median(known) > _MIRRORED:
        return [_real(recorded, float(np.median(known)))]
    return [*_wrong_side(recorded), *_image(recorded)]


def _real(recorded: Recorded, mirrored: float) -> Finding:
    power = recorded.of("power").sum(axis=(0, 1))
    weaker = int(np.argmin(power))
    is_dead = power[weaker] < 1e-3 * power[1 - weaker]
    why = f"the {'IQ'[weaker]} part gives nothing" if is_dead else "I and Q are in proportion"
    return Finding(
        level="warning",
        setting="recording.iq",
        got=f"complex samples whose spectrum is its own mirror image to {mirrored:.2%}: {why}",
        need="two parts, of which one lags the other by a quarter of a period",
        fix="If the radar has one mixer, set radar.frame.chirp.sampling to real, or, where each"
        " channel was turned in phase, use the nearer half of the ranges; else a part was lost on"
        " the way.",
    )


def _wrong_side(recorded: Recorded) -> list[Finding]:
    positive, negative = recorded.of("echo_energy").sum(axis=0)
    if not negative > _WRONG_SIDE * (positive + negative):
        return []
    share = negative / (positive + negative)
    half_m = recorded.radar.frame.chirp.max_range_m / 2
    return [
        Finding(
            level="warning",
            setting="recording.iq",
            got=f"{share:.1%} of the energy that stands out of single chirps at negative beat"
            " frequencies",
            need="echoes at positive beat frequencies, as an up-chirp gives: those at negative ones"
            f" would lie beyond {half_m:.4g} m",
            fix="Read it with the other order of I and Q (--iq), unless the strongest echoes are"
            " that far.",
        )
    ]


def _image(recorded: Recorded) -> list[Finding]:
    image = recorded.of("image")
    looked_at = np.isfinite(recorded.of("image_range")) & recorded.arrived
    shows = np.isfinite(image[looked_at])
    often = shows.sum(axis=0) >= max(1, (shows.shape[0] + 1) // 2)
    if not often.any():
        return []
    levels = np.array(
        [np.median(of_rx[np.isfinite(of_rx)]) for of_rx in image[looked_at][:, often].T]
    )
    receivers, levels_db = np.flatnonzero(often), decibels(levels)
    worst = int(np.argmax(levels))
    range_m = float(np.median(recorded.of("image_range")[looked_at]))
    others = (
        f" ({levels_db.min():.1f} to {levels_db.max():.1f} dB in {spans('receiver', receivers)})"
        if receivers.size > 1
        else ""
    )
    return [
        Finding(
            level="warning" if levels[worst] > _STRONG_IMAGE else "note",
            setting="recording.iq_image",
            got=f"an image of {levels_db[worst]:.1f} dB in receiver {receivers[worst]}{others}:"
            f" beside the strongest echo, at {range_m:.4g} m, the mirrored beat frequency",
            need="I and Q of equal gain and a quarter of a period apart; 1 % and 1 degree off make"
            " an image of -40 dB",
            fix="Balance I and Q before processing, or search only the side on which echoes are."
            if levels[worst] > _STRONG_IMAGE
            else "Nothing is to be done unless weak echoes are looked for at mirrored ranges.",
        )
    ]


def echoes(recorded: Recorded) -> list[Finding]:
    """Samples in which nothing stands out of noise."""
    n_echoes = recorded.of("n_echoes")
    known = np.isfinite(n_echoes)
    if not known.any() or n_echoes[known].any():
        return []
    return [
        Finding(
            level="warning",
            setting="recording",
            got="noise alone: in no frame does any beat frequency stand out of the others",
            need="echoes; leakage between the antennas makes one in every room",
            fix="Check the antennas and the layout: samples read in a wrong order look like noise.",
        )
    ]
