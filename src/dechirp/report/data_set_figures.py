"""Figures of a data set: targets, SNR, detections, random settings and example maps."""

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr
from markupsafe import Markup

from dechirp.core.units import to_decibels
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.study import Study, SweptSetting
from dechirp.report.check_values import format_count
from dechirp.report.figures import data_set as figures
from dechirp.report.figures import range_doppler
from dechirp.report.figures.style import TALL_IN, FigureWithCaption, render_svg
from dechirp.report.labels import axis_label, setting_label, value_label
from dechirp.scene.aliasing import RangeVelocity, range_doppler_map_position

_MAX_ITEMS = 20_000  # shown in figures, evenly selected
_MAX_MARKS = 3000
_MAX_MAPS = 4
_MAX_RANDOM_SETTINGS = 6


class DataSetFigures:
    """Figures of a data set, from all items or an even selection of them."""

    def __init__(
        self, study: Study, data: Mapping[str, xr.Dataset], item_indices: np.ndarray
    ) -> None:
        self.study, self.data, self.made = study, data, item_indices
        step = max(1, -(-len(item_indices) // _MAX_ITEMS))
        points, trials = item_indices[::step].T
        self.n = len(points)
        self.item_index = {
            "point": xr.DataArray(points, dims="item"),
            "trial": xr.DataArray(trials, dims="item"),
        }
        self.sample_note = (
            "" if step == 1 else f"Of {format_count(self.n)} items, evenly over all. "
        )
        target_classes = data["truth"]["class"].values.tolist()
        self.classes = list(dict.fromkeys(target_classes))[: figures.MAX_CLASSES]
        self.targets_by_class = {
            name: np.flatnonzero(np.array(target_classes) == name) for name in self.classes
        }

    def draw_distributions(self) -> Iterator[FigureWithCaption]:
        """Draw the distributions of targets, SNR, detection counts and random settings."""
        if not self.n:
            return
        range_m, velocity, snr = (
            self._true_values_by_class(name) for name in ("range", "velocity", "snr")
        )
        if self.classes:
            step = max(1, max(values.size for values in range_m.values()) // _MAX_MARKS)
            yield FigureWithCaption(
                title="Targets.",
                caption="True velocity over range of each target in each frame"
                + (" (a regular subset)." if step > 1 else ".")
                + " Regions without marks are not covered by the data set.",
                figure=render_svg(
                    lambda figure: figures.draw_target_velocity_over_range(
                        figure.subplots(),
                        {name: (range_m[name][::step], velocity[name][::step]) for name in range_m},
                    )
                ),
            )
            with np.errstate(divide="ignore"):
                levels = {name: to_decibels(values) for name, values in snr.items()}
            yield FigureWithCaption(
                title="SNR of targets.",
                caption="Mean SNR after integration over samples, chirps and channels. Targets too"
                " weak for detection are labelled, too.",
                figure=_draw_histogram(levels, label="SNR (dB)", counted_things="targets"),
            )
        if "detections" in self.data:
            rows = self.data["detections"]
            counts = (rows.stop - rows.start).isel(self.item_index).values
            yield FigureWithCaption(
                title="Detections per item.",
                caption="Detections of targets and false alarms in all frames of an item. High"
                " counts"
                " are items with many false alarms, or bodies with many peaks.",
                figure=_draw_histogram(
                    {"": counts.astype(float)},
                    label="Detections per item",
                    counted_things="items",
                    is_integer=True,
                ),
            )
        yield from self._draw_random_setting_histograms()

    def draw_example_maps(self) -> Iterator[FigureWithCaption]:
        """Draw the stored maps of a few random items."""
        if "power" not in self.data[""] or not len(self.made):
            return
        n = min(_MAX_MAPS, len(self.made))
        item_choice = np.sort(np.random.default_rng(0).choice(len(self.made), n, replace=False))
        plan = Plan.from_study(self.study)
        for point, trial in self.made[item_choice].tolist():
            settings = ", ".join(
                f"{setting_label(path)} {value_label(text)}"
                for path, text in plan.setting_labels_of_point(point)
            )
            yield FigureWithCaption(
                title=f"Point {point}, trial {trial}.",
                caption=(f"{settings}. " if settings else "")
                + "First frame. A truth mark without a peak is a target below the noise.",
                figure=_draw_map(self._build_map_with_truth_and_detections(plan, point, trial)),
            )

    def _build_map_with_truth_and_detections(
        self, plan: Plan, point: int, trial: int
    ) -> range_doppler.MarkedMap:
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
        item_truth = truth.isel(point=point, trial=trial, frame=0)
        detections = None
        radar = plan.scenario_of_point(point, plan.drawn_setting_texts_of_trial(trial)).radar
        if "detections" in self.data and radar is not None:
            rows = self.data["detections"]
            item_rows = slice(int(rows.start[point, trial]), int(rows.stop[point, trial]))
            first = rows.frame.values[item_rows] == 0
            estimates = RangeVelocity(
                *(rows[name].values[item_rows][first] for name in ("range", "velocity"))
            )
            detections = range_doppler_map_position(estimates, radar.for_frame(0))
        return range_doppler.MarkedMap(
            power=power,
            units="W**0.5",
            detections=detections,
            truth=RangeVelocity(item_truth.map_range.values, item_truth.map_velocity.values),
        )

    def _true_values_by_class(self, variable: str) -> dict[str, np.ndarray]:
        """Return the true values of all targets of each class, (n,) each."""
        values = (
            self.data["truth"][variable]
            .isel(self.item_index)
            .transpose("item", "frame", "target")
            .values
        )
        return {
            kind: values[..., target_indices].ravel()
            for kind, target_indices in self.targets_by_class.items()
        }

    def _draw_random_setting_histograms(self) -> Iterator[FigureWithCaption]:
        """Draw the distribution of each random setting over the items."""
        random_settings = [axis for axis in self.study.vary if not isinstance(axis, SweptSetting)]
        for axis in random_settings[:_MAX_RANDOM_SETTINGS]:
            values = self.data["settings"][axis.path.replace("/", "-")]
            dimension = str(values.dims[0])
            indices = np.unique(self.item_index[dimension].values)
            label = setting_label(axis.path)
            yield FigureWithCaption(
                title=f"{label[:1].upper()}{label[1:]}.",
                caption=f"Random for each {dimension}. The specified distribution should be covered"
                " without gaps.",
                figure=_draw_histogram(
                    {"": values.values[indices].astype(float)},
                    label=axis_label(label, axis.unit),
                    counted_things=f"{dimension}s",
                ),
            )


def _draw_histogram(
    values_by_class: Mapping[str, np.ndarray],
    *,
    label: str,
    counted_things: str,
    is_integer: bool = False,
) -> Markup:
    return render_svg(
        lambda figure: figures.draw_histogram(
            figure.subplots(),
            values_by_class,
            label=label,
            counted_things=counted_things,
            is_integer=is_integer,
        )
    )


def _draw_map(marked: range_doppler.MarkedMap) -> Markup:
    return render_svg(
        lambda figure: range_doppler.draw_map(figure.subplots(), marked), height_in=TALL_IN
    )
