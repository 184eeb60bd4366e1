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
_TIMES_S = (26, 29, 32, 35, 38)
_N_COMPARED = 27  # every 0.5 s of the 13.5 s in which the vendor gives any
_TOLERANCE_HZ = 1 / 60
_BASIS = "1 a minute: a third of the resolution of 20 s"


class AcconeerBreathing(Witness):
    """Breathing rates of Acconeer's application, from the 20 s before each."""

    folder: ClassVar[str] = "acconeer_breathing"
    source: ClassVar[str] = "acconeer/acconeer-python-exploration e29f30d, breathing, sitting"
    licence: ClassVar[str] = "BSD-3-Clause-Clear"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the rates every 3 s, and count those every 0.5 s that agree."""
        trace = read_slow_time(folder / "breathing-sitting.h5")
        with open_hdf5(folder / "breathing-sitting-expected.h5") as file:
            theirs_hz = file["breathing_rate"][()] / 60
        times_s = trace.coords["time"].values - trace.coords["time"].values[0]

        def measure_before(frame: int) -> float:
            is_before = (times_s > times_s[frame] - _WINDOW_S) & (times_s <= times_s[frame])
            vital = measure_vital_signs(
                trace.isel(time=is_before), VitalSigns(range_m=(0.3, 1.5), window_s=_WINDOW_S)
            )
            return float(vital.breathing_rate[0])

        for time_s in _TIMES_S:
            frame = int(np.argmin(abs(times_s - time_s)))
            ours_hz = measure_before(frame)
            yield Comparison(
                quantity=f"breathing rate in the 20 s before {time_s} s",
                theirs=float(theirs_hz[frame]),
                ours=ours_hz,
                unit="Hz",
                tolerance=_TOLERANCE_HZ,
                basis=_BASIS,
            )
        measured = np.flatnonzero(np.isfinite(theirs_hz))
        frames = measured[:: max(len(measured) // _N_COMPARED, 1)]
        n_agreeing = sum(
            abs(measure_before(int(frame)) - theirs_hz[frame]) <= _TOLERANCE_HZ for frame in frames
        )
        yield Comparison(
            quantity="vendor's breathing rates, every 0.5 s, within 1 a minute of ours",
            theirs=len(frames),
            ours=float(n_agreeing),
            unit="1",
            tolerance=0.0,
            basis=f"all of them; {_BASIS}",
        )
