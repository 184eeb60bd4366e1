"""Datasheet page of a data set: contents, origin, file layout and limits of the model."""

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from dechirp.core.text import format_number
from dechirp.core.values import frozen_dataclass
from dechirp.experiments.study.data_set import format_bytes, uncompressed_data_set_bytes
from dechirp.experiments.study.plan import Plan
from dechirp.experiments.study.study import Study
from dechirp.report.check_values import format_count
from dechirp.report.data_set_figures import DataSetFigures
from dechirp.report.labels import setting_label, value_label
from dechirp.report.study.settings import format_varied_settings
from dechirp.report.template import load_template

_MAX_VALUES = 12

_DESCRIPTIONS = {
    "cube": "ADC samples as integers; multiplied by cube_scale of the item in single precision, in"
    " sqrt(W)",
    "cube_scale": "one value per item: the ADC step if the scenario has one, otherwise the largest"
    " real or imaginary part over 32767",
    "power": "range-Doppler map, mean over channels; times 0.01 it is 10 log10 of the power in W"
    " (applied by xarray)",
    "made": "1 if the item exists; failed and unneeded trials are 0",
    "scenario": "scenario of each point as YAML, including its radar",
}
"""Descriptions of arrays of the root group without a long name of their own."""


@frozen_dataclass
class ArrayRow:
    """Row of the table of arrays."""

    name: str
    axes: str
    kind: str
    units: str
    description: str


def render_data_set_page(study: Study, data: Mapping[str, xr.Dataset], *, n_bytes: int) -> str:
    """Return the HTML of the datasheet; equal data sets give equal pages.

    Parameters
    ----------
    study : Study
        Study that generated the data set.
    data : mapping
        Data set, the result of `results.data_set.open_data_set_groups`.
    n_bytes : int
        Size of its files.

    Returns
    -------
    str
        Self-contained HTML page.
    """
    item_indices = np.argwhere(data[""].made.values)
    figures = DataSetFigures(study, data, item_indices)
    return load_template("data_set.html").render(
        study=study,
        headline=_format_headline(study, len(item_indices)),
        lead=_describe_origin(study),
        cards=list(_build_item_and_size_cards(study, data, item_indices, n_bytes)),
        groups=[(name, list(_array_table_rows(group, name))) for name, group in data.items()],
        varied=format_varied_settings(study),
        n_items=list(_item_counts_per_swept_value(study, item_indices)),
        figures=list(figures.draw_distributions()),
        about_sample=figures.sample_note,
        maps=list(figures.draw_example_maps()),
        simulated=list(_describe_simulation_limits(study)),
        targets=_target_names_and_classes(data),
        yaml=data[""].attrs["study"],
        version=data[""].attrs["dechirp"],
    )


def _format_headline(study: Study, n_items: int) -> str:
    contents = " and ".join([", ".join(study.keep[:-1]), study.keep[-1]]) if study.keep[1:] else ""
    return f"{format_count(n_items)} items: {contents or study.keep[0]}, with truth"


def _describe_origin(study: Study) -> str:
    method = (
        "Detections sampled from theory"
        if study.sensor == "statistical"
        else "Samples simulated and processed"
    )
    return f"{study.scenario.name}. {method}; no measured data. Seed {study.seed}."


def _build_item_and_size_cards(
    study: Study, data: Mapping[str, xr.Dataset], item_indices: np.ndarray, n_bytes: int
) -> Iterator[Mapping[str, str]]:
    sizes = data["truth"].sizes
    n_planned = data[""].made.size
    size, _, unit = format_bytes(n_bytes).partition(" ")
    yield {
        "name": "items",
        "number": format_count(len(item_indices)),
        "unit": "",
        "small_print": "complete"
        if len(item_indices) == n_planned
        else f"of {format_count(n_planned)} planned; see the array made",
    }
    yield {
        "name": "frames per item",
        "number": format_count(sizes["frame"]),
        "unit": "frame" if sizes["frame"] == 1 else "frames",
        "small_print": f"of {sizes['target']} targets" if sizes["target"] != 1 else "of one target",
    }
    if "detections" in data:
        n_detections = data["detections"].sizes["detection"]
        yield {
            "name": "detections",
            "number": format_count(data["detections"].sizes["detection"]),
            "unit": "",
            "small_print": f"{format_number(n_detections / max(len(item_indices), 1), 3)} per item",
        }
    raw = uncompressed_data_set_bytes(Plan.from_study(study))
    yield {
        "name": "on disk",
        "number": size,
        "unit": unit,
        "small_print": f"samples and maps of {format_bytes(raw)}, packed" if raw else "",
    }


