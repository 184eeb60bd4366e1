"""Plain twins of compiled kernels: equal results, and whole runs without Numba."""

import copy
import csv
import json
import os
import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.core import compiled_kernels
from dechirp.core.compiled_kernels import Kernel, kernel, plain_twins_for_small_work
from dechirp.core.threads import limit_threads
from dechirp.experiments.link_budget import link_budget_of_first_target
from dechirp.experiments.run import run
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.spectrum import Transform, range_doppler_spectrum
from nightly import nightly

EXAMPLES = Path(__file__).parents[2] / "examples"
# Single precision: sums of some thousand products, each rounded to 6e-8.
TOLERANCE = 3e-6

TABLE_SCRIPT = """
import sys
hidden = sys.argv[1].split()

class Hide:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in hidden:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hide())
sys.modules |= {name: None for name in hidden}

compiled = []
if not hidden:
    from dechirp.core import compiled_kernels
    class Listener:
        start_compilation = staticmethod(lambda: compiled.append(1))
        end_compilation = staticmethod(lambda: None)
    compiled_kernels.compilation_listeners.append(Listener)

from dechirp.cli.main import main
try:
    main(["run", "--quiet"])
finally:
    print(len(compiled), "numba" in sys.modules and sys.modules["numba"] is not None)
"""

IMPORTS_SCRIPT = """
import sys
from dechirp.cli.main import main
try:
    main(["run", "--quiet"])
finally:
    print(*{"numba", "dask", "scipy.fft", "scipy.special"} & set(sys.modules))
"""


# Detections with each noise estimator and each direction estimator.
MEMBERS_SCRIPT = """
import json, sys, warnings
from dataclasses import replace
import dechirp as dc
from dechirp.core.compiled_kernels import use_compiled_kernels
from dechirp.processing.angle.base import DirectionEstimator
from dechirp.processing.cfar.base import NoiseEstimator

warnings.simplefilter("ignore")
use_compiled_kernels()  # wherever Numba can compile
scenario = dc.load(sys.argv[1], ["n_frames=1", "radar.frame.n_chirps=32"])
chain, cfar = scenario.chain, scenario.chain.cfar
chains = {
    kind: replace(chain, cfar=replace(cfar, estimator=member()))
    for kind, member in NoiseEstimator.members().items()
}
chains |= {
    kind: replace(chain, angle=member()) for kind, member in DirectionEstimator.members().items()
}
cube = dc.simulate(scenario.scene, scenario.radar, seed=1)
results = {}
for kind, chain in chains.items():
    detections = dc.detect(cube, scenario.radar, chain).fillna(0)
    names = ("range", "velocity", "azimuth")
    results[kind] = [
        [detections[name].values.tolist(), detections[f"{name}_std"].values.tolist()]
        for name in names
    ]
print(json.dumps(results))
"""


def relative_difference(first, second):
    """Return the largest difference over the largest size; infinite for other special values."""
    if isinstance(first, tuple):
        return max(map(relative_difference, first, second), default=0.0)
    if first is None:
        return 0.0 if second is None else np.inf
    first, second = np.asarray(first), np.asarray(second)
    if first.shape != second.shape:
        return np.inf
    if first.dtype.kind not in "fc":
        return float(np.any(first != second))
    is_finite = np.isfinite(first)
    if not np.array_equal(first[~is_finite], second[~is_finite], equal_nan=True):
        return np.inf
    first, second = first[is_finite], second[is_finite]
    largest = np.max(abs(first), initial=0.0)
    return float(np.max(abs(first - second), initial=0.0) / largest) if largest else 0.0


@pytest.fixture
def differences(monkeypatch):
    """Call each kernel twice, compiled and plain; collect the differences by its name."""
    collected = defaultdict(float)
    call = Kernel.__call__

    def call_both(self, *arguments):
        if self.plain is None:
            return self.dispatcher(*arguments)
        plain_arguments = copy.deepcopy(arguments)
        result = self.dispatcher(*arguments)
        with monkeypatch.context() as inner, plain_twins_for_small_work(0):
            inner.setattr(Kernel, "__call__", call)
            plain_result = self(*plain_arguments)
        # The last two arguments of the direct kernel are buffers, which the twin does not need.
        n_compared = 19 if self.__name__ == "_add_echoes_chirp_by_chirp" else len(arguments)
        name = f"{self.__module__.rpartition('.')[2]}.{self.__name__}"
        difference = relative_difference(
            (result, *arguments[:n_compared]), (plain_result, *plain_arguments[:n_compared])
        )
        collected[name] = max(collected[name], difference)
        return result

    monkeypatch.setattr(Kernel, "__call__", call_both)
    with limit_threads(1):  # `__call__` is replaced for all threads
        yield collected


