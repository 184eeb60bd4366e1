"""TI TSW1400 captures: offset binary uint16, `I1 Q1 I2 Q2 ...` for each sample."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array
from dechirp.recordings.readers.base import (
    Contents,
    Format,
    MatchQuality,
    RecordingHints,
    identify_non_raw_content,
)
from dechirp.recordings.samples.layouts import N_LANES, Pairs
from dechirp.recordings.samples.raw_samples import (
    check_receivers_can_alternate,
    interpret_raw_samples,
)
from dechirp.recordings.settings.antenna_positions import fit_array_to_receiver_count
from dechirp.recordings.settings_lookup import find_recording_settings
from dechirp.recordings.streams.byte_sources import open_concatenated_files

_SAMPLED_BYTES = 2**16  # bytes


@frozen_dataclass
class Tsw1400(Format):
    """TI TSW1400 captures: offset binary.

    Receivers alternate, four without an array in the settings, from which everything else comes.
    """

    options: ClassVar[tuple[str, ...]] = ("iq",)

    def recognise(self, path: Path) -> MatchQuality:
        if not path.is_file() or identify_non_raw_content(path) is not None:
            return MatchQuality.NO
        with path.open("rb") as file:
            content = file.read(_SAMPLED_BYTES)
        codes = np.frombuffer(content[: len(content) // 2 * 2], "<u2")
        # In two's complement, weak signals lie below 0x4000 and above 0xC000, strong ones
        # everywhere: a tone at full scale has a third of its codes in the middle half.
        middle_fraction = np.mean((codes >= 0x4000) & (codes < 0xC000)) if codes.size else 0.0
        return MatchQuality.LIKELY if middle_fraction > 0.9 else MatchQuality.POSSIBLE

    def read(self, path: Path, hints: RecordingHints) -> Contents:
        settings = find_recording_settings(path, hints)
        check_receivers_can_alternate(path, settings)
        if settings.receivers is None and settings.radar.array == Array():
            radar, findings = fit_array_to_receiver_count(settings.radar, N_LANES, file=path)
            settings = replace(settings, radar=radar).with_findings(*findings)
        order = Pairs(
            receivers=settings.chip_receiver_indices(settings.radar.array.n_rx), n_present=N_LANES
        )
        return interpret_raw_samples(
            path,
            open_concatenated_files(path),
            [order],
            settings,
            hints,
            offset_binary=True,
            format_iq="iq",
        )
