"""Range-Doppler maps as CSV tables, one for each frame."""

import csv
import io
from pathlib import Path
from typing import ClassVar

import numpy as np
import xarray as xr

from dechirp.core.atomic_files import atomic_files
from dechirp.core.text import power_level_unit, power_to_dbm_or_dbfs
from dechirp.core.values import frozen_dataclass
from dechirp.processing.chain import Chain
from dechirp.processing.range_doppler_map import power_map
from dechirp.recordings.recording import Recording
from dechirp.recordings.writers.base import Progress, Writer


@frozen_dataclass
class Csv(Writer):
    """Tables of the range-Doppler map of the default chain in decibels, one for each frame."""

    suffixes: ClassVar[tuple[str, ...]] = (".csv",)
    summary: ClassVar[str] = "a table of the map of each frame, in dB; not read back"
    is_readable: ClassVar[bool] = False

    def check_recording(self, recording: Recording) -> None:
        recording.check_has_samples()

    def output_files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """Return the name itself for one frame, numbered names (`map_0003.csv`) for several."""
        if recording.n_frames == 1:
            return (out,)
        return tuple(
            out.with_name(f"{out.stem}_{number:04d}{out.suffix}")
            for number in range(recording.n_frames)
        )

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        names = self.output_files(recording, out)
        with atomic_files(*names) as paths:
            for number, (frame, path) in enumerate(zip(recording.frames(), paths, strict=True)):
                radar = recording.radar.for_frame(number)
                power = power_map(frame.isel(frame=0), radar, Chain().fit_to_radar(radar))
                path.write_bytes(map_to_csv(power, recording.contents.units).encode())
                if progress is not None:
                    progress(number + 1, len(names))
        return names


def map_to_csv(power: xr.DataArray, units: str) -> str:
    """Return a map as CSV: rows are velocities, columns ranges; the first cell gives the unit.

    Levels have a resolution of 0.01 dB, ranges and velocities six digits.
    """
    ordered = power.transpose("velocity", "range")
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    corner = f"power in {power_level_unit(units)}: velocity_m_per_s down and range_m across"
    writer.writerow([corner, *_format_axis(ordered.range.values)])
    levels = np.char.mod("%.2f", power_to_dbm_or_dbfs(ordered.values, units))
    for velocity, row in zip(_format_axis(ordered.velocity.values), levels, strict=True):
        writer.writerow([velocity, *row])
    return stream.getvalue()


def _format_axis(numbers: np.ndarray) -> list[str]:
    return [f"{number:.6g}" for number in numbers]
