"""Interference taken out of single chirps: what the methods share."""

from abc import abstractmethod

import numpy as np

from dechirp.core.findings import Finding
from dechirp.process.health.quiet import FEWEST_CHIRPS, FEWEST_SAMPLES
from dechirp.process.mitigation.base import Mitigation, samples_of
from dechirp.process.mitigation.disturbed import disturbed
from dechirp.radar.frame import Frame
from dechirp.radar.radar import Radar


class Repair(Mitigation):
    """Bursts are found chirp by chirp, and what moves is written anew in them.

    What stands still is known from the other chirps and is kept. Frames without bursts stay as
    they are to the bit: white noise has one with a chance below 1e-12 a chirp.
    """

    @abstractmethod
    def repaired(self, moving: np.ndarray, is_burst: np.ndarray, taps: np.ndarray) -> np.ndarray:
        """What moves in one chirp, (rx, sample), with the samples in bursts written anew.

        `is_burst` (sample,) tells which; `taps` (order,) weigh the samples before, the nearest
        first, to predict the next.
        """

    def clean(self, samples: np.ndarray, frame: Frame) -> np.ndarray:
        """Repair the chirps that have bursts; see `Mitigation.clean`."""
        given = samples_of(samples, frame)
        found = disturbed(given, frame)
        if found is None:
            return given
        out = given.copy()
        for chirp in np.flatnonzero(found.is_burst.any(axis=1)):
            moving = given[chirp] - found.still[chirp % frame.n_slots]
            # So that samples that are not written anew stay as they are, to the bit.
            out[chirp] += self.repaired(moving, found.is_burst[chirp], found.taps) - moving
        return out

    def remark(self, radar: Radar) -> list[Finding]:
        """That frames of few chirps are not looked at."""
        frame = radar.frame
        if frame.n_chirps >= FEWEST_CHIRPS and frame.chirp.n_samples >= FEWEST_SAMPLES:
            return []
        return [
            Finding(
                level="warning",
                setting=f"chain.mitigation.{self.kind()}",
                got=f"frames of {frame.n_chirps} chirps of each transmitter and"
                f" {frame.chirp.n_samples} samples, in which no bursts are looked for",
                need=f"{FEWEST_CHIRPS} chirps and {FEWEST_SAMPLES} samples, to know what is usual",
                fix="Leave it out; it changes nothing.",
            )
        ]
