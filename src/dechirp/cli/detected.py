"""The detections of a run as the terminal shows them, beside the truth where there is one."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from rich.table import Table

from dechirp.cli.show import table
from dechirp.experiment.run import Result
from dechirp.report import compare
from dechirp.report.words import NONE, decimals_of, fixed, ratio_db


def detected(result: Result, *, at_most: int) -> Table:
    """The strongest detections, so many at most."""
    order = np.argsort(-result.detections.snr.values, kind="stable")
    strongest = result.detections.isel(detection=order)
    n_all = order.size
    found, shown = f"{n_all} detection{'' if n_all == 1 else 's'}", min(n_all, at_most)
    if shown < n_all:
        found += f", the {shown} strongest (all of them: detections.csv)"
    first = [] if result.n_frames == 1 else ["frame"]
    truth = result.truth
    if truth is None:
        made = table(found, right=[*first, "range, m", "velocity, m/s", "SNR, dB"])
    else:
        columns = ["range, m", "true", "velocity, m/s", "true", "SNR, dB", "target"]
        made = table(found, right=[*first, *columns])
        target = _targets(result, strongest)
    for index in range(shown):
        one = strongest.isel(detection=index)
        row = [] if result.n_frames == 1 else [str(int(one.frame))]
        true = None
        if truth is not None and target[index] >= 0:
            true = truth.isel(target=target[index]).sel(frame=int(one.frame))
        for name in ("range", "velocity"):
            decimals = decimals_of(float(one[f"{name}_std"]))
            std = fixed(float(one[f"{name}_std"]), decimals)
            row.append(f"{fixed(float(one[name]), decimals)} ± {std}")
            if truth is not None:
                row.append(NONE if true is None else fixed(float(true[name]), decimals))
        row.append(fixed(ratio_db(float(one.snr)), 1))
        if truth is not None:
            row.append(NONE if true is None else str(true.target.values))
        made.add_row(*row)
    return made


def missed(result: Result) -> Iterator[str]:
    """A line for each target that no frame has a detection of."""
    truth = result.truth
    if truth is None:
        return
    hits = set(_targets(result, result.detections).tolist())
    for index, name in enumerate(truth.target.values.tolist()):
        if index not in hits:
            first = truth.isel(target=index, frame=0)
            place = f"{fixed(float(first.range), 1)} m, {fixed(float(first.velocity), 1)} m/s"
            yield f"Not detected: {name}, at {place} in the first frame."


def _targets(result: Result, detections: xr.Dataset) -> np.ndarray:
    assert result.truth is not None
    scene = result.scenario.scene
    return compare.match(detections, result.truth, result.radar, scene).target
