"""What is timed side by side: our code and plain code do the same job, and are judged alike."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))

from sides import accuracy, ours, plain, plain_echoes, plain_maps
from sides.jobs import jobs, tiny_jobs
from sides.kinds import Inputs
from sides.turns import Absent, python_side

COMPILED = {
    plain_maps: ("box_sums", "plain_cell_averaging", "plain_ordered_statistic"),
    plain_echoes: ("turn",),
}

# Plain echoes of cube A go straight: targets across the beam bend by v^2 t^2 / 2 r, a tenth of a
# radian at 40 m/s and 3 m. Directions are of 20 detections: root mean square 1.3 at most, and 0.2.
AT_MOST = {"error": 5e-3, "deviation": 1e-5, "error_over_bound": 2.0}


@pytest.fixture
def not_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain loops as Python runs them: compiling them takes longer than jobs as small as these."""
    for module, names in COMPILED.items():
        for name in names:
            monkeypatch.setattr(module, name, getattr(module, name).py_func)


def result(side: object, kind: str, inputs: Inputs) -> np.ndarray:
    return np.asarray(getattr(side, kind)(inputs)())


@pytest.mark.usefixtures("not_compiled")
@pytest.mark.parametrize("job", tiny_jobs(), ids=lambda job: job.name)
def test_ours_and_plain_do_the_same_job_and_do_it_right(job) -> None:
    inputs = job.judged_by() if job.judged_by else job.make()
    found = [result(side, job.kind, inputs) for side in (ours, plain)]
    for one in found:
        told = accuracy.OF_KIND[job.kind](inputs, one)
        assert all(told[name] <= most for name, most in AT_MOST.items() if name in told), told
        assert told.get("targets_found", 3) == 3
        assert told.get("agreement", 1) == pytest.approx(1)
    if job.kind in ("cell_averaging", "ordered_statistic"):
        rows, columns = inputs["n_training"] + inputs["n_guard"]
        ours_inside, plain_inside = (
            one[:, rows:-rows, columns:-columns].astype(int) for one in found
        )
        # Sums in another order: a cell in a thousand may be on the other side of its threshold.
        assert abs(ours_inside - plain_inside).mean() <= 1e-3
        assert told["alarms_middle"] == pytest.approx(1, abs=5 * told["alarms_middle_std"])


def test_every_kind_of_job_is_done_by_us_and_judged() -> None:
    kinds = {job.kind for job in jobs()}
    assert kinds == set(accuracy.OF_KIND)
    assert all(hasattr(ours, kind) for kind in kinds)


def test_a_side_that_cannot_says_why() -> None:
    # Its file has no job.
    side = python_side(
        "radarsimpy", "sides.peers.radarsimpy", sys.executable, threads=1, patience_s=60.0
    )
    with pytest.raises(Absent, match="has no attribute 'decode'"):
        side.ask("load", "decode", "unread.npz")
    side.end()
