"""Generated Verilog, simulated on test vectors."""

import re
from pathlib import Path

import numpy as np
import xarray as xr

import dechirp as dc
from dechirp.processing.fixed_point.chain import fixed_point_map
from dechirp.processing.fixed_point.lookup_tables import make_lookup_tables
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.compiled_c import require_program, run_program


def write_verilog_and_vectors(
    folder: Path, frame: xr.DataArray, radar: dc.Radar, chain: dc.Chain, words: WordLengths
) -> None:
    """Write the folders `v` and `vectors`."""
    dc.generators.Verilog().write(folder / "v", radar, chain, words)
    dc.fixed_point.write_vectors(folder / "vectors", frame, radar, chain, words)


def lint(folder: Path) -> str:
    """Return the warnings of Verilator about the design, without the test bench."""
    design = sorted((folder / "v").glob("radar*.v"))
    options = ("--lint-only", "-Wall", "--top-module", "radar")
    return run_program(require_program("verilator"), *options, *design)


def simulate_in_icarus(folder: Path, *options: str, must_fail: bool = False) -> str:
    """Compile design and test bench with Icarus Verilog, run them, and return what they print."""
    sources = sorted((folder / "v").glob("*.v"))
    compiler = (require_program("iverilog"), "-g2005", "-Wall", "-Wno-timescale")
    # The shell joins the warnings to the output, which is empty without them.
    compile_with_warnings = ("sh", "-c", 'exec "$@" 2>&1', "sh", *compiler)
    assert run_program(*compile_with_warnings, "-o", folder / "check", *sources) == ""
    call = (require_program("vvp"), folder / "check", f"+vectors={folder / 'vectors'}", *options)
    return run_program(*call, must_fail=must_fail)


def simulate_in_verilator(folder: Path, *options: str, must_fail: bool = False) -> str:
    """Compile design and test bench with Verilator, run them, and return what they print."""
    sources = sorted((folder / "v").glob("*.v"))
    compiler = (require_program("verilator"), "--binary", "--timing", "-Wno-fatal", "-Wno-lint")
    target = ("--top-module", "test_radar", "--Mdir", folder / "build", "-o", folder / "check")
    run_program(*compiler, *target, *sources)
    call = (folder / "check", f"+vectors={folder / 'vectors'}", *options)
    return run_program(*call, must_fail=must_fail)


def check_output_equals_map(output: str, expected: xr.Dataset, n_frames: int) -> None:
    """Check that all words are equal and that the detections are those of the map."""
    lines = [line.split() for line in output.splitlines() if re.fullmatch(r"[\d ]+", line)]
    detections = np.array(lines, np.int64).reshape(-1, 4)
    row, velocity = np.nonzero(expected.detected.values.T)
    names = ("power", "threshold")
    columns = [velocity, row, *(expected[name].values[velocity, row] for name in names)]
    assert "PASS: every word equals the model" in output, output[-3000:]
    assert f"{n_frames} frames, " in output
    assert np.array_equal(detections, np.stack(columns, axis=1).astype(np.int64))


def compare_simulated_verilog_with_model(
    folder: Path,
    frame: xr.DataArray,
    radar: dc.Radar,
    chain: dc.Chain,
    words: WordLengths,
    *,
    stall_percent: int = 0,
    n_frames: int = 2,
    in_verilator: bool = False,
) -> str:
    """Generate and simulate Verilog on a frame, n_frames times; check every word."""
    write_verilog_and_vectors(folder, frame, radar, chain, words)
    simulate = simulate_in_verilator if in_verilator else simulate_in_icarus
    options = (f"+stall={stall_percent}", f"+frames={n_frames}", "+seed=7")
    output = simulate(folder, *options)
    check_output_equals_map(output, fixed_point_map(frame, radar, chain, words), n_frames)
    n_searched = make_lookup_tables(radar, chain.fit_to_radar(radar), words).factors.size
    n_velocity = fixed_point_map(frame, radar, chain, words).sizes["velocity"]
    assert f" {n_frames * n_searched * n_velocity} cells" in output
    return output
