"""No home, and no folder for what is kept from run to run: slower, and the same results."""

import pytest

from faults.conftest import shell
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
def test_results_are_the_same(environment, folder, call):
    assert call("run", "small.yaml", "--out", "usual", "--quiet")[0] == 0
    ended = shell('"$@"', "run", "small.yaml", "--out", "out", "--quiet", **environment)

    assert ended.returncode == 0
    assert "Traceback" not in ended.stderr
    for name in ("detections.csv", "scenario.yaml"):
        assert (folder / "out" / name).read_bytes() == (folder / "usual" / name).read_bytes()


def test_a_design_needs_none(folder):
    asked = ("design", "--max-range", "200m", "--range-resolution", "1m", "--max-velocity")
    ended = shell('"$@"', *asked, "60 m/s", "--json", HOME=None, NUMBA_CACHE_DIR="/proc/none")

    assert (ended.returncode, ended.stderr) == (0, "")