def _array_table_rows(data: xr.Dataset, group: str) -> Iterator[ArrayRow]:
    order = {name: position for position, name in enumerate(_DESCRIPTIONS)}
    names = sorted(map(str, data.variables), key=lambda name: (order.get(name, len(order)), name))
    for name in names:
        array = data[name]
        stored_dtype = array.encoding.get("dtype", array.dtype)
        description = str(array.attrs.get("long_name", ""))
        if not group:
            description = _DESCRIPTIONS.get(name, description)
        elif group == "settings":
            description = setting_label(str(array.attrs["path"]))
        elif name == "class":
            description = "kind of the target's body; point for targets without a body"
        elif name == "target" and group == "truth":
            description = "name of the target"
        units = str(array.attrs.get("units", ""))
        yield ArrayRow(
            name=name,
            axes=", ".join(
                f"{dim}\N{NO-BREAK SPACE}{format_count(n)}" for dim, n in array.sizes.items()
            ),
            kind="text" if np.dtype(stored_dtype).kind in "OT" else str(stored_dtype),
            units="" if units == "1" else units,
            description=description,
        )


def _item_counts_per_swept_value(
    study: Study, item_indices: np.ndarray
) -> Iterator[tuple[str, list[tuple[str, str, float]], int]]:
    """Yield each swept setting with its values, their item counts and percentages, and the rest."""
    plan = Plan.from_study(study)
    items_per_point = np.bincount(item_indices[:, 0], minlength=plan.n_points)
    for axis_index, axis in enumerate(plan.swept_settings):
        if len(axis.texts) < 2:
            continue
        items_on_grid = items_per_point.reshape(plan.grid_shape)
        others = tuple(
            other_index for other_index in range(items_on_grid.ndim) if other_index != axis_index
        )
        counts = items_on_grid.sum(axis=others)
        largest_count = max(int(counts.max()), 1)
        rows = [
            (value_label(label), format_count(int(n)), 100 * n / largest_count)
            for label, n in zip(axis.labels, counts, strict=True)
        ]
        yield setting_label(axis.path), rows[:_MAX_VALUES], max(len(rows) - _MAX_VALUES, 0)


def _target_names_and_classes(data: Mapping[str, xr.Dataset]) -> list[tuple[str, str]]:
    truth = data["truth"]
    return list(zip(truth.target.values.tolist(), truth["class"].values.tolist(), strict=True))


def _describe_simulation_limits(study: Study) -> Iterator[str]:
    """Yield sentences on what the simulation includes and what it does not."""
    scenario = study.scenario
    impairments = ", ".join(
        impairment.kind().replace("-", " ") for impairment in scenario.impairments
    )
    impairments_vary = any(axis.path.startswith("impairments") for axis in study.vary)
    yield (
        f"Impairments: {impairments or 'none, not even noise'}"
        f"{'; they vary, see above' if impairments_vary else ''}. No other impairments are"
        " simulated."
    )
    yield (
        "Targets are points, or bodies of scatterers with mean cross sections. The space between"
        " them is empty except for walls and clutter of the scenario. Multiple reflections between"
        " targets are not simulated."
    )
    yield (
        "The position of a body is the origin of its axes; its peaks lie at its scatterers, up to"
        " metres away."
    )
    yield (
        "RCS and SNR of the truth are mean values; for fluctuating targets those of the item are"
        " not"
        " stored."
    )
    if study.sensor == "statistical":
        yield (
            "Detections are sampled from theory instead of processed samples: no phase noise, no"
            " interference, no images."
        )
    yield (
        "A detection belongs to the nearest target within two cells on every axis. A sidelobe of a"
        " strong target belongs to that target or to none."
    )
    yield (
        "Trial t has the same noise at every point. Split the data by trial, not by point;"
        " otherwise"
        " training and test data share noise."
    )
    yield (
        "No data were measured. Test a network that was trained on them with recordings; dechirp"
        " twin"
        " and dechirp inspect compare a scenario with a recording."
    )
