"""Application of the mitigation methods of a chain, and the echoes that they remove."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import to_decibels
from dechirp.processing.mitigation.base import Mitigation, checked_single_precision_samples
from dechirp.radar.frame import Frame


@dataclass(frozen=True)
class RemovedEcho:
    """Signal that one method removed from one frame."""

    kind: str
    is_repair: bool
    """True if the method repairs some samples instead of filtering all."""
    removed_power: float
    """Mean square of the removed signal over all samples, in the unit of the samples squared."""
    remaining_power: float
    """Mean square of the remaining signal."""
    n_changed_chirps: int
    """Number of chirps with a changed sample."""
    n_frame_chirps: int
    """Number of chirps of the frame."""
    changed_share: float
    """Share of changed samples."""


@dataclass(frozen=True)
class MitigatedFrame:
    """Samples of one frame after mitigation."""

    samples: np.ndarray
    """Samples (chirp, rx, sample), complex64 or float32."""
    removed: tuple[RemovedEcho, ...]
    """Signals removed by each method, in order of application."""


def apply_mitigation(
    samples: np.ndarray, frame: Frame, mitigation: Sequence[Mitigation]
) -> MitigatedFrame:
    """Apply methods in turn to the samples of one frame, (chirp, rx, sample).

    Raises
    ------
    InvalidSetting
        As `Mitigation.clean`.
    """
    current = checked_single_precision_samples(samples, frame)
    removed = []
    for method in mitigation:
        previous, current = current, method.clean(current, frame)
        removed.append(_measure_removed_signal(method, previous, current))
    return MitigatedFrame(samples=current, removed=tuple(removed))


def _measure_removed_signal(
    method: Mitigation, samples_before: np.ndarray, samples_after: np.ndarray
) -> RemovedEcho:
    n_chirps = n_samples = 0
    power = remaining_power = 0.0
    for chirp_before, chirp_after in zip(samples_before, samples_after, strict=True):
        dtype = np.result_type(chirp_before.dtype, np.float64)
        difference = chirp_before.astype(dtype) - chirp_after
        n_changed = int(np.count_nonzero(difference))
        n_chirps += n_changed > 0
        n_samples += n_changed
        power += np.vdot(difference, difference).real
        remaining_power += np.vdot(chirp_after.astype(dtype), chirp_after.astype(dtype)).real
    return RemovedEcho(
        kind=method.kind(),
        is_repair=not method.filters_slow_time,
        removed_power=float(power / max(samples_before.size, 1)),
        remaining_power=float(remaining_power / max(samples_before.size, 1)),
        n_changed_chirps=n_chirps,
        n_frame_chirps=len(samples_before),
        changed_share=n_samples / max(samples_before.size, 1),
    )


def mitigation_findings(frames: Sequence[Sequence[RemovedEcho]]) -> list[Finding]:
    """Report the signal removed from all frames, one note for each method."""
    return [_removed_signal_finding(of_method) for of_method in zip(*frames, strict=True)]


def _removed_signal_finding(removed: Sequence[RemovedEcho]) -> Finding:
    power = float(np.mean([echo.removed_power for echo in removed]))
    remaining_power = float(np.mean([echo.remaining_power for echo in removed]))
    share = float(np.mean([echo.changed_share for echo in removed]))
    n_chirps, n_frame_chirps = (sum(getattr(echo, field) for echo in removed) for field in _COUNTS)
    if not n_chirps:
        value, fix = f"nothing to repair in {n_frame_chirps} chirps", "no action needed"
    elif removed[0].is_repair:
        value = f"{n_chirps} of {n_frame_chirps} chirps repaired, {share:.2%} of all samples"
        fix = "no action needed; if most chirps are hit, identify the interferer"
    else:
        ratio = (
            f"{float(to_decibels(power / remaining_power)):+.1f} dB of"
            if power and remaining_power
            else "instead of"
        )
        value = f"removed power: {ratio} the remaining power"
        fix = "no action needed; static targets are removed as well"
    return Finding(
        level="note",
        setting=f"chain.mitigation.{removed[0].kind}",
        value=value,
        expected="samples that contain only echoes",
        fix=fix,
    )


_COUNTS = ("n_changed_chirps", "n_frame_chirps")
