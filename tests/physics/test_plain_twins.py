"""Plain twins of compiled kernels: equal results, and whole runs without Numba."""

import ast
import csv
import importlib
import json
import logging
import os
import subprocess
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.cli.compilation_notice import announced_compilation
from dechirp.core import compiled_kernels
from dechirp.core.compiled_kernels import Kernel, kernel, plain_twins_for_small_work
from dechirp.core.threads import limit_threads
from dechirp.experiments.link_budget import link_budget_of_first_target
from dechirp.experiments.run import run
from dechirp.processing import simd_range_doppler
from dechirp.processing.angle.aperture import Aperture
from dechirp.processing.cfar.base import TrainingWindow
from dechirp.processing.simd_beamforming import mirrored_beam_weights, raise_to_largest_beam_power
from dechirp.processing.spectrum import (
    Transform,
    mean_range_doppler_power,
    range_doppler_real_and_imaginary,
    range_doppler_spectrum,
)
from dechirp.recordings.live.reassembly import N_PACKETS, ReassemblyWindow
from dechirp.recordings.live.replay import build_dca1000_packet
from dechirp.recordings.live.socket_reader import PacketSlots
from nightly import nightly
from test_layers import ROOT, parse_file
from twin_comparison import compare_in_calls, kernel_name, relative_difference

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

REASSEMBLY = "recordings.live.reassembly._insert_packets_into_frames"
# Kernels whose callers compute without them, and the test that compares both ways.
COMPARED_CALLERS = {
    "processing.cfar": "test_detectors_equal_without_numba",
    "processing.simd_beam_powers": "test_beams_in_registers_equal_those_of_numpy",
    "processing.simd_range_doppler": "test_transforms_in_registers_equal_those_of_scipy",
    "simulation.kernels": "test_direct_kernel_replaces_others_without_numba",
}
# Tests that call all other kernels with a twin.
COMPARED_TESTS = [
    "edges/test_adc_code_storage",
    "edges/test_streams",
    "formats/test_cloud_files",
    "formats/test_complex_samples",
    "formats/test_generic_cubes",
    "formats/test_slow_time_files",
    "formats/test_ti_captures",
    "physics/test_angle_maps",
    "physics/test_angle_subspace",
    "physics/test_chain_angles",
    "physics/test_chirp_interpolation",
    "physics/test_clusters",
    "physics/test_fixed_point",
    "physics/test_frame_intervals",
    "physics/test_mitigation_interference",
    "physics/test_mitigation_slow_time",
    "physics/test_noise_maps",
    "physics/test_receiver_compression",
    "physics/test_recording_quality",
    "physics/test_shadowing",
    "physics/test_sidelobe_rejection",
    "physics/test_statistical_sensor",
    "physics/test_synchronous_interference",
    "physics/test_velocity_ambiguity",
    "witnesses/test_plain_arrays",
]


@pytest.fixture
def differences(monkeypatch):
    """Call each kernel twice, compiled and plain; collect the differences by its name."""
    collected = {}
    monkeypatch.setattr(Kernel, "__call__", compare_in_calls(collected))
    with limit_threads(1):  # the numbers are collected without a lock
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
    assert differences["simulation.kernels.direct._add_echoes_chirp_by_chirp"] < 2e-9


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


@pytest.mark.parametrize("compute", [mean_range_doppler_power, range_doppler_real_and_imaginary])
def test_transforms_in_registers_equal_those_of_scipy(compute):
    shape, rng = (64, 3, 192), np.random.default_rng(2)
    samples = rng.standard_normal(shape, np.float32) + 1j * rng.standard_normal(shape, np.float32)
    fast, slow = (Transform(window="hann", n_points=n, n_bins=n) for n in (192, 64))
    assert simd_range_doppler.can_transform_sizes(64, 192, 192)
    compiled = compute(samples, "complex", fast, slow)

    with plain_twins_for_small_work(0):
        plain = compute(samples, "complex", fast, slow)

    assert relative_difference(compiled, plain) < TOLERANCE


BEAM_ARRAYS = {
    "line": [(0, 0.55 * k, 0) for k in range(12)],
    "plane": [(0, 0.5 * j, 0.8 * k) for j in range(4) for k in range(3)],
    "with depth": [(0.1 * (k % 2), 0.55 * k, 0) for k in range(12)],
}


