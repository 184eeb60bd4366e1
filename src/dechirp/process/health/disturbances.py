"""Findings on single chirps: bursts of interference, and chirps unlike their neighbours."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import decibels
from dechirp.process.health.recorded import Recorded
from dechirp.process.health.words import chirps_of_frames


def interference(recorded: Recorded) -> list[Finding]:
    """Bursts of energy in parts of chirps."""
    hit = recorded.of("burst") > 1
    if not hit.any():
        return []
    n_chirps = int(np.count_nonzero(~recorded.of("lost")))
    share = float(np.sum(recorded.of("burst_share")[hit])) / n_chirps
    kurtosis = float(np.nanmax(recorded.of("kurtosis")[hit]))
    normal = 2 if recorded.is_complex else 3
    return [
        Finding(
            level="warning",
            setting="recording.interference",
            got=f"bursts in {np.count_nonzero(hit)} of {n_chirps} chirps, {100 * share:.2g} % of"
            f" all samples, kurtosis up to {kurtosis:.3g}:"
            f" {chirps_of_frames(hit, recorded.frame_numbers)}",
            need=f"noise of the same power throughout a chirp, of kurtosis {normal}",
            fix="Another radar or a switching supply, or in a first chirp a receiver that had not"
            " settled: zero those samples before processing, or leave those chirps out.",
        )
    ]


def odd_chirps(recorded: Recorded) -> list[Finding]:
    """Chirps that differ from both neighbours as no echo does."""
    unlike = recorded.of("unlike")
    odd = (unlike > 1) & ~(recorded.of("burst") > 1)
    if not odd.any():
        return []
    largest_db = float(decibels(np.max(unlike[odd])))
    how = (
        f", by up to {largest_db:.0f} dB more than noise and moving echoes explain"
        if np.isfinite(largest_db)
        else ", some of nothing but zeros"
    )
    return [
        Finding(
            level="warning",
            setting="recording.chirps",
            got=f"{np.count_nonzero(odd)} of {np.count_nonzero(~recorded.of('lost'))} chirps unlike"
            f" the ones before and after{how}: {chirps_of_frames(odd, recorded.frame_numbers)}",
            need="equal chirps: one that is not adds to every velocity",
            fix="Leave them out; if it is the first of each frame, the radar had not settled.",
        )
    ]
