"""Benchmark jobs: results and accuracy of dechirp and of plain reference code."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from sides import accuracy, ours, plain, plain_echoes, plain_maps
from sides.job_types import Inputs
from sides.jobs import jobs, tiny_jobs
from sides.side_processes import Absent, python_side

COMPILED_LOOPS = {
    plain_maps: ("box_sums", "plain_cell_averaging", "plain_ordered_statistic"),
    plain_echoes: ("add_phasors",),
}

# Plain echoes of cube A have constant radial velocity: the range of crossing targets changes by
# v^2 t^2 / 2 r, a tenth of a radian at 40 m/s and 3 m. Direction errors come from 20 detections:
# RMSE over bound at most 1.3, with a spread of 0.2.
MAX_ERRORS = {"error": 5e-3, "deviation": 1e-5, "error_over_bound": 2.0}


@pytest.fixture
def uncompiled_loops(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace compiled loops by plain Python; compilation takes longer than these small jobs."""
    for module, names in COMPILED_LOOPS.items():
        for name in names:
            monkeypatch.setattr(module, name, getattr(module, name).py_func)


def compute_result(side: object, kind: str, inputs: Inputs) -> np.ndarray:
    return np.asarray(getattr(side, kind)(inputs)())


@pytest.mark.usefixtures("uncompiled_loops")
@pytest.mark.parametrize("job", tiny_jobs(), ids=lambda job: job.name)
def test_dechirp_and_plain_code_give_same_accurate_result(job) -> None:
    inputs = job.make_accuracy_inputs() if job.make_accuracy_inputs else job.make()
    results = [compute_result(side, job.kind, inputs) for side in (ours, plain)]
    for result in results:
        accuracies = accuracy.ACCURACY_BY_KIND[job.kind](inputs, result)
        assert all(
            accuracies[name] <= limit for name, limit in MAX_ERRORS.items() if name in accuracies
        ), accuracies
        assert accuracies.get("targets_found", 3) == 3
        assert accuracies.get("agreement", 1) == pytest.approx(1)
    if job.kind in ("cell_averaging", "ordered_statistic"):
        rows, columns = inputs["n_training"] + inputs["n_guard"]
        dechirp_middle, plain_middle = (
            result[:, rows:-rows, columns:-columns].astype(int) for result in results
        )
        # Sums have another order: one cell in a thousand may cross its threshold.
        assert abs(dechirp_middle - plain_middle).mean() <= 1e-3
        assert accuracies["alarms_middle"] == pytest.approx(
            1, abs=5 * accuracies["alarms_middle_std"]
        )


def test_every_kind_of_job_has_dechirp_code_and_accuracy() -> None:
    kinds = {job.kind for job in jobs()}
    assert kinds == set(accuracy.ACCURACY_BY_KIND)
    assert all(hasattr(ours, kind) for kind in kinds)


def test_unavailable_side_gives_reason() -> None:
    # The module of this side defines no job of that name.
    side = python_side(
        "radarsimpy", "sides.peers.radarsimpy", sys.executable, threads=1, patience_s=60.0
    )
    with pytest.raises(Absent, match="has no attribute 'decode'"):
        side.ask("load", "decode", "unread.npz")
    side.end()
