"""Breathing of a sitting person from the tests of Acconeer's Exploration Tool."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.vital_signs import VitalSigns, measure_vital_signs
from dechirp.recordings.arrays.hdf5_datasets import open_hdf5
from dechirp.recordings.slow_time_files import read_slow_time
from dechirp.witnesses.base import Comparison, Witness

_WINDOW_S = 20.0  # `time_series_length_s` of the vendor's settings in the file
_N_COMPARED = 5


class AcconeerBreathing(Witness):
    """Breathing rates of Acconeer's application at five times, from the 20 s before each."""

    folder: ClassVar[str] = "acconeer_breathing"
    source: ClassVar[str] = "acconeer/acconeer-python-exploration e29f30d, breathing, sitting"
    licence: ClassVar[str] = "BSD-3-Clause-Clear"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the rates at equal steps of the time in which the vendor gives any."""
        trace = read_slow_time(folder / "breathing-sitting.h5")
        with open_hdf5(folder / "breathing-sitting-expected.h5") as file:
            theirs_per_minute = file["breathing_rate"][()]
        measured = np.flatnonzero(np.isfinite(theirs_per_minute))
        # The centres of five equal parts.
        parts = np.array_split(measured, _N_COMPARED)
        times_s = trace.coords["time"].values
        for frame in (int(part[len(part) // 2]) for part in parts):
            is_before = (times_s > times_s[frame] - _WINDOW_S) & (times_s <= times_s[frame])
            vital = measure_vital_signs(
                trace.isel(time=is_before), VitalSigns(range_m=(0.3, 1.5), window_s=_WINDOW_S)
            )
            yield Comparison(
                quantity=f"breathing rate in the 20 s before {times_s[frame] - times_s[0]:.1f} s",
                theirs=float(theirs_per_minute[frame]) / 60,
                ours=float(vital.breathing_rate[0]),
                unit="Hz",
                tolerance=1 / 60,
                basis="1 a minute: a third of the resolution of 20 s",
            )
