"""What a user should know about the maps that a chain makes."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.units import decibels
from dechirp.process.angle.aperture import aperture
from dechirp.process.cfar.base import Cfar, Noise
from dechirp.process.cfar.leakage import guard_loss
from dechirp.process.chain import Chain
from dechirp.process.sources import tells_directions
from dechirp.process.spectrum import Transform, independent_rows
from dechirp.radar.radar import Radar


def remarks(radar: Radar, chain: Chain) -> list[Finding]:
    """What a user should know about the maps this chain makes for a radar."""
    noise, training, guard = chain.noise(radar), chain.cfar.n_training, chain.cfar.n_guard
    found = [remark for method in chain.mitigation for remark in method.remark(radar)]
    if training.range:
        found += _guard_remarks("range", guard.range, noise.over_range, chain.cfar, noise)
    if training.velocity:
        found += _guard_remarks("velocity", guard.velocity, noise.over_velocity, chain.cfar, noise)
    error = chain.cfar.error(noise)
    if error:
        found.append(
            Finding(
                level="note" if error < 0.05 else "warning",
                setting="chain.cfar.estimator",
                got=f"a factor for {chain.cfar.estimator.kind()} in cells that windows or padding"
                f" tie together is calibrated by simulation, with a standard error of {error:.1%}"
                " of the false-alarm probability",
                need="an exact factor, where the probability must be closer than that",
                fix="Choose cell-averaging, whose factor is exact, or leave it.",
            )
        )
    chirp, n_rows = radar.frame.chirp, noise.over_range.n_bins // 2 + 1
    if chirp.sampling == "real":
        rows = independent_rows(chirp, noise.over_range)
        found.append(
            Finding(
                level="note",
                setting="radar.frame.chirp.sampling",
                got=f"real samples: {rows.start} rows at range 0 and {n_rows - rows.stop} at"
                f" {chirp.max_range_m:.4g} m are not searched",
                need="noise that is independent of its mirror image, for false alarms as designed",
                fix="Nothing is to be done; pad less to lose fewer metres.",
            )
        )
    if chain.angle is not None and tells_directions(radar):
        found += chain.angle.remarks(aperture(radar, chain.field_of_view))
    return found


def _guard_remarks(
    axis: str, n_guard: int, transform: Transform, cfar: Cfar, noise: Noise
) -> list[Finding]:
    """A warning where a target would raise its own threshold."""
    needed = int(np.ceil(transform.main_lobe_bins)) - 1
    if n_guard >= needed:
        return []
    loss = guard_loss(cfar, noise)
    costs = f"costs {decibels(loss):.1f} dB" if np.isfinite(loss) else "hides every target"
    return [
        Finding(
            level="warning",
            setting=f"chain.cfar.n_guard.{axis}",
            got=f"{n_guard} guard cells inside a main lobe of {transform.main_lobe_bins:.3g} bins"
            f" on each side, which {costs}",
            need=f"{needed} or more, or a target raises its own threshold",
            fix="Widen the guard, or pad less.",
        )
    ]
