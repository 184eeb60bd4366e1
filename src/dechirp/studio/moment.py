"""One frame as the page shows it: everything that follows from its samples. No page in here.

What few frames are looked at for, while it plays, is worked out when it is asked for.
"""

from dataclasses import dataclass
from functools import cached_property

import xarray as xr

from dechirp.core.findings import Finding
from dechirp.process.chain import Chain
from dechirp.radar.radar import Radar
from dechirp.studio.past import Kept, micro_doppler
from dechirp.studio.pointing import Beat, Cursor, Cut, beat, cell_of, cuts
from dechirp.tracking.live import Track


@dataclass(frozen=True, eq=False)
class Moment:
    """What is seen in one frame."""

    step: int
    """Counted from the last rewind: what noise is drawn by."""
    number: int
    """Of the frame."""
    n_frames: int
    """Of the source: a scene or a recording, which goes round."""
    time_s: float
    """Of its middle."""
    radar: Radar
    """As it is in this frame."""
    chain: Chain
    """Fitted to the radar."""
    cursor: Cursor
    """Where it looks: at the strongest detection, or the strongest cell, unless it was told."""
    was_told: bool
    """Where to look."""
    samples: xr.DataArray
    """(chirp, rx, sample)"""
    power: xr.DataArray
    """Range-Doppler map, (velocity, range), as the detector sees it."""
    azimuth_power: xr.DataArray | None
    """Range-azimuth map, (azimuth, range); None where the array tells no azimuth."""
    past: tuple[Kept, ...]
    """Of this frame and those before it, from the last rewind or jump on."""
    detections: xr.Dataset
    """With `cluster` and `motion` where those are asked for."""
    clusters: xr.Dataset | None
    tracks: tuple[Track, ...]
    """Told from the last rewind or jump on; none where nobody asked for them."""
    truth: xr.Dataset | None
    """Over `target` and `frame`, of this one alone; None for a recording."""
    findings: tuple[Finding, ...]
    """On the settings or the recording, and on this frame."""
    took_s: float
    """From the first sample to the last table."""

    @cached_property
    def beat(self) -> Beat:
        """What the first receiver hears."""
        return beat(self.samples, self.radar, self.chain)

    @cached_property
    def cuts(self) -> tuple[Cut, Cut]:
        """The map over range, and over velocity, through the cursor."""
        return cuts(self.power, self.radar, self.chain, cell_of(self.power, self.cursor))

    @cached_property
    def micro_doppler(self) -> xr.DataArray:
        """Power about the range of the cursor over (time, velocity): a column is a frame."""
        transform = self.chain.over_range(self.radar.frame.chirp)
        range_m = self.cursor.range_m if self.was_told else None
        return micro_doppler(self.past, self.power, transform, range_m)
