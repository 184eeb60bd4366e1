"""Base class of the formats of traffic files, and the rows that they read."""

from abc import abstractmethod
from collections.abc import Iterator
from math import nan
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

from dechirp.core.errors import RecordingError
from dechirp.core.families import Family
from dechirp.core.findings import Finding

ObjectKind = Literal[
    "car",
    "van",
    "truck",
    "bus",
    "motorcycle",
    "bicyclist",
    "pedestrian",
    "other",
    "wall",
    "building",
    "guard-rail",
    "pole",
    "tree",
    "hedge",
    "overhead",
]
STRUCTURE_KINDS = frozenset({"wall", "building", "guard-rail", "pole", "tree", "hedge", "overhead"})
"""Kinds that never move. They shadow and reflect, but are no road users to detect."""


class ObjectState(NamedTuple):
    """Row of a traffic file: one object at one time. NaN where the file states nothing."""

    time_s: float
    id: int
    kind: ObjectKind
    x_m: float
    y_m: float
    z_m: float = nan
    """Centre of the object, in the axes of the file; z upwards."""
    heading_rad: float = nan
    """Counterclockwise from the x axis."""
    vx_m_per_s: float = nan
    vy_m_per_s: float = nan
    length_m: float = nan
    width_m: float = nan
    height_m: float = nan
    is_stationary: bool = False
    """True: the object stays at its place at all times of the file, also without rows."""


class CutTrafficError(RecordingError):
    """File that ends within a message or a line; the states before it are complete."""


class TrafficFormat(Family):
    """Base class of the formats of traffic files."""

    group: ClassVar[str] = "dechirp.traffic"

    @classmethod
    @abstractmethod
    def recognises(cls, path: Path) -> bool:
        """Return True if the name and the first bytes of a file are those of the format."""

    @abstractmethod
    def read_states(self, path: Path) -> Iterator[ObjectState]:
        """Yield the states of all objects, in the order of the file.

        Raises
        ------
        CutTrafficError
            If the file ends within a message or a line.
        RecordingError
            If the file is damaged, with the place.
        """

    def read_findings(self, path: Path) -> tuple[Finding, ...]:
        """Return findings on the file itself, such as a version that it does not state."""
        return ()

    def read_host(self, path: Path) -> int | None:
        """Return the id of the vehicle that the file is about, None if it names none."""
        return None
