"""Pictures of range-Doppler maps, with axes and a colour bar."""

from typing import ClassVar

import xarray as xr

from dechirp.core.values import value
from dechirp.exchange.writers.of_maps import OfMaps
from dechirp.formats.base import Units


@value
class Png(OfMaps):
    """Pictures of the range-Doppler map, one for each frame."""

    endings: ClassVar[tuple[str, ...]] = (".png",)
    keeps: ClassVar[str] = "a picture of the map of each frame; not read back"

    def content(self, power: xr.DataArray, units: Units, title: str) -> bytes:
        """PNG of the figure that `inspect` shows."""
        from dechirp.report.figures.recorded import first_map  # takes 0.5 s, for pictures alone
        from dechirp.report.figures.style import TALL_IN, png

        return png(
            lambda figure: first_map(figure.subplots(), power, units=units),
            title=title,
            height_in=TALL_IN,
        )