@pytest.mark.filterwarnings("ignore::dechirp.PhysicsWarning")
@nightly
@pytest.mark.parametrize("example", ["mimo", "intervals-in-turn", "guard-rail", "interference"])
def test_twins_equal_kernels_in_examples(differences, example):
    scenario = dc.load(EXAMPLES / f"{example}.yaml")

    run(replace(scenario, n_frames=min(scenario.n_frames, 2), tracker=None))

    assert len(differences) >= 8
    assert {name: size for name, size in differences.items() if size > TOLERANCE} == {}


@pytest.mark.parametrize("late", ["held", "onset", "tail"])
def test_twin_of_direct_kernel_equals_it_for_late_and_near_echoes(differences, radar, late):
    targets = [
        dc.Target(position_m=(x, y, 0), velocity_m_per_s=(v, 0, 0), rcs_m2=1)
        for x, y, v in ((0.5, 0.1, 20), (30, 2, -15), (70, 0, 5))
    ]
    dc.simulate(
        dc.Scene(targets=targets),
        radar,
        impairments=(),
        engine=dc.Engine(kernel="direct", late=late),
        dtype=np.complex128,
    )

    # Both within 1e-9 of the law in `kernels.base`.
    assert differences["direct._add_echoes_chirp_by_chirp"] < 2e-9


@pytest.mark.parametrize("sampling", ["complex", "real"])
def test_spectra_of_small_work_equal_those_of_large(sampling):
    shape, rng = (30, 2, 200), np.random.default_rng(1)
    samples = rng.standard_normal(shape, np.float32)
    if sampling == "complex":
        samples = samples + 1j * rng.standard_normal(shape, np.float32)
    fast, slow = (Transform(window="hann", n_points=n, n_bins=n + 3) for n in (200, 30))
    large = range_doppler_spectrum(samples, sampling, fast, slow)

    with plain_twins_for_small_work(0):
        small = range_doppler_spectrum(samples, sampling, fast, slow)

    assert small.dtype == large.dtype == np.complex64
    assert relative_difference(small, large) < TOLERANCE


def test_second_run_of_reference_imports_neither_numba_nor_scipy(tmp_path, monkeypatch):
    monkeypatch.setenv("DECHIRP_CACHE_DIR", str(tmp_path))
    scenario = dc.reference()
    link_budget_of_first_target(scenario, scenario.radar)  # keeps the SNR that it computes

    process = subprocess.run(
        [sys.executable, "-c", IMPORTS_SCRIPT],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )

    # Together they take half a second of processor time, a fifth of the run.
    assert (process.returncode, process.stdout.split()) == (0, [])


def test_list_of_families_imports_no_large_part_of_scipy():
    script = IMPORTS_SCRIPT.replace('["run", "--quiet"]', '["list", "--json"]')
    script = script.replace("print(", "print(file=sys.stderr, ")
    process = subprocess.run(
        [sys.executable, "-c", script.replace("scipy.fft", "scipy.interpolate")],
        capture_output=True,
        text=True,
        check=False,
    )

    # They take 0.3 s of processor time, and the list should take 1 s.
    assert (process.returncode, process.stderr.split()) == (0, [])


@pytest.mark.parametrize(
    "estimator",
    [dc.cfar.OrderedStatistic(), dc.cfar.GreatestOf(), dc.cfar.TrimmedMean()],
    ids=lambda estimator: estimator.kind(),
)
def test_detectors_equal_without_numba(monkeypatch, estimator):
    power = np.random.default_rng(1).exponential(size=(32, 64)).astype(np.float32)
    window = TrainingWindow(
        n_training=dc.Cells(range=4, velocity=3), n_guard=dc.Cells(range=2, velocity=1)
    )
    factors = np.full(64, 2.0, np.float32)
    compiled = estimator.threshold(power, window, factors)
    with monkeypatch.context() as without:
        for module in ("split_window", "ordered_statistic", "trimmed_mean"):
            without.setattr(f"dechirp.processing.cfar.{module}.can_compile", lambda: False)
        plain = estimator.threshold(power, window, factors)

    np.testing.assert_allclose(plain, compiled, rtol=TOLERANCE)


def test_size_of_work_selects_twin(monkeypatch):
    monkeypatch.setattr(compiled_kernels, "MAX_PLAIN_SAMPLES", 1000)
    calls = []

    @kernel(plain=calls.append, cache=False)
    def double(value):
        return 2 * value

    assert double(2) == 4
    with plain_twins_for_small_work(1000):
        double(3)
        with compiled_kernels.compiled_kernels_for_large_work(1001):
            assert double(4) == 8
    with plain_twins_for_small_work(1001), plain_twins_for_small_work(1):
        assert double(5) == 10  # the enclosing work is large
    assert calls == [3]


