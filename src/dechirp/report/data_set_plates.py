"""Figures of a data set: where targets are and how strong, what was drawn, and a few maps."""

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.units import decibels
from dechirp.core.values import value
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.study import Listed, Study
from dechirp.report.amounts import counted
from dechirp.report.figures import data_set as figures
from dechirp.report.figures import range_doppler
from dechirp.report.figures.style import TALL_IN, svg
from dechirp.report.settings_words import setting_words, value_words, with_unit
from dechirp.scene.folding import Place, on_map

_MOST_ITEMS = 20_000  # that figures look at, evenly over all
_MOST_MARKS = 3000
_MOST_MAPS = 4
_MOST_DRAWN = 6


@value
class Plate:
    """A figure with its caption."""

    title: str
    words: str
    figure: Markup


class Shown:
    """Items that figures show: all, or some evenly over all."""

    def __init__(self, study: Study, data: Mapping[str, xr.Dataset], made: np.ndarray) -> None:
        self.study, self.data, self.made = study, data, made
        step = max(1, -(-len(made) // _MOST_ITEMS))
        points, trials = made[::step].T
        self.n = len(points)
        self.at = {
            "point": xr.DataArray(points, dims="item"),
            "trial": xr.DataArray(trials, dims="item"),
        }
        self.about = "" if step == 1 else f"Of {counted(self.n)} items, evenly over all. "
        known = data["truth"]["class"].values.tolist()
        self.classes = list(dict.fromkeys(known))[: figures.MOST_CLASSES]
        self.of_class = {name: np.flatnonzero(np.array(known) == name) for name in self.classes}

    def plates(self) -> Iterator[Plate]:
        """Draw where targets are, how strong, how many detections there are, what is drawn."""
        if not self.n:
            return
        range_m, velocity, snr = (self._truth(name) for name in ("range", "velocity", "snr"))
        if self.classes:
            step = max(1, max(of.size for of in range_m.values()) // _MOST_MARKS)
            yield Plate(
                title="Where targets are.",
                words="Velocity over range, true, of each target in each frame"
                + (", every so many." if step > 1 else ".")
                + " Where no mark is, nothing can be learned.",
                figure=svg(
                    lambda figure: figures.places(
                        figure.subplots(),
                        {name: (range_m[name][::step], velocity[name][::step]) for name in range_m},
                    )
                ),
            )
            with np.errstate(divide="ignore"):
                levels = {name: decibels(of) for name, of in snr.items()}
            yield Plate(
                title="How strong they are.",
                words="Mean ratio to the noise after integration over samples, chirps and"
                " channels. What is weaker than a detector needs is labelled all the same.",
                figure=_spread(levels, words="ratio of target to noise, dB", of="targets"),
            )
        if "detections" in self.data:
            rows = self.data["detections"]
            counts = (rows.stop - rows.start).isel(self.at).values
            yield Plate(
                title="How many detections items have.",
                words="Of targets and of noise together, all frames. Far to the right are items of"
                " many false alarms, or of bodies with many peaks.",
                figure=_spread(
                    {"": counts.astype(float)},
                    words="detections of an item",
                    of="items",
                    whole=True,
                ),
            )
        yield from self._drawn()

    def maps(self) -> Iterator[Plate]:
        """Draw the maps of a few items, taken by chance, as they are kept."""
        if "power" not in self.data[""] or not len(self.made):
            return
        n = min(_MOST_MAPS, len(self.made))
        chosen = np.sort(np.random.default_rng(0).choice(len(self.made), n, replace=False))
        plan = Plan.of(self.study)
        for point, trial in self.made[chosen].tolist():
            settings = ", ".join(
                f"{setting_words(path)} {value_words(text)}" for path, text in plan.labels(point)
            )
            yield Plate(
                title=f"Point {point}, trial {trial}.",
                words=(f"{settings}. " if settings else "")
                + "First frame. Truth without a spot is a target below the noise.",
                figure=_map(self._marked(plan, point, trial)),
            )

    def _marked(self, plan: Plan, point: int, trial: int) -> range_doppler.MarkedMap:
        top, truth = self.data[""], self.data["truth"]
        level_db = top.power[point, trial, 0].values
        power = xr.DataArray(
            10 ** (level_db / 10),
            dims=("velocity", "range"),
            coords={
                "velocity": top.velocity_bins.values[point, 0],
                "range": top.range_bins.values[point],
            },
        )
        known = truth.isel(point=point, trial=trial, frame=0)
        found = None
        radar = plan.scenario(point, plan.drawn(trial)).radar
        if "detections" in self.data and radar is not None:
            rows = self.data["detections"]
            own = slice(int(rows.start[point, trial]), int(rows.stop[point, trial]))
            first = rows.frame.values[own] == 0
            there = Place(*(rows[name].values[own][first] for name in ("range", "velocity")))
            found = on_map(there, radar.at(0))
        return range_doppler.MarkedMap(
            power=power,
            units="sqrt(W)",
            found=found,
            truth=Place(known.map_range.values, known.map_velocity.values),
        )

    def _truth(self, name: str) -> dict[str, np.ndarray]:
        """Values of all targets of each class, one after the other."""
        of = self.data["truth"][name].isel(self.at).transpose("item", "frame", "target").values
        return {kind: of[..., own].ravel() for kind, own in self.of_class.items()}

    def _drawn(self) -> Iterator[Plate]:
        """Draw how what is drawn lies, over the items."""
        drawn = [axis for axis in self.study.vary if not isinstance(axis, Listed)]
        for axis in drawn[:_MOST_DRAWN]:
            values = self.data["settings"][axis.path.replace("/", "-")]
            along = str(values.dims[0])
            tried = np.unique(self.at[along].values)
            words = setting_words(axis.path)
            yield Plate(
                title=f"{words[:1].upper()}{words[1:]}.",
                words=f"Drawn for each {along}: what is asked for should be filled without gaps.",
                figure=_spread(
                    {"": values.values[tried].astype(float)},
                    words=with_unit(words, axis.unit),
                    of=f"{along}s",
                ),
            )


def _spread(
    classes: Mapping[str, np.ndarray], *, words: str, of: str, whole: bool = False
) -> Markup:
    return svg(
        lambda figure: figures.spread(figure.subplots(), classes, words=words, of=of, whole=whole)
    )


def _map(marked: range_doppler.MarkedMap) -> Markup:
    return svg(lambda figure: range_doppler.whole(figure.subplots(), marked), height_in=TALL_IN)