@pytest.mark.parametrize("n_ranges", [15, 16, 70, 260])
@pytest.mark.parametrize("array", BEAM_ARRAYS)
def test_beams_in_registers_equal_those_of_numpy(array, n_ranges):
    rng = np.random.default_rng(3)
    aperture = Aperture(np.array(BEAM_ARRAYS[array]))
    pair_sums, weights = mirrored_beam_weights(aperture)
    assert array != "line" or weights.shape[1] % 4  # the last group of directions is not full
    pair_sums[5] = 0  # terms without all channels
    spectrum = rng.standard_normal((5, n_ranges, 12, 2), np.float32).transpose(0, 2, 3, 1)
    compensation = np.exp(2j * np.pi * rng.random((5, 12))).astype(np.complex64)
    compiled = np.zeros((len(aperture.direction_grid.azimuth_rad), n_ranges), np.float32)
    compiled[::2, ::3] = 1.0  # some powers are higher before
    plain = compiled.copy()
    raise_to_largest_beam_power(compiled, spectrum, compensation, pair_sums, weights)

    with plain_twins_for_small_work(0):
        raise_to_largest_beam_power(plain, spectrum, compensation, pair_sums, weights)

    assert relative_difference(compiled, plain) < TOLERANCE
    assert compiled.min() < 0.9 < compiled.max()


@nightly
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


@nightly
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
    exceeding = estimator.exceeds_threshold(power, window, factors)
    with monkeypatch.context() as without:
        for module in ("split_window", "ordered_statistic", "trimmed_mean"):
            without.setattr(f"dechirp.processing.cfar.{module}.can_compile", lambda: False)
        plain = estimator.threshold(power, window, factors)
        exceeding_plain = estimator.exceeds_threshold(power, window, factors)

    np.testing.assert_allclose(plain, compiled, rtol=TOLERANCE)
    assert np.count_nonzero(exceeding) > 10
    np.testing.assert_array_equal(exceeding_plain, exceeding)


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


@nightly
def test_twin_of_statistical_sensor_draws_equal_detections(differences):
    scenario = replace(dc.reference(), n_frames=3, tracker=None)

    dc.studies.draw_statistical_detections(scenario, seed=1)

    # Normal numbers and tables in single precision, in another order of summation.
    assert differences["experiments.statistical.peak_sampling.sample_peaks"] < TOLERANCE


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


@cache
def kernels_called_from_python():
    """Return the kernels that functions other than kernels refer to, and whether these are twins.

    A kernel within a kernel is compiled with it, so it needs no twin.
    """
    trees = {
        ".".join(("dechirp", *path.relative_to(ROOT).with_suffix("").parts)): parse_file(path)
        for path in ROOT.rglob("*.py")
        if "compiled_kernels" in path.read_text(encoding="utf-8")
        or "kernels" in path.relative_to(ROOT).parts
    }
    modules = {name: importlib.import_module(name) for name in trees}
    kernels = {k for m in modules.values() for k in vars(m).values() if isinstance(k, Kernel)}
    loops = {(k.__module__, k.__name__) for k in kernels}
    twins = {(k.plain.__module__, k.plain.__name__) for k in kernels if k.plain} - loops
    called = {}
    for name, tree in trees.items():
        for node in tree.body:
            owner = name, getattr(node, "name", "")
            if owner in loops:
                continue
            for part in ast.walk(node):
                value = (
                    getattr(modules[name], part.id, None) if isinstance(part, ast.Name) else None
                )
                if isinstance(value, Kernel):
                    called[value] = called.get(value, True) and owner in twins
    return called


def test_kernels_that_python_calls_have_a_twin_or_a_caller_that_computes_without_them():
    called = kernels_called_from_python()
    assert len(called) > 80
    assert {kernel_name(k) for k in called if k.plain is None and not k.has_plain_caller} == set()
    in_callers = {kernel_name(k) for k in called if k.has_plain_caller}
    assert {name for name in in_callers if not name.startswith(tuple(COMPARED_CALLERS))} == set()
    assert set(COMPARED_CALLERS.values()) <= globals().keys()


