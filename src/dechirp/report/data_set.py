"""The datasheet of a data set: what is in it, how it was made, how to read it, what it is not."""

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr

from dechirp.core.values import value
from dechirp.core.words import number
from dechirp.experiment.study.data_set import data_bytes, in_gigabytes
from dechirp.experiment.study.plan import Plan
from dechirp.experiment.study.study import Study
from dechirp.report.amounts import counted
from dechirp.report.data_set_plates import Shown
from dechirp.report.settings_words import setting_words, value_words
from dechirp.report.study_settings import varied
from dechirp.report.template import template

_MOST_VALUES = 12

_WORDS = {
    "cube": "samples of the converter, whole numbers; times cube_scale of the item, in single"
    " precision, sqrt(W)",
    "cube_scale": "one number an item: the step of the converter where the scenario has one, else"
    " the largest part of any sample over 32767",
    "power": "range-Doppler map, mean over channels; times 0.01 it is 10 log10 of watts (xarray"
    " does that)",
    "made": "whether there is such an item: trials that failed or were not needed are zeros",
    "scenario": "scenario of each point as YAML, its radar in it",
}
"""Of what stands at the top, where its own attribute does not say it."""


@value
class Row:
    """One array, as the columns of a table."""

    name: str
    axes: str
    kind: str
    units: str
    words: str


def render(study: Study, data: Mapping[str, xr.Dataset], *, n_bytes: int) -> str:
    """Return the HTML of the page; one data set always gives one page.

    Parameters
    ----------
    study : Study
        What it was made by.
    data : mapping
        The data set, as `store.data_set.read_data_set` gives it.
    n_bytes : int
        What its files take.

    Returns
    -------
    str
        A page that asks for no other file.
    """
    made = np.argwhere(data[""].made.values)
    shown = Shown(study, data, made)
    return template("data_set.html").render(
        study=study,
        headline=_headline(study, len(made)),
        lead=_lead(study),
        cards=list(_cards(study, data, made, n_bytes)),
        groups=[(name, list(_rows(of, name))) for name, of in data.items()],
        varied=varied(study),
        n_items=list(_n_items(study, made)),
        plates=list(shown.plates()),
        about_sample=shown.about,
        maps=list(shown.maps()),
        simulated=list(_simulated(study)),
        targets=_targets(data),
        yaml=data[""].attrs["study"],
        version=data[""].attrs["dechirp"],
    )


def _headline(study: Study, n: int) -> str:
    what = " and ".join([", ".join(study.keep[:-1]), study.keep[-1]]) if study.keep[1:] else ""
    return f"{counted(n)} items: {what or study.keep[0]}, with truth"


def _lead(study: Study) -> str:
    how = (
        "Detections drawn from theory"
        if study.sensor == "statistical"
        else "Samples simulated and processed"
    )
    return f"{study.scenario.name}. {how}; nothing in it was measured. Seed {study.seed}."


def _cards(
    study: Study, data: Mapping[str, xr.Dataset], made: np.ndarray, n_bytes: int
) -> Iterator[Mapping[str, str]]:
    sizes = data["truth"].sizes
    n_planned = data[""].made.size
    size, _, unit = in_gigabytes(n_bytes).partition(" ")
    yield {
        "name": "items",
        "number": counted(len(made)),
        "unit": "",
        "small_print": "all that were planned"
        if len(made) == n_planned
        else f"of {counted(n_planned)} planned; made says which",
    }
    yield {
        "name": "an item",
        "number": counted(sizes["frame"]),
        "unit": "frame" if sizes["frame"] == 1 else "frames",
        "small_print": f"of {sizes['target']} targets" if sizes["target"] != 1 else "of one target",
    }
    if "detections" in data:
        yield {
            "name": "detections",
            "number": counted(data["detections"].sizes["detection"]),
            "unit": "",
            "small_print": f"{number(data['detections'].sizes['detection'] / max(len(made), 1), 3)}"
            " an item",
        }
    raw = data_bytes(Plan.of(study))
    yield {
        "name": "on disk",
        "number": size,
        "unit": unit,
        "small_print": f"samples and maps of {in_gigabytes(raw)}, packed" if raw else "",
    }


