"""What writers of range-Doppler maps share: a file for each frame, in place of its samples."""

from abc import abstractmethod
from pathlib import Path
from typing import ClassVar

import xarray as xr

from dechirp.core.values import value
from dechirp.exchange.writers.base import Progress, Writer
from dechirp.formats.base import Units
from dechirp.formats.recording import Recording
from dechirp.process.chain import Chain
from dechirp.process.maps import power_map
from dechirp.store.whole import whole_files


@value
class OfMaps(Writer):
    """The map of each frame, as the default chain gives it."""

    is_read: ClassVar[bool] = False

    @abstractmethod
    def content(self, power: xr.DataArray, units: Units, title: str) -> bytes:
        """Content of a file: a map (velocity, range) of samples in these units, and its title."""

    def check(self, recording: Recording) -> None:
        """See `Writer.check`."""
        recording.must_hold_samples()

    def files(self, recording: Recording, out: Path) -> tuple[Path, ...]:
        """The name itself for one frame; numbered names, as `map_0003.png`, for several."""
        if recording.n_frames == 1:
            return (out,)
        return tuple(
            out.with_name(f"{out.stem}_{number:04d}{out.suffix}")
            for number in range(recording.n_frames)
        )

    def write(
        self, recording: Recording, out: Path, progress: Progress | None = None
    ) -> tuple[Path, ...]:
        """See `Writer.write`."""
        names = self.files(recording, out)
        with whole_files(*names) as places:
            for number, (frame, place) in enumerate(zip(recording.frames(), places, strict=True)):
                radar = recording.radar.at(number)
                power = power_map(frame.isel(frame=0), radar, Chain().fitted(radar))
                which = f", frame {number}" if len(names) > 1 else ""
                title = f"{recording.path.name}{which}"
                place.write_bytes(self.content(power, recording.contents.units, title))
                if progress is not None:
                    progress(number + 1, len(names))
        return names