def test_first_calls_of_process_use_twin_until_samples_add_up(monkeypatch):
    monkeypatch.setattr(compiled_kernels, "MAX_PLAIN_SAMPLES", 1000)
    monkeypatch.setattr(compiled_kernels._calls, "n_samples", 0)
    calls = []

    @kernel(plain=calls.append, cache=False)
    def double(value):
        return 2 * value

    def call(value, n_samples):
        with compiled_kernels.plain_twins_in_first_calls(n_samples):
            return double(value)

    with plain_twins_for_small_work(1001):
        assert call(1, 1) == 2  # the enclosing work is large
    call(2, 600)
    call(3, 400)
    with plain_twins_for_small_work(1000):
        call(4, 10_000)  # the enclosing work is small
    assert calls == [2, 3, 4]
    assert call(5, 1) == 10
    monkeypatch.setattr(compiled_kernels._calls, "n_samples", 0)
    compiled_kernels.count_called_samples(1000)
    assert call(5, 1) == 10
    monkeypatch.setattr(compiled_kernels._calls, "n_samples", 0)
    compiled_kernels.use_compiled_kernels()
    assert call(6, 1) == 12
    assert calls == [2, 3, 4]


def test_kernel_without_twin_raises_without_numba(monkeypatch):
    monkeypatch.setattr(compiled_kernels, "can_compile", lambda: False)

    with pytest.raises(dc.InvalidSetting, match=r"_sums.*without Numba.*pip install numba"):
        kernel()(_sums)(1)


@pytest.mark.parametrize("name", ["low-rank", "nufft"])
def test_direct_kernel_replaces_others_without_numba(monkeypatch, name):
    scenario = dc.reference(["radar.frame.n_chirps=32"])

    def echoes(kernel):
        engine = dc.Engine(kernel=kernel)
        return dc.simulate(scenario.scene, scenario.radar, engine=engine, impairments=()).values

    compiled = echoes(name)
    for module in ("core.compiled_kernels", "simulation.kernels.selection"):
        monkeypatch.setattr(f"dechirp.{module}.can_compile", lambda: False)
    plain = echoes(name)

    np.testing.assert_array_equal(plain, echoes("direct"))
    # The tolerance of the engine for samples in single precision.
    assert relative_difference(compiled, plain) < 1e-5


def test_twin_of_statistical_sensor_draws_equal_detections(differences):
    scenario = replace(dc.reference(), n_frames=3, tracker=None)

    dc.studies.draw_statistical_detections(scenario, seed=1)

    # Normal numbers and tables in single precision, in another order of summation.
    assert differences["peak_sampling.sample_peaks"] < TOLERANCE


@nightly
def test_every_detector_and_direction_estimator_equals_its_compiled_form_without_numba():
    plain, compiled = (
        json.loads(
            subprocess.run(
                [sys.executable, "-c", MEMBERS_SCRIPT, str(EXAMPLES / "mimo.yaml")],
                env=os.environ | {"NUMBA_DISABLE_JIT": is_off},
                stdout=subprocess.PIPE,
                text=True,
                check=True,
            ).stdout
        )
        for is_off in "10"
    )

    assert plain.keys() == compiled.keys()
    for kind, columns in plain.items():
        assert len(columns[0][0]) >= 5, kind
        for (values, _), (expected, stds) in zip(columns, compiled[kind], strict=True):
            # Rounding errors of single precision, small beside those of the noise.
            np.testing.assert_allclose(
                (np.array(values) - expected) / np.maximum(stds, 1e-9), 0.0, atol=1e-2, err_msg=kind
            )


def _sums(value):
    return value


@nightly  # by default, test_package.py checks that a first run does not load Numba
@pytest.mark.parametrize("case", ["cold", "numba-hidden", "jit-disabled"])
def test_first_command_compiles_nothing_and_needs_no_numba(tmp_path, monkeypatch, case, reference):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "numba"))
    if case == "jit-disabled":
        monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    hidden = "numba llvmlite" if case == "numba-hidden" else ""

    process = subprocess.run(
        [sys.executable, "-c", TABLE_SCRIPT, hidden],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )

    assert process.returncode == 0, process.stderr
    assert process.stdout == "0 False\n"
    assert (tmp_path / "dechirp-run" / "report.html").is_file()
    with (tmp_path / "dechirp-run" / "detections.csv").open() as file:
        (row,) = csv.DictReader(file)
    expected = run(reference).detections.isel(detection=0)
    for column, name in (("range_m", "range"), ("velocity_m_per_s", "velocity")):
        limit = 1e-4 * float(expected[f"{name}_std"])
        assert float(row[column]) == pytest.approx(float(expected[name]), abs=limit)
