"""Findings on the beat spectrum: sides of an I/Q mixer, and presence of echoes."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.text import format_number_ranges
from dechirp.core.units import to_decibels
from dechirp.processing.quality.recording_measures import RecordingMeasures

_WRONG_SIDE = 0.8
_MIRRORED = 0.995
_STRONG_IMAGE = 1e-2  # -20 dB; an uncorrected mixer has -25 to -40 dB


def iq_mixer_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report samples that are real, in the wrong I/Q order, or with an image."""
    if not recorded.has_complex_samples:
        return []
    mirrored = recorded.values_of_measure("mirrored")
    known_similarity = mirrored[np.isfinite(mirrored)]
    if known_similarity.size and np.median(known_similarity) > _MIRRORED:
        return [_real_samples_finding(recorded, float(np.median(known_similarity)))]
    return [*_wrong_iq_order_findings(recorded), *_iq_image_findings(recorded)]


def _real_samples_finding(recorded: RecordingMeasures, mirror_similarity: float) -> Finding:
    power = recorded.values_of_measure("power").sum(axis=(0, 1))
    weaker = int(np.argmin(power))
    is_dead = power[weaker] < 1e-3 * power[1 - weaker]
    reason = f"the {'IQ'[weaker]} part has no signal" if is_dead else "I and Q are proportional"
    return Finding(
        level="warning",
        setting="recording.iq",
        value=f"complex samples whose spectrum is its own mirror image to {mirror_similarity:.2%}:"
        f" {reason}",
        expected="two parts in quadrature",
        fix="if the radar has one mixer, set radar.frame.chirp.sampling to real, also where a"
        " calibration turned the phase of each channel; else a part was lost on the way",
    )


def _wrong_iq_order_findings(recorded: RecordingMeasures) -> list[Finding]:
    positive, negative = recorded.values_of_measure("echo_energy").sum(axis=0)
    if not negative > _WRONG_SIDE * (positive + negative):
        return []
    share = negative / (positive + negative)
    half_m = recorded.radar.frame.chirp.max_range_m / 2
    return [
        Finding(
            level="warning",
            setting="recording.iq",
            value=f"{share:.1%} of the energy that stands out of single chirps at negative beat"
            " frequencies",
            expected="echoes at positive beat frequencies, as an up-chirp gives: those at"
            " negative ones"
            f" would lie beyond {half_m:.4g} m",
            fix="read it with the other order of I and Q (--iq), unless the strongest echoes are"
            " that far",
        )
    ]


def _iq_image_findings(recorded: RecordingMeasures) -> list[Finding]:
    image = recorded.values_of_measure("image")
    is_measured = (
        np.isfinite(recorded.values_of_measure("image_range"))
        & recorded.mask_of_frames_with_samples
    )
    has_image = np.isfinite(image[is_measured])
    is_frequent = has_image.sum(axis=0) >= max(1, (has_image.shape[0] + 1) // 2)
    if not is_frequent.any():
        return []
    levels = np.array(
        [
            np.median(receiver_levels[np.isfinite(receiver_levels)])
            for receiver_levels in image[is_measured][:, is_frequent].T
        ]
    )
    receivers, levels_db = np.flatnonzero(is_frequent), to_decibels(levels)
    worst = int(np.argmax(levels))
    range_m = float(np.median(recorded.values_of_measure("image_range")[is_measured]))
    others = (
        f" ({levels_db.min():.1f} to {levels_db.max():.1f} dB in"
        f" {format_number_ranges('receiver', receivers)})"
        if receivers.size > 1
        else ""
    )
    return [
        Finding(
            level="warning" if levels[worst] > _STRONG_IMAGE else "note",
            setting="recording.iq_image",
            value=f"an image of {levels_db[worst]:.1f} dB in receiver {receivers[worst]}{others}:"
            f" beside the strongest echo, at {range_m:.4g} m, the mirrored beat frequency",
            expected="I and Q of equal gain in quadrature; errors of 1 % and 1 degree make an"
            " image of"
            " -40 dB",
            fix="balance I and Q before processing, or leave images out of the detections by"
            " chain.image_rejection, as run does where moving echoes prove them"
            if levels[worst] > _STRONG_IMAGE
            else "no action needed unless weak echoes at mirrored ranges matter",
        )
    ]


def missing_echo_findings(recorded: RecordingMeasures) -> list[Finding]:
    """Report samples in which no echo exceeds the noise."""
    n_echoes = recorded.values_of_measure("n_echoes")
    is_known = np.isfinite(n_echoes)
    if not is_known.any() or n_echoes[is_known].any():
        return []
    return [
        Finding(
            level="warning",
            setting="recording",
            value="noise only, since no beat frequency stands out in any frame",
            expected="echoes, at least the leakage between the antennas",
            fix="check the antennas and the layout: samples read in a wrong order look like noise",
        )
    ]
