"""Findings on the converter: clipping, and the offset of its zero."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.spans import spans
from dechirp.process.health.recorded import Recorded

_END = 1 - 2**-15
"""Of full scale: the highest number of a converter of 16 bits. Those of fewer bits have lower
ones, but readers scale their codes, or they are found by their pile."""
_PILE = 8
"""Numbers at the end over those at the next: a sine has 2.4, the crest of any smooth echo 5.3
at the most (1 / (2^(1/4) - 1), of the fourth power), a clipped one tens and more."""
_FEWEST = 20  # of a pile: extremes of noise come alone
_STEPS = 32  # from end to end: of fewer numbers, one may hold most without being an end
_MANY = 1e-3
"""Share above which clipping is a warning. Clipped in 1e-3 of it, noise has errors 36 dB
below itself; below that, they drown in the noise."""
_LARGE_OFFSET = 0.5  # of full scale: half the range, 6 dB, is lost to echoes
_OFFSET = 0.1


def clipping(recorded: Recorded) -> list[Finding]:
    """Numbers at the ends of the converter's range, counted exactly."""
    counts = _at_ends(recorded)
    n_clipped = int(counts.sum())
    if not n_clipped:
        return []
    n_parts = 2 if recorded.is_complex else 1
    n_each = np.maximum(recorded.of("n_numbers") * n_parts, 1)[:, None]
    shares = counts / n_each
    n_all = int(recorded.of("n_numbers").sum()) * n_parts * counts.shape[1]
    frame, rx = np.unravel_index(np.argmax(shares), shares.shape)
    what = "numbers, I and Q counted apart," if recorded.is_complex else "samples"
    frames = recorded.frame_numbers
    return [
        Finding(
            level="warning" if shares.max() > _MANY else "note",
            setting="recording.clipping",
            got=f"{n_clipped} of {n_all} {what} at an end of the converter's range, in"
            f" {spans('receiver', np.flatnonzero(counts.any(axis=0)))},"
            f" {spans('frame', frames[counts.any(axis=1)])}; most in receiver {rx} of frame"
            f" {frames[frame]}: {shares.max():.3%}",
            need="echoes within the range: what is cut off comes back at false ranges",
            fix="Lower the receivers' gain, or keep strong reflectors out of the near field.",
        )
    ]


def _at_ends(recorded: Recorded) -> np.ndarray:
    """Numbers at an end of the range, (frame, rx).

    An end is the highest or lowest number that a receiver ever gives, if that is the end of
    full scale, or if so many lie there and so few at the next that something cuts them off.
    Runs of equal numbers would tell less: slow echoes have them at their crests, and fast
    ones have none where they are clipped.
    """
    level, count = recorded.of("level").astype(np.float64), recorded.of("count")
    usable = recorded.arrived[:, None] & ~recorded.constant
    out = np.zeros(usable.shape, np.int64)
    for rx in range(usable.shape[1]):
        of_rx, n_of_rx = level[usable[:, rx], rx], count[usable[:, rx], rx]
        if not len(of_rx):
            continue
        reach = of_rx[:, :, 0, 0].max() - of_rx[:, :, 1, 0].min()
        for end, sign in enumerate((1.0, -1.0)):
            numbers, occurs = sign * of_rx[:, :, end], n_of_rx[:, :, end]
            last = numbers.max()
            at_last = np.where(numbers == last, occurs, 0).sum(axis=(1, 2))
            # Of a constant part there is no next; -inf then, which occurs 0 times.
            following = np.max(numbers[numbers < last], initial=-np.inf)
            n_following = occurs[numbers == following].sum()
            is_pile = (
                at_last.sum() >= max(_FEWEST, _PILE * n_following)
                and reach >= _STEPS * (last - following)
            )  # fmt: skip
            if is_pile or (recorded.has_full_scale and last >= _END):
                out[usable[:, rx], rx] += at_last
    return out


def offset(recorded: Recorded) -> list[Finding]:
    """Mean of each receiver, if it is large in itself or beside the rest."""
    if not recorded.arrived.any():
        return []
    usable = ~recorded.stuck
    mean = recorded.of("mean")[recorded.arrived].mean(axis=0)
    rest = np.sqrt(recorded.rest_power)
    size = np.abs(mean).max(axis=1)
    is_large = usable & (np.sqrt((mean**2).sum(axis=1)) > rest)
    if recorded.has_full_scale:
        is_large |= usable & (size > _OFFSET)
    if not is_large.any():
        return []
    worst = int(np.argmax(np.where(is_large, size, -1.0)))
    part = int(np.argmax(np.abs(mean[worst])))
    named = f" {'IQ'[part]} of" if recorded.is_complex else ""
    unit = "of full scale" if recorded.has_full_scale else "sqrt(W)"
    over_rest = np.abs(mean[worst, part]) / max(rest[worst], 1e-300)
    too_large = recorded.has_full_scale and size[worst] > _LARGE_OFFSET
    return [
        Finding(
            level="warning" if too_large else "note",
            setting="recording.offset",
            got=f"a mean that is not zero in {spans('receiver', np.flatnonzero(is_large))}, the"
            f" largest in{named} receiver {worst}: {mean[worst, part]:.4g} {unit},"
            f" {over_rest:.3g} times the RMS of the rest",
            need="samples about zero: an offset takes range from the converter and looks like an"
            " echo at range 0",
            fix="Half the range is left to echoes, or less: set the receiver's offset."
            if too_large
            else "Nothing is to be done: a window keeps it in the first range bins.",
        )
    ]
