"""TI TSW1400 captures: uint16 whose middle code stands for zero, `I1 Q1 I2 Q2 ...` a sample."""

from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.samples.bare import bare_contents, must_alternate
from dechirp.formats.samples.layouts import N_LANES, Pairs
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import files_in

_LOOKED_AT = 2**16  # bytes


@value
class Tsw1400(Format):
    """TI TSW1400 captures: offset binary.

    Offset binary, receivers in turn: everything else comes from the settings.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by the codes: weak signals lie about the middle, not about the two ends."""
        if not path.is_file() or foreign(path) is not None:
            return Fit.NO
        with path.open("rb") as file:
            content = file.read(_LOOKED_AT)
        codes = np.frombuffer(content[: len(content) // 2 * 2], "<u2")
        # Two's complement puts weak signals below 0x4000 and above 0xC000, strong ones
        # everywhere: a tone at full scale has a third of its codes in the middle half.
        middle = np.mean((codes >= 0x4000) & (codes < 0xC000)) if codes.size else 0.0
        return Fit.LIKELY if middle > 0.9 else Fit.POSSIBLE

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        settings = settings_for(path, told)
        must_alternate(path, settings)
        order = Pairs(receivers=settings.receivers_of(settings.radar.array.n_rx), n_present=N_LANES)
        return bare_contents(path, files_in(path), [order], settings, told, offset_binary=True)
