"""TI xWR14xx capture demo, read from the chip's memory by the debugger.

int16, (chirp in the order sent, sample, rx, I and Q).
"""

from pathlib import Path
from typing import ClassVar

from dechirp.core.values import frozen_dataclass
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)
from dechirp.recordings.samples.layouts import Pairs
from dechirp.recordings.samples.raw_samples import (
    check_receivers_can_alternate,
    interpret_raw_samples,
)
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.byte_sources import open_concatenated_files


@frozen_dataclass
class Xwr14xxCapture(Format):
    """TI xWR14xx capture demo: memory read by the debugger.

    Raw samples with alternating receivers, I and Q of a receiver side by side.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        return (
            MatchQuality.POSSIBLE
            if path.is_file() and identify_non_raw_content(path) is None
            else MatchQuality.NO
        )

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        settings = find_recording_settings(path, hints)
        check_receivers_can_alternate(path, settings)
        n_rx = settings.radar.array.n_rx
        order = Pairs(receivers=tuple(range(n_rx)), n_present=n_rx)
        return interpret_raw_samples(path, open_concatenated_files(path), [order], settings, hints)
