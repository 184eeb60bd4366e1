"""Samples through all the clean-up of a chain, and what it took out of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import decibels
from dechirp.process.mitigation.base import Mitigation, samples_of
from dechirp.radar.frame import Frame


@dataclass(frozen=True)
class Removed:
    """What one method took out of one frame."""

    kind: str
    is_repair: bool
    """Of some samples, not a filter of all."""
    power: float
    """Mean square of what was taken out, over all samples, in the unit of the samples squared."""
    left: float
    """Mean square of what is left."""
    n_chirps: int
    """Chirps in which any sample is another now."""
    of_chirps: int
    """Chirps of the frame."""
    share: float
    """Samples that are others now, over all."""


@dataclass(frozen=True)
class Cleaned:
    """The samples of one frame after clean-up."""

    samples: np.ndarray
    """(chirp, rx, sample), complex64 or float32."""
    removed: tuple[Removed, ...]
    """By each method, in the order in which they acted."""


def cleaned(samples: np.ndarray, frame: Frame, mitigation: Sequence[Mitigation]) -> Cleaned:
    """Clean the samples of one frame, (chirp, rx, sample), by several methods in turn.

    Raises
    ------
    InvalidSetting
        As `Mitigation.clean`.
    """
    now = samples_of(samples, frame)
    removed = []
    for method in mitigation:
        before, now = now, method.clean(now, frame)
        removed.append(_removed(method, before, now))
    return Cleaned(samples=now, removed=tuple(removed))


def _removed(method: Mitigation, before: np.ndarray, after: np.ndarray) -> Removed:
    n_chirps = n_samples = 0
    power = left = 0.0
    for old, new in zip(before, after, strict=True):
        wide = np.result_type(old.dtype, np.float64)
        taken = old.astype(wide) - new
        n_changed = int(np.count_nonzero(taken))
        n_chirps += n_changed > 0
        n_samples += n_changed
        power += np.vdot(taken, taken).real
        left += np.vdot(new.astype(wide), new.astype(wide)).real
    return Removed(
        kind=method.kind(),
        is_repair=not method.filters_slow_time,
        power=float(power / max(before.size, 1)),
        left=float(left / max(before.size, 1)),
        n_chirps=n_chirps,
        of_chirps=len(before),
        share=n_samples / max(before.size, 1),
    )


def summary(frames: Sequence[Sequence[Removed]]) -> list[Finding]:
    """What each method took out of all frames, a note each; `frames` as `Cleaned.removed`."""
    return [_note(of_method) for of_method in zip(*frames, strict=True)]


def _note(removed: Sequence[Removed]) -> Finding:
    power = float(np.mean([one.power for one in removed]))
    left = float(np.mean([one.left for one in removed]))
    share = float(np.mean([one.share for one in removed]))
    n_chirps, of_chirps = (sum(getattr(one, n) for one in removed) for n in _COUNTS)
    if not n_chirps:
        got, fix = f"nothing to be repaired in {of_chirps} chirps", "Nothing is to be done."
    elif removed[0].is_repair:
        got = f"{n_chirps} of {of_chirps} chirps repaired, {share:.2%} of all samples"
        fix = "Nothing is to be done; where most chirps are hit, find out by whom."
    else:
        ratio = f"{float(decibels(power / left)):+.1f} dB of" if power and left else "instead of"
        got = f"taken out: {ratio} what is left"
        fix = "Nothing is to be done; targets at rest went with it."
    return Finding(
        level="note",
        setting=f"chain.mitigation.{removed[0].kind}",
        got=got,
        need="samples that hold echoes alone",
        fix=fix,
    )


_COUNTS = ("n_chirps", "of_chirps")
