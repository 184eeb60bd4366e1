"""TI xWR14xx capture demo, read from the chip's memory by the debugger.

int16, (chirp in the order sent, sample, rx, I and Q).
"""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import value
from dechirp.formats.base import Contents, Fit, Format, Told, foreign
from dechirp.formats.samples.bare import bare_contents, must_alternate
from dechirp.formats.samples.layouts import Pairs
from dechirp.formats.settings_for import settings_for
from dechirp.formats.streams.bytes_in import files_in


@value
class Xwr14xxCapture(Format):
    """TI xWR14xx capture demo: memory read by the debugger.

    Bare samples, I and Q of a receiver side by side, receivers in turn.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> Fit:
        """Tell by nothing in the content being of another kind; bare samples have no mark."""
        return Fit.POSSIBLE if path.is_file() and foreign(path) is None else Fit.NO

    def read(self, path: Path, told: Told) -> Contents:
        """See `Format.read`."""
        settings = settings_for(path, told)
        must_alternate(path, settings)
        n_rx = settings.radar.array.n_rx
        order = Pairs(receivers=tuple(range(n_rx)), n_present=n_rx)
        return bare_contents(path, files_in(path), [order], settings, told)
