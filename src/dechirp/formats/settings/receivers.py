"""Where the receivers are, when nobody said."""

from dataclasses import replace
from pathlib import Path

from dechirp.core.errors import RecordingError
from dechirp.core.findings import Finding
from dechirp.radar.array import Array
from dechirp.radar.chirp import Chirp
from dechirp.radar.radar import Radar


def assumed_line(chirp: Chirp, n_rx: int) -> Array:
    """One transmitter at the origin, and receivers on a line, half a wavelength apart."""
    return Array(rx_m=tuple((0.0, n * chirp.wavelength_m / 2, 0.0) for n in range(n_rx)))


def assumed(n_rx: int) -> Finding:
    """Say that the positions are a guess."""
    return Finding(
        level="note",
        setting="radar.array.rx",
        got=f"{n_rx} receivers at positions that no file gives, taken half a wavelength apart"
        " along y",
        need="their true positions, for directions only; range and velocity do not use them",
        fix="Give the radar with its array.",
    )


def with_receivers(radar: Radar, n_rx: int, *, file: Path) -> tuple[Radar, tuple[Finding, ...]]:
    """Fit the array to the receivers a recording holds.

    A radar whose array was left at its default gets a line of receivers, and a finding
    that says so.

    Raises
    ------
    RecordingError
        If the array was given, with another number of receivers.
    """
    if radar.array.n_rx == n_rx:
        return radar, ()
    if radar.array != Array():
        raise RecordingError(
            file,
            got=f"of {n_rx} receivers",
            need=f"of {radar.array.n_rx}, as many as radar.array.rx has",
            fix="Correct radar.array.rx, or the order of the axes.",
        )
    return replace(radar, array=assumed_line(radar.frame.chirp, n_rx)), (assumed(n_rx),)