def _rows(data: xr.Dataset, group: str) -> Iterator[Row]:
    order = {name: at for at, name in enumerate(_WORDS)}
    names = sorted(map(str, data.variables), key=lambda one: (order.get(one, len(order)), one))
    for name in names:
        of = data[name]
        kept = of.encoding.get("dtype", of.dtype)
        words = str(of.attrs.get("long_name", ""))
        if not group:
            words = _WORDS.get(name, words)
        elif group == "settings":
            words = setting_words(str(of.attrs["path"]))
        elif name == "class":
            words = "kind of the body of the target; point where it has none"
        elif name == "target" and group == "truth":
            words = "name of the target"
        units = str(of.attrs.get("units", ""))
        yield Row(
            name=name,
            axes=", ".join(f"{dim}\N{NO-BREAK SPACE}{counted(n)}" for dim, n in of.sizes.items()),
            kind="text" if np.dtype(kept).kind in "OT" else str(kept),
            units="" if units == "1" else units,
            words=words,
        )


def _n_items(
    study: Study, made: np.ndarray
) -> Iterator[tuple[str, list[tuple[str, str, float]], int]]:
    """Of each listed setting its values, their items, percent of the most, and how many more."""
    plan = Plan.of(study)
    of_point = np.bincount(made[:, 0], minlength=plan.n_points)
    for along, axis in enumerate(plan.axes):
        if len(axis.texts) < 2:
            continue
        of_value = of_point.reshape(plan.shape)
        others = tuple(one for one in range(of_value.ndim) if one != along)
        counts = of_value.sum(axis=others)
        most = max(int(counts.max()), 1)
        rows = [
            (value_words(label), counted(int(n)), 100 * n / most)
            for label, n in zip(axis.labels, counts, strict=True)
        ]
        yield setting_words(axis.path), rows[:_MOST_VALUES], max(len(rows) - _MOST_VALUES, 0)


def _targets(data: Mapping[str, xr.Dataset]) -> list[tuple[str, str]]:
    truth = data["truth"]
    return list(zip(truth.target.values.tolist(), truth["class"].values.tolist(), strict=True))


def _simulated(study: Study) -> Iterator[str]:
    """What is in it of a real radar, and what is not."""
    scenario = study.scenario
    impairments = ", ".join(one.kind().replace("-", " ") for one in scenario.impairments)
    changed = any(axis.path.startswith("impairments") for axis in study.vary)
    yield (
        f"Impairments: {impairments or 'none, not even noise'}"
        f"{'; they vary, see above' if changed else ''}. What is not named is not in it."
    )
    yield (
        "Targets are points, or bodies of scatterers with mean cross sections; what is between"
        " them is empty unless a target, a wall or clutter is named. Echoes do not bounce between"
        " targets."
    )
    yield (
        "The place of a body is that of the origin of its axes; its peaks lie where its parts"
        " reflect, meters from there."
    )
    yield (
        "The cross section and the ratio of the truth are means: where a target fluctuates, those"
        " of the item are not told."
    )
    if study.sensor == "statistical":
        yield (
            "Detections are drawn from theory, not processed from samples: no phase noise, no"
            " interference, no images."
        )
    yield (
        "A detection is of the target within two cells of it on every axis, the nearest one. The"
        " sidelobe of a strong target is of that target or of none."
    )
    yield (
        "Trial t of every point has the same noise: split by trial, not by point, or the same"
        " noise is in both parts."
    )
    yield (
        "Nothing here was measured. What a network learns of it is to be tested on recordings;"
        " dechirp twin and dechirp inspect say how far a scenario is from one."
    )
