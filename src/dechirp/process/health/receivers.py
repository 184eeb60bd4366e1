"""Findings on receivers: silent, stuck, dead, copied, or in another order."""

import numpy as np

from dechirp.core.findings import Finding
from dechirp.core.spans import spans
from dechirp.core.units import decibels
from dechirp.process.health.receiver_order import better_order, line
from dechirp.process.health.recorded import Recorded

_DEAD = 1e-3  # 30 dB below the others: no antenna pattern does that in all directions


def silence(recorded: Recorded) -> list[Finding]:
    """Frames in which nothing changes at all."""
    silent = recorded.silent
    if not silent.any():
        return []
    level = recorded.of("level")[silent]
    what = "zero" if not np.any(level[..., 0]) else "the same number in each receiver"
    frames = recorded.frame_numbers[silent]
    n_arrived = int(recorded.arrived.sum())
    where = "all frames" if silent.sum() == n_arrived else spans("frame", frames)
    return [
        Finding(
            level="warning",
            setting="recording",
            got=f"silent in {where}: every sample is {what}",
            need="noise at least, which every receiver has",
            fix="Check that the radar was sending, and that the settings say where samples begin.",
        )
    ]


def receivers(recorded: Recorded) -> list[Finding]:
    """Receivers that give nothing, or the samples of another."""
    if recorded.silent[recorded.arrived].all():
        return []
    return [*_stuck(recorded), *_dead(recorded), *_copied(recorded)]


def _stuck(recorded: Recorded) -> list[Finding]:
    constant = recorded.constant & ~recorded.silent[:, None]
    if not constant.any():
        return []
    always = recorded.stuck
    at_times = constant.any(axis=0) & ~always
    found = []
    if always.any():
        found.append(f"in {spans('receiver', np.flatnonzero(always))}")
    if at_times.any():
        frames = recorded.frame_numbers[constant[:, at_times].any(axis=1)]
        named = spans("receiver", np.flatnonzero(at_times))
        found.append(f"in {named} of {spans('frame', frames)}")
    return [_not_working(f"the same number always {where}") for where in found]


def _dead(recorded: Recorded) -> list[Finding]:
    power, working = recorded.rest_power, np.flatnonzero(~recorded.stuck)
    found = []
    for rx in working:
        others = np.median(power[working[working != rx]]) if working.size > 1 else 0.0
        if power[rx] < _DEAD * others:
            below_db = float(decibels(others / max(power[rx], 1e-30 * others)))
            found.append(
                _not_working(f"receiver {rx} {below_db:.1f} dB below the median of the others")
            )
    return found


def _not_working(got: str) -> Finding:
    return Finding(
        level="warning",
        setting="recording.receivers",
        got=got,
        need="receivers of about the same power: one that gives nothing spoils angles",
        fix="Check that it was switched on (the receiver mask) and connected; else leave it out.",
    )


def _copied(recorded: Recorded) -> list[Finding]:
    looked_at = recorded.arrived & ~recorded.silent
    copies = recorded.of("copy_of")[looked_at]
    found = []
    for rx in range(copies.shape[1]):
        first = int(copies[0, rx])
        if first >= 0 and np.all(copies[:, rx] == first):
            found.append(
                Finding(
                    level="warning",
                    setting="recording.receivers",
                    got=f"receiver {rx} the same as receiver {first}, to the bit",
                    need="samples of its own: two receivers have different noise",
                    fix="Check the number of receivers and the order of samples in the settings.",
                )
            )
    return found


def order(recorded: Recorded) -> list[Finding]:
    """Receivers on a line that lie in another order than the settings say."""
    on_line = line(recorded.radar.array)
    seen = recorded.of("seen")
    if on_line is None or seen.shape[2] != on_line.size:
        return []
    better = better_order(
        seen.reshape(-1, on_line.size), recorded.of("seen_snr").reshape(-1), on_line
    )
    if better is None:
        return []
    names = " ".join(map(str, better.order))
    given = " ".join(str(int(rx)) for rx in on_line)
    return [
        Finding(
            level="warning",
            setting="recording.receiver_order",
            got=f"{given} along the line, in which beams have a gain of {better.given_gain:.2f}"
            f" on the mean of {better.n_cells} echoes; {names} has {better.gain:.2f}",
            need="the order in which the receivers lie: echoes then have a gain near 1",
            fix="Correct radar.array.rx; the reversed order, which mirrors angles, fits as well.",
        )
    ]
