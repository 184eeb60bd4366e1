"""Generated C, compiled and run on test vectors."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import dechirp as dc
from dechirp.processing.fixed_point.chain import fixed_point_map
from dechirp.processing.fixed_point.word_lengths import WordLengths
from radars import street_radar

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-pedantic", "-Werror")
CORTEX_M7 = Path(__file__).parent / "cortex_m7"
CORTEX_M7_COMPILER = ("arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mthumb")


def require_program(name: str) -> str:
    """Return the path of a program, or skip the test; the gate needs all of them."""
    path = shutil.which(name)
    if path is None and sys.platform == "linux" and os.environ.get("CI"):
        pytest.fail(f"{name} is not installed (with CI set, the proof of generated code must run)")
    if path is None:
        pytest.skip(f"{name} is not installed")
    return path


def run_program(*words: str | Path, cwd: Path | None = None, must_fail: bool = False) -> str:
    """Run a program, check whether it succeeds, and return what it prints."""
    result = subprocess.run(
        words, cwd=cwd, capture_output=True, check=False, text=True, timeout=3600
    )
    assert (result.returncode != 0) == must_fail, result.stdout[-1000:] + result.stderr[-3000:]
    return result.stdout


def compile_check_program(folder: Path, *options: str) -> Path:
    """Compile the test program with sanitizers, all warnings as errors."""
    program = folder.parent / "check"
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    sources = ("-DRADAR_TRACE", "main.c", "radar.c", "-o", str(program))
    run_program(require_program("gcc"), *WARNINGS, *sanitizers, *options, *sources, cwd=folder)
    return program


def run_on_emulated_cortex_m7(folder: Path, vectors: Path) -> str:
    """Compile the test program for a Cortex-M7, run it in QEMU, and return what it prints."""
    program = folder.parent / "check.elf"
    libraries = ("--specs=rdimon.specs", "-T", str(CORTEX_M7 / "memory.ld"))
    sources = ("-DRADAR_TRACE", "main.c", "radar.c", str(CORTEX_M7 / "startup.c"))
    compiler = (require_program(CORTEX_M7_COMPILER[0]), *CORTEX_M7_COMPILER[1:])
    run_program(*compiler, "-std=c99", "-O2", *libraries, *sources, "-o", program, cwd=folder)
    return run_program(
        require_program("qemu-system-arm"),
        *("-M", "mps2-an500", "-cpu", "cortex-m7", "-nographic", "-monitor", "none"),
        "-semihosting-config",
        "enable=on,target=native,arg=check,arg=vectors",
        *("-kernel", program),
        cwd=vectors.parent,
    )


def check_output_equals_map(output: str, expected: xr.Dataset) -> int:
    """Check that all words are equal and that the detections are those of the map."""
    n_words, n_different = map(int, re.findall(r"(\d+) words compared, (\d+) differ", output)[0])
    lines = [line.split() for line in output.splitlines()[1:] if re.fullmatch(r"[\d ]+", line)]
    detections = np.array(lines, np.int64).reshape(-1, 5)
    velocity, row = np.nonzero(expected.detected.values)
    names = ("power", "threshold", "log_power")
    columns = [velocity, row, *(expected[name].values[velocity, row] for name in names)]
    assert n_different == 0
    assert np.array_equal(detections, np.stack(columns, axis=1).astype(np.int64))
    return n_words


def compare_compiled_c_with_model(
    folder: Path,
    frame: xr.DataArray,
    radar: dc.Radar,
    chain: dc.Chain,
    words: WordLengths,
    *,
    on_cortex_m7: bool = False,
    optimisation: str = "-O0",
) -> int:
    """Generate, compile and run C on one frame; return the number of words, all equal."""
    dc.fixed_point.write_c(folder / "c", radar, chain, words)
    dc.fixed_point.write_vectors(folder / "vectors", frame, radar, chain, words)
    if on_cortex_m7:
        output = run_on_emulated_cortex_m7(folder / "c", folder / "vectors")
    else:
        output = run_program(compile_check_program(folder / "c", optimisation), folder / "vectors")
    return check_output_equals_map(output, fixed_point_map(frame, radar, chain, words))


def small_window_chain(**settings: object) -> dc.Chain:
    """Return a chain whose training window fits small maps."""
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=5, velocity=3),
        n_guard=dc.Cells(range=2, velocity=1),
        offset=4.0,
    )
    return dc.Chain(**{"cfar": cfar, **settings})


def make_radar(n_samples: int, n_chirps: int, **settings: object) -> dc.Radar:
    """Return a street radar with one receiver, if not stated otherwise, and a fast converter."""
    radar = street_radar(**{"n_samples": 64, "n_chirps": n_chirps, "n_rx": 1, **settings})
    rate_hz = max(radar.frame.chirp.sample_rate_hz, n_samples / 27e-6)  # the ramp has 28 us
    chirp = replace(radar.frame.chirp, n_samples=n_samples, sample_rate_hz=rate_hz)
    return replace(radar, frame=replace(radar.frame, chirp=chirp))


def draw_frame(radar: dc.Radar, sample_bits: int, seed: int) -> xr.DataArray:
    """Draw a frame of ADC codes: noise, with chirps of full scale, of weak noise and of zeros."""
    rng = np.random.default_rng(seed)
    frame, chirp = radar.frame, radar.frame.chirp
    is_complex = chirp.sampling == "complex"
    axes = ("chirp", "rx", "sample", *(("iq",) if is_complex else ()))
    shape = (frame.n_chirps_total, radar.array.n_rx, chirp.n_samples, 2)[: len(axes)]
    half = 2 ** (sample_bits - 1)
    codes = rng.integers(-half, half, size=shape)
    kinds = rng.integers(0, 8, size=len(codes))
    codes[kinds == 0] = rng.choice([-half, half - 1], size=codes[kinds == 0].shape)
    codes[kinds == 1] //= max(half // 4, 1)
    codes[kinds == 2] = 0
    return xr.DataArray(codes.astype(np.int32), dims=axes)
