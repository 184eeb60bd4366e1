"""What several parts of the page need of a result."""

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from dechirp.core.values import value
from dechirp.evaluate.match import Match, match, scatterers, visible
from dechirp.radar.radar import Radar
from dechirp.report.places import in_bodies
from dechirp.scene import folding
from dechirp.scene.folding import Place, on_map

if TYPE_CHECKING:
    from dechirp.experiment.run import Result

_MOST_SCATTERERS = 600  # more are no clearer, and the page would be large


@value
class View:
    """A result, with its detections in order and beside the truth."""

    result: "Result"
    first: xr.DataArray
    """Cube of the first frame."""
    strongest: xr.Dataset
    """The detections, strongest first."""
    matched: Match | None
    """Their targets, in the same order, where the truth is known."""
    cell: tuple[int, int]
    """Cell (velocity, range) of the map with the strongest detection, or the strongest cell."""
    found: Place
    """Detections of the first frame, where their peaks lie on the map."""
    seen: Place | None
    """The truth as a perfect detector reports it, (target, frame); unfolded where folds are."""

    @property
    def units(self) -> str:
        """Units of the samples."""
        return str(self.first.attrs["units"])

    def at_cell(self, of_map: xr.DataArray) -> float:
        """Value of a map at that cell."""
        row, column = self.cell
        return float(of_map.isel(velocity=row, range=column))

    @property
    def in_first_frame(self) -> xr.Dataset:
        """The detections of the first frame, strongest first."""
        of_first = self.strongest.frame.values == self.result.first_frame
        return self.strongest.isel(detection=np.flatnonzero(of_first))

    @property
    def is_point(self) -> np.ndarray:
        """Whether each target of the scene is a point, and no body."""
        scene = self.result.scenario.scene
        targets = () if scene is None else scene.targets
        return np.array([target.body is None for target in targets], dtype=bool)

    @property
    def expected(self) -> Place | None:
        """The truth of the first frame, where its peaks lie on the map: targets, not bodies."""
        if self.seen is None:
            return None
        first = Place(*(of[self.is_point, 0] for of in self.seen))
        return on_map(first, self.result.radar.at(self.result.first_frame))

    @property
    def scatterers(self) -> Place | None:
        """Of bodies in the first frame, where their peaks lie on the map; of many, some.

        Hidden ones have no peak.
        """
        scene, truth = self.result.scenario.scene, self.result.truth
        if scene is None or truth is None:
            return None
        there = scatterers(scene, truth.time.values[:1])
        shown = visible(scene, float(truth.time[0]), self.result.radar)
        chosen = in_bodies(scene, _MOST_SCATTERERS, shown)
        radar = self.result.radar.at(self.result.first_frame)
        place = folding.folded(Place(*(of[0, chosen] for of in there)), radar)
        return on_map(place, radar)


def view_of(result: "Result") -> View:
    """Sort the detections, give them their targets, and find them on the map."""
    order = np.argsort(-result.detections.snr.values, kind="stable")
    strongest = result.detections.isel(detection=order)
    in_map = strongest.isel(detection=np.flatnonzero(strongest.frame.values == result.first_frame))
    there = Place(in_map.range.values, in_map.velocity.values)
    found = on_map(there, result.radar.at(result.first_frame))
    matched = seen = None
    if result.truth is not None:
        matched = match(strongest, result.truth, result.radar, result.scenario.scene)
        seen = _seen(result.truth, result.radar, strongest.fold.values, matched)
    return View(
        result=result,
        first=next(iter(result.frames())),
        strongest=strongest,
        matched=matched,
        cell=_strongest_cell(result.power, found),
        found=found,
        seen=seen,
    )


def _seen(truth: xr.Dataset, radar: Radar, fold: np.ndarray, matched: Match) -> Place:
    """The truth as it is reported: unfolded where most detections of a target tell the fold."""
    folds = radar.frame.n_folds if radar.frame.n_intervals == 1 else None
    found, of = matched.target >= 0, truth.sizes["target"]
    n_found = np.bincount(matched.target[found], minlength=of)
    n_told = np.bincount(matched.target[found], np.isfinite(fold[found]), minlength=of)
    is_told = (2 * n_told > n_found)[:, None]
    folded, unfolded = folding.seen(truth, radar), folding.seen(truth, radar, folds=folds)
    return Place(*(np.where(is_told, *both) for both in zip(unfolded, folded, strict=True)))


def _strongest_cell(power: xr.DataArray, found: Place) -> tuple[int, int]:
    """Find the cell (velocity, range) where the first detection peaks, or the map's strongest."""
    labelled = power.transpose("velocity", "range")
    around = [slice(None), slice(None)]
    if found.range_m.size:
        # Noise may raise a neighbour above the nearest cell.
        row = int(abs(labelled.velocity.values - found.velocity_m_per_s[0]).argmin())
        column = int(abs(labelled.range.values - found.range_m[0]).argmin())
        around = [slice(max(cell - 1, 0), cell + 2) for cell in (row, column)]
    near = labelled.values[tuple(around)]
    up, right = divmod(int(near.argmax()), near.shape[1])
    return (around[0].start or 0) + up, (around[1].start or 0) + right
