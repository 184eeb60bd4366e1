"""Missing home or cache folder: slower runs with the same results."""

import pandas as pd
import pytest

from faults.conftest import run_shell
from nightly import nightly


@nightly
@pytest.mark.parametrize(
    "environment",
    [
        {"HOME": None},
        {"HOME": "/proc/none", "XDG_CACHE_HOME": "/proc/none", "XDG_CONFIG_HOME": "/proc/none"},
        {"NUMBA_CACHE_DIR": "/proc/none"},
    ],
    ids=["no HOME", "HOME not there", "no cache of compiled loops"],
)
def test_results_do_not_depend_on_home_or_cache(environment, folder, call, monkeypatch):
    # Plain twins for the small run, as in the other process.
    monkeypatch.setattr("dechirp.core.compiled_kernels.MAX_PLAIN_SAMPLES", 2**21)
    assert call("run", "small.yaml", "--out", "usual", "--quiet")[0] == 0
    process = run_shell('"$@"', "run", "small.yaml", "--out", "out", "--quiet", **environment)

    assert process.returncode == 0
    assert "Traceback" not in process.stderr
    usual, out = folder / "usual", folder / "out"
    assert (out / "scenario.yaml").read_bytes() == (usual / "scenario.yaml").read_bytes()
    # Kernels may fuse multiply and add, and a kernel that is compiled in the process fuses other
    # ones than its cached form: estimates differ by a few units of 2.2e-16.
    pd.testing.assert_frame_equal(
        pd.read_csv(out / "detections.csv"),
        pd.read_csv(usual / "detections.csv"),
        check_exact=False,
        rtol=1e-14,
        atol=0,
    )


def test_design_needs_no_home_or_cache(folder):
    arguments = ("design", "--max-range", "200m", "--range-resolution", "1m", "--max-velocity")
    process = run_shell(
        '"$@"', *arguments, "60 m/s", "--json", HOME=None, NUMBA_CACHE_DIR="/proc/none"
    )

    assert (process.returncode, process.stderr) == (0, "")
