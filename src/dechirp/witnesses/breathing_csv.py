"""Breathing of 27 a minute, recorded as slow-time I/Q in CSV."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.processing.vital_signs import measure_vital_signs
from dechirp.recordings.slow_time_files import read_slow_time
from dechirp.witnesses.base import Comparison, Witness


class BreathingCsv(Witness):
    """Breathing of a known rate, in windows of 20 s."""

    folder: ClassVar[str] = "breathing_27bpm"
    source: ClassVar[str] = "radarmimo/Download-Center 20bae37, breathing at 27 a minute"
    licence: ClassVar[str] = "none"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the rate of the median window, and of the one farthest from the truth."""
        vital = measure_vital_signs(read_slow_time(folder / "data_27bpm_20Hz.csv"))
        rates_hz = vital.breathing_rate.values
        distances_hz = np.where(np.isnan(rates_hz), np.inf, abs(rates_hz - 27 / 60))
        for quantity, ours in (
            ("breathing rate, median of windows of 20 s", np.median(rates_hz)),
            ("breathing rate, worst window of 20 s", rates_hz[np.argmax(distances_hz)]),
        ):
            yield Comparison(
                quantity=quantity,
                theirs=27 / 60,
                ours=float(ours),
                unit="Hz",
                tolerance=1 / 60,
                basis="1 a minute: the truth is the name of the file, a whole number",
            )
