"""Two standing vehicles in a trace of ASAM OSI `SensorView`."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.traffic.traffic import open_traffic
from dechirp.witnesses.base import Comparison, Witness, compare_arrays


class OsiStandingObjects(Witness):
    """Numbers of objects and messages, and positions, that the publishers state."""

    folder: ClassVar[str] = "osi_traces"
    source: ClassVar[str] = "openMSL/sl-5-5-osi-trace-file-player a463308"
    licence: ClassVar[str] = "MPL-2.0"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the whole trace."""
        traffic = open_traffic(folder / "20230621T113737Z_sv_350_32112_100.osi")
        for name, theirs, ours in (
            ("messages", 100, traffic.objects.sizes["time"]),
            ("objects", 2, traffic.objects.sizes["object"]),
        ):
            yield Comparison(
                quantity=name, theirs=theirs, ours=ours, unit="1", tolerance=0, basis="equal"
            )
        positions = traffic.objects["x"].values
        yield compare_arrays(
            "distances of both objects in all messages",
            np.broadcast_to([[10.0], [25.0]], positions.shape),
            positions,
            unit="m",
            basis="equal",
        )
