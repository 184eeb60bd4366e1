"""Vehicles of the motorway US-101, recorded by NGSIM, in a CommonRoad scenario."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import numpy as np

from dechirp.traffic.traffic import open_traffic
from dechirp.witnesses.base import Comparison, Witness, compare_arrays

_POINT = re.compile(r"<position>\s*<point>\s*<x>([^<]*)</x>\s*<y>([^<]*)</y>")
_SPEED = re.compile(r"<velocity>\s*<exact>([^<]*)</exact>")


class Us101Traffic(Witness):
    """All states, against the numbers of the text in their order."""

    folder: ClassVar[str] = "commonroad_us101"
    source: ClassVar[str] = "CommonRoad/commonroad-io 8275861, USA_US101-4_1_T-1"
    licence: ClassVar[str] = "BSD-3-Clause"

    def compare(self, folder: Path) -> Iterator[Comparison]:
        """Compare the number of vehicles, and positions and speeds of all their states."""
        path = folder / "USA_US101-4_1_T-1.xml"
        obstacles = path.read_text(encoding="utf-8").split("<dynamicObstacle ")[1:]
        obstacles[-1] = obstacles[-1].split("</dynamicObstacle>")[0]
        objects = open_traffic(path).objects
        yield Comparison(
            quantity="vehicles",
            theirs=len(obstacles),
            ours=objects.sizes["object"],
            unit="1",
            tolerance=0,
            basis="equal",
            answer="own",
        )
        is_present = np.isfinite(objects["x"].values)
        points = np.array([pair for text in obstacles for pair in _POINT.findall(text)], float)
        ours = np.stack([objects[name].values[is_present] for name in ("x", "y")], axis=1)
        yield compare_arrays(
            f"positions of {len(points)} states",
            points,
            ours,
            unit="m",
            basis="equal",
            answer="own",
        )
        speeds = [speed for text in obstacles for speed in _SPEED.findall(text)]
        yield compare_arrays(
            f"speeds of {len(speeds)} states",
            np.array(speeds, float),
            np.hypot(objects["vx"].values, objects["vy"].values)[is_present],
            unit="m/s",
            absolute=1e-12,
            relative=1e-12,
            basis="rounding of double precision",
            answer="own",
        )
