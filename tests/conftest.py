"""Fixtures of many tests: a small radar, and the reference scenario."""

import gc
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from functools import lru_cache
from types import SimpleNamespace

# Python's 700 would collect the garbage of a worker a thousand times before its first test: 3 s.
gc.set_threshold(20_000)

# Two workers on two cores: more threads would compete for them.
for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(pool, "1")

# Factors that one worker calibrates serve the others; none is left from earlier runs.
_OWN_CACHE = None if "PYTEST_XDIST_WORKER" in os.environ else tempfile.mkdtemp(prefix="dechirp-")
if _OWN_CACHE is not None:
    os.environ["DECHIRP_CACHE_DIR"] = _OWN_CACHE

# A check of URIs that jsonschema offers; no schema of the tests needs it, and its grammar takes 6 s
# to compile in each worker.
sys.modules["rfc3987_syntax"] = None  # type: ignore[assignment]

import pytest
import xarray as xr
from hypothesis import settings
from markupsafe import Markup
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import Event

import dechirp as dc
from dechirp.cli import compilation_notice
from dechirp.config import yaml_tree
from dechirp.core import compiled_kernels
from nightly import NIGHTLY, RUN_HINT, nightly
from radars import street_radar

# The same examples in every run; slow machines are not failures.
settings.register_profile(
    "fixed", derandomize=True, deadline=None, max_examples=100 if NIGHTLY else 15
)
settings.load_profile("fixed")

# Small runs check the compiled kernels, too; test_plain_twins.py compares the twins with them.
compiled_kernels.MAX_PLAIN_SAMPLES = 0
# The first run after an installation compiles, and its commands print no more than the others.
compilation_notice.MIN_NOTED_S = float("inf")


@lru_cache(4096)
def list_yaml_events(text: str) -> tuple[Event, ...]:
    return tuple(YAML(typ="safe", pure=True).parse(text))


def parse_yaml_events(text: str) -> Iterator[Event]:
    """Return the events of a text, which the trees of all tests read and never change."""
    if len(text) < 10_000:
        try:
            return iter(list_yaml_events(text))
        except (YAMLError, ValueError, OverflowError):
            pass  # raised again below, where the reader of the events comes to the mistake
    return YAML(typ="safe", pure=True).parse(text)


# Two of three texts are those of earlier tests, and the pure parser takes 0.1 ms a line.
yaml_tree.YAML = lambda **_: SimpleNamespace(parse=parse_yaml_events)  # type: ignore[assignment]


N_LONG_TESTS = pytest.StashKey[int]()


@pytest.hookimpl(trylast=True)  # counts no tests that -k or -m leave out
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Deselect long tests: the skips of 2,500 tests would take 4 s.

    They are skipped instead if the command line names a test, or if no other test remains.
    """
    if NIGHTLY:
        return
    long_tests = [item for item in items if nightly.mark in item.iter_markers("skipif")]
    config.stash[N_LONG_TESTS] = len(long_tests)
    if len(long_tests) == len(items) or any("::" in argument for argument in config.args):
        return
    deselected = set(long_tests)
    items[:] = [item for item in items if item not in deselected]
    config.hook.pytest_deselected(items=long_tests)


def pytest_collection_finish() -> None:
    gc.freeze()  # later collections do not traverse ten thousand tests


def pytest_sessionfinish(session: pytest.Session) -> None:
    if hasattr(session.config, "workeroutput"):
        session.config.workeroutput["n_long_tests"] = session.config.stash.get(N_LONG_TESTS, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node) -> None:
    """Take the number of long tests from any worker that did not crash: each collects all tests."""
    n_long_tests = getattr(node, "workeroutput", {}).get("n_long_tests", 0)
    node.config.stash[N_LONG_TESTS] = max(n_long_tests, node.config.stash.get(N_LONG_TESTS, 0))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    if n_long_tests := config.stash.get(N_LONG_TESTS, 0):
        tests = "long test" if n_long_tests == 1 else "long tests"
        terminalreporter.write_line(f"{n_long_tests} {tests} left out: {RUN_HINT}")


def pytest_unconfigure() -> None:
    if _OWN_CACHE is not None:
        shutil.rmtree(_OWN_CACHE, ignore_errors=True)


@pytest.fixture(scope="session")
def radar() -> dc.Radar:
    """77 GHz, 0.29 m and 0.43 m/s a bin, 75 m and 27 m/s unambiguous, two receivers."""
    return street_radar(n_samples=256, n_chirps=128)


@pytest.fixture(scope="session")
def reference() -> dc.Scenario:
    """77 GHz, 150 MHz, 2200 x 128 samples, one car at 50 m receding at 10 m/s."""
    return dc.reference()


@pytest.fixture(scope="session")
def clean(reference) -> xr.DataArray:
    """The reference echo without noise."""
    return dc.simulate(reference.scene, reference.radar, impairments=())


@pytest.fixture
def without_figures(monkeypatch) -> None:
    """Leave the figures out of reports of runs: they take four fifths of a small run."""
    for module in ("page", "directions_section", "objects_section"):
        monkeypatch.setattr(f"dechirp.report.{module}.render_svg", lambda *_, **__: Markup(""))