@nightly
def test_each_twin_that_python_calls_equals_its_kernel_in_some_test(tmp_path):
    path = tmp_path / "differences.json"
    process = subprocess.run(
        [*(sys.executable, "-m", "pytest", "-q", "-n", "0", "-p", "twin_comparison")]
        + [f"tests/{name}.py" for name in COMPARED_TESTS],
        cwd=Path(__file__).parents[2],
        env={**os.environ, "TWIN_DIFFERENCES": str(path), "DECHIRP_NIGHTLY": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stdout[-3000:]
    differences = json.loads(path.read_text())

    assert {name: size for name, size in differences.items() if size > TOLERANCE} == {}
    names = {
        kernel_name(kernel)
        for kernel, only_twins_call_it in kernels_called_from_python().items()
        if kernel.plain is not None and not only_twins_call_it
    }
    # Its frames of 2 MB are compared below.
    assert names - differences.keys() == {REASSEMBLY}


KERNEL_MODULE = """
from dechirp.core.compiled_kernels import kernel
{imports}

@kernel()
def {name}(x: int) -> int:
    return {result}
"""
INTRINSIC_MODULE = """
from numba.core import types
from numba.extending import intrinsic

from loops.operation import combine

@intrinsic
def add_offset(context, x):
    def build(context, builder, signature, values):
        return combine(builder, values[0], context.get_constant(types.int64, {offset}))

    return types.int64(types.int64), build
"""
OPERATION_MODULE = """
def combine(builder, a, b):
    return builder.{operation}(a, b)
"""


@nightly
def test_changes_in_the_files_that_a_kernel_uses_are_compiled(tmp_path):
    """Numba alone keeps the compiled code of `outer` while its own file is unchanged."""
    imports = "from loops.constants import SCALE, STEPS\nfrom loops.offset import add_offset"
    inner = KERNEL_MODULE.replace("{imports}", imports).replace("{name}", "inner")
    files = {
        "outer": KERNEL_MODULE.format(
            imports="from loops.middle import middle", name="outer", result="middle(x)"
        ),
        "middle": KERNEL_MODULE.format(
            imports="from loops.inner import inner", name="middle", result="inner(x)"
        ),
        "inner": inner.format(result="add_offset(x) + SCALE * STEPS[0]"),
        "constants": "import numpy as np\nSCALE, STEPS = 1, np.array([1])\n",
        "offset": INTRINSIC_MODULE.format(offset=0),
        "operation": OPERATION_MODULE.format(operation="add"),
    }
    changes = [
        files,
        {},
        {"inner": inner.format(result="add_offset(x) + SCALE * STEPS[0] + 20")},
        {"constants": "import numpy as np\nSCALE, STEPS = 300, np.array([1])\n"},
        {"constants": "import numpy as np\nSCALE, STEPS = 300, np.array([10])\n"},
        {"offset": INTRINSIC_MODULE.format(offset=40_000)},
        {"operation": OPERATION_MODULE.format(operation="sub")},
    ]
    script = """
from loops.outer import outer
print(outer(1), "loaded" if outer.dispatcher.stats.cache_hits else "compiled")
"""
    (tmp_path / "loops").mkdir()
    results = []
    for change in changes:
        for name, content in change.items():
            (tmp_path / "loops" / f"{name}.py").write_text(content)
        results.append(
            subprocess.run(
                [sys.executable, "-c", script],
                cwd=tmp_path,
                env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kept")},
                capture_output=True,
                text=True,
                check=True,
            ).stdout.strip()
        )

    assert results == [
        "2 compiled",
        "2 loaded",
        "22 compiled",
        "321 compiled",
        "3021 compiled",
        "43021 compiled",
        "-36979 compiled",
    ]


def test_twin_of_reassembly_writes_equal_frames(differences):
    rng = np.random.default_rng(1)
    window = ReassemblyWindow(512, max_lost_frames=100)
    content, sizes = np.zeros((20, 1472), np.uint8), np.full(20, 1466)
    for row, number in zip(content, rng.permutation(20).tolist(), strict=True):
        packet = build_dca1000_packet(number + 1, rng.bytes(1456))
        row[:1466] = np.frombuffer(packet, np.uint8)

    list(window.reassemble_frames(PacketSlots(content, sizes, np.zeros(20, np.int64))))

    assert window.counters[N_PACKETS] == 20
    assert differences[REASSEMBLY] == 0


def compile_two_kernels():
    pytest.importorskip("numba")
    compiled_kernels._log_first_compilation.cache_clear()
    for factor in (2.0, 3.0):
        kernel(cache=False)(lambda number, factor=factor: factor * number).dispatcher(1.0)


@pytest.mark.parametrize("is_interactive", [True, False])
def test_first_compilation_is_reported_once_in_an_interactive_session(
    is_interactive, capsys, caplog, monkeypatch
):
    if is_interactive:
        monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    monkeypatch.setattr(compiled_kernels, "compilation_listeners", [])
    caplog.set_level(logging.WARNING, "dechirp")
    compile_two_kernels()

    assert capsys.readouterr().err.count("compiling loops") == is_interactive


def test_quiet_command_on_a_terminal_reports_no_compilation(capsys, monkeypatch):
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    with announced_compilation(quiet=True):
        compile_two_kernels()
    assert not capsys.readouterr().err


def test_first_compilation_of_a_process_is_logged(caplog, capsys, monkeypatch):
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    with caplog.at_level(logging.INFO, "dechirp"):
        compile_two_kernels()

    assert capsys.readouterr().err == ""

    (record,) = caplog.records
    assert "up to a minute of processor time" in record.message
