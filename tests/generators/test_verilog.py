"""Generated Verilog equals the fixed-point chain in every word, with both ends held back."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dechirp as dc
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.compiled_c import draw_frame, make_radar, run_program, small_window_chain
from generators.simulated_verilog import (
    compare_simulated_verilog_with_model,
    lint,
    simulate_in_icarus,
    simulate_in_verilator,
    write_verilog_and_vectors,
)
from generators.test_c import LENGTHS, MODES, tdm_radar
from nightly import nightly, nightly_except


# The three kept modes contain each scaling and each rounding.
@pytest.mark.parametrize(
    ("scaling", "rounding"),
    nightly_except({("block", "convergent"), ("halving", "half-up"), ("none", "truncate")}, MODES),
)
@pytest.mark.parametrize("bits", nightly_except([16], [8, 16, 24]))
def test_every_word_equals_model_in_each_mode(tmp_path, scaling, rounding, bits):
    words = WordLengths(
        scaling=scaling, rounding=rounding, range_bits=bits, doppler_bits=bits, twiddle_bits=bits
    )
    radar = make_radar(32, 16)
    compare_simulated_verilog_with_model(
        tmp_path, draw_frame(radar, 16, seed=bits), radar, small_window_chain(), words,
        stall_percent=30,
    )  # fmt: skip


OTHER_SETTINGS = [
    (
        "real samples, padded, and products shifted left",
        make_radar(25, 10, sampling="real"),
        small_window_chain(n_range_bins=64, n_velocity_bins=16),
        WordLengths(sample_bits=6, range_bits=18, window_bits=8, doppler_bits=14, power_bits=30),
    ),
    (
        "slots of transmitters in turn, fixed shifts",
        tdm_radar(),
        small_window_chain(),
        WordLengths(sample_bits=12, factor_bits=24, scaling="halving", rounding="half-up"),
    ),
]


@pytest.mark.parametrize(
    ("name", "radar", "chain", "words"),
    nightly_except(1, OTHER_SETTINGS),
    ids=["real, padded", "several channels"],
)
def test_every_word_equals_model_for_other_settings(tmp_path, name, radar, chain, words):
    frame = draw_frame(radar, words.sample_bits, seed=3)
    compare_simulated_verilog_with_model(
        tmp_path, frame, radar, chain, words, stall_percent=60, n_frames=1
    )


@nightly
@pytest.mark.parametrize("scaling", ["block", "halving"])
def test_verilator_has_no_warning(tmp_path, scaling):
    words = WordLengths(scaling=scaling)
    for radar, chain, other_words in (
        (make_radar(32, 16), small_window_chain(), words),
        *((radar, chain, replace(w, scaling=scaling)) for _, radar, chain, w in OTHER_SETTINGS),
    ):
        dc.generators.Verilog().write(tmp_path / "v", radar, chain, other_words)
        assert lint(tmp_path) == ""


# Six frames without a gap: more than both banks of the memory and all delays contain. With block
# scaling, the memory of the spectra loses at most three clocks at the start of a frame.
@nightly
@pytest.mark.parametrize(("scaling", "n_lost"), [("halving", 0), ("block", 3)])
def test_takes_one_sample_a_clock(tmp_path, scaling, n_lost):
    radar, n_frames = make_radar(32, 16), 6
    output = compare_simulated_verilog_with_model(
        tmp_path, draw_frame(radar, 16, seed=4), radar, small_window_chain(),
        WordLengths(scaling=scaling), n_frames=n_frames,
    )  # fmt: skip
    n_clocks, n_samples = map(int, re.findall(r"; (\d+) clocks for (\d+) samples", output)[0])
    assert n_samples == n_frames * 32 * 16
    assert n_samples <= n_clocks <= n_samples + n_frames * n_lost


# A zero takes a clock as a sample does; those after the last sample are not counted.
@nightly
def test_padding_takes_a_clock_for_each_zero(tmp_path):
    radar = make_radar(16, 16)
    output = compare_simulated_verilog_with_model(
        tmp_path, draw_frame(radar, 16, seed=4), radar, small_window_chain(n_range_bins=32),
        WordLengths(scaling="halving"), n_frames=1,
    )  # fmt: skip
    assert f"; {16 * 32 - 16} clocks for {16 * 16} samples" in output


def test_ports_have_whole_bytes(tmp_path):
    for _, radar, chain, words in OTHER_SETTINGS:
        dc.generators.Verilog().write(tmp_path / "v", radar, chain, words)
        text = (tmp_path / "v" / "radar.v").read_text()
        tops = re.findall(r"put +wire \[(\d+):0\] [sm]_axis_t(?:data|user)", text)
        assert [(int(top) + 1) % 8 for top in tops] == [0, 0, 0]


# Feedback registers: they hold each side in about half of all clocks, not in step.
RANDOM_READY = """
    reg [16:0] shift_register = 17'd1;
    always @(posedge clk)
        shift_register <= {shift_register[15:0], shift_register[16] ^ shift_register[13]};
    radar_core #("""


@nightly
@pytest.mark.parametrize("scaling", ["block", "halving"])
def test_memory_outside_may_hold_both_sides(tmp_path, scaling):
    radar, words = make_radar(32, 16), WordLengths(scaling=scaling)
    frame = draw_frame(radar, 16, seed=8)
    write_verilog_and_vectors(tmp_path, frame, radar, small_window_chain(), words)
    top = tmp_path / "v" / "radar.v"
    text = top.read_text().replace("    radar_core #(", RANDOM_READY)
    ports = ("memory_write", "memory_read", "spectrum_write", "spectrum_read")
    for bit, port in zip((0, 7, 3, 11), ports, strict=True):
        assert f".{port}_ready(1'b1)" in text
        text = text.replace(f".{port}_ready(1'b1)", f".{port}_ready(shift_register[{bit}])")
    top.write_text(text)

    output = simulate_in_icarus(tmp_path, "+frames=2", "+stall=20")

    assert "PASS" in output, output[-3000:]
    n_clocks, n_samples = map(int, re.findall(r"; (\d+) clocks for (\d+) samples", output)[0])
    assert n_clocks > 1.5 * n_samples


@pytest.mark.parametrize("name", nightly_except(1, ["range_fft_q", "doppler_fft_i", "threshold"]))
def test_test_bench_finds_one_wrong_bit(tmp_path, name):
    radar = make_radar(32, 16)
    frame = draw_frame(radar, 16, seed=6)
    write_verilog_and_vectors(tmp_path, frame, radar, small_window_chain(), WordLengths())
    file = tmp_path / "vectors" / f"{name}.hex"
    lines = file.read_text().splitlines()
    k = len(lines) // 3
    lines[k] = f"{int(lines[k], 16) ^ 1:0{len(lines[k])}x}"
    file.write_text("\n".join(lines) + "\n")

    output = simulate_in_icarus(tmp_path, must_fail=True)

    assert "FAIL" in output and "PASS" not in output
    assert re.search(name.removesuffix("_i").removesuffix("_q"), output)


def break_vectors(folder: Path, name: str, damage: str) -> None:
    """Remove, shorten or lengthen a file of vectors."""
    file = folder / "vectors" / f"{name}.hex"
    if damage == "missing":
        file.unlink()
    elif damage == "short":
        file.write_text("".join(file.read_text().splitlines(keepends=True)[:-1]))
    else:
        file.write_text(file.read_text() + "0\n")


@pytest.mark.parametrize(
    ("name", "damage", "n_words"),
    [("samples_i", "missing", 0), ("power", "short", 511), ("detected", "long", 513)],
)
def test_test_bench_fails_without_whole_vectors(tmp_path, name, damage, n_words):
    radar = make_radar(32, 16)
    frame = draw_frame(radar, 16, seed=6)
    write_verilog_and_vectors(tmp_path, frame, radar, small_window_chain(), WordLengths())
    break_vectors(tmp_path, name, damage)

    output = simulate_in_icarus(tmp_path, must_fail=True)

    assert f"{name}.hex: {n_words} words, expected 512" in output
    assert "FAIL" in output and "PASS" not in output


@nightly
def test_test_bench_in_verilator_fails_without_vectors_and_for_a_wrong_bit(tmp_path):
    radar = make_radar(32, 16)
    frame = draw_frame(radar, 16, seed=6)
    write_verilog_and_vectors(tmp_path, frame, radar, small_window_chain(), WordLengths())
    file = tmp_path / "vectors" / "threshold.hex"
    file.write_text(file.read_text().replace("1", "0", 1))
    assert "FAIL" in simulate_in_verilator(tmp_path, must_fail=True)
    break_vectors(tmp_path, "threshold", "missing")
    output = run_program(tmp_path / "check", f"+vectors={tmp_path / 'vectors'}", must_fail=True)
    assert "threshold.hex: 0 words, expected 512" in output and "PASS" not in output


def test_verilog_refuses_keywords_and_transforms_of_two_points(tmp_path):
    for prefix in (
        "module",
        "Always",
        "logic",
        "core",
        "clk",
        "dut",
        "com1",
        "2nd",
        "front-left",
        "",
    ):
        with pytest.raises(dc.InvalidSetting, match=r"Verilog\.prefix"):
            dc.generators.Verilog(prefix=prefix)
    chain = dc.Chain(
        cfar=dc.Cfar(
            estimator=dc.cfar.CellAveraging(),
            n_training=dc.Cells(range=4, velocity=0),
            n_guard=dc.Cells(range=1, velocity=0),
            offset=3.0,
        )
    )
    with pytest.raises(dc.InvalidSetting, match=r"n_velocity_bins: 2; expected at least 4"):
        dc.generators.Verilog().write(tmp_path / "v", make_radar(32, 2), chain)
    assert list(tmp_path.iterdir()) == []


def draw_settings(rng: np.random.Generator) -> tuple[dc.Radar, dc.Chain, WordLengths]:
    """Draw word lengths, transform lengths, channels and training windows that fit."""
    bits = {
        name: int(rng.integers(4, 25))
        for name in ("window_bits", "twiddle_bits", "range_bits", "doppler_bits")
    }
    words = WordLengths(
        sample_bits=int(rng.integers(2, 25)),
        power_bits=int(rng.integers(8, 49)),
        factor_bits=int(rng.integers(10, 25)),
        scaling=str(rng.choice(["block", "halving", "none"])),
        rounding=str(rng.choice(["convergent", "half-up", "truncate"])),
        **bits,
    )
    training, guard = rng.integers(1, 4, size=2), rng.integers(0, 3, size=2)
    half = training + guard
    n_range_bins, n_velocity_bins = (
        2 ** int(np.ceil(np.log2(2 * size + 8)) + rng.integers(0, 2)) for size in half
    )
    n_range_bins *= 2  # real samples keep half of them
    cfar = dc.Cfar(
        estimator=dc.cfar.CellAveraging(),
        n_training=dc.Cells(range=int(training[0]), velocity=int(training[1])),
        n_guard=dc.Cells(range=int(guard[0]), velocity=int(guard[1])),
        offset=4.0,
    )
    radar = make_radar(
        int(rng.integers(n_range_bins // 2 + 1, n_range_bins + 1)),
        int(rng.integers(n_velocity_bins // 2 + 1, n_velocity_bins + 1)),
        n_rx=int(rng.integers(1, 4)),
        sampling=str(rng.choice(["complex", "real"])),
    )
    chain = dc.Chain(cfar=cfar, n_range_bins=n_range_bins, n_velocity_bins=n_velocity_bins)
    return radar, chain, words


@nightly
@pytest.mark.parametrize("seed", range(40))
def test_every_word_equals_model_for_random_settings(tmp_path, seed):
    rng = np.random.default_rng(seed)
    radar, chain, words = draw_settings(rng)
    frame = draw_frame(radar, words.sample_bits, seed)
    stall_percent = int(rng.choice([0, 30, 70]))
    compare_simulated_verilog_with_model(
        tmp_path, frame, radar, chain, words, stall_percent=stall_percent, n_frames=3
    )
    assert lint(tmp_path) == ""


# The frames of the C test, each in two of the nine modes. Verilator compiles for a minute and then
# simulates 200 times faster than Icarus, which simulates each length once.
@nightly
@pytest.mark.parametrize(
    ("n_samples", "n_chirps", "mode", "simulator"),
    [
        (*lengths, MODES[(2 * k + j) % len(MODES)], simulator)
        for k, lengths in enumerate(LENGTHS)
        for j, simulator in ((0, "verilator"), (1, "verilator"), (0, "icarus"))
    ],
)
def test_long_frames_equal_model(tmp_path, n_samples, n_chirps, mode, simulator):
    scaling, rounding = mode
    radar, words = make_radar(n_samples, n_chirps), WordLengths(scaling=scaling, rounding=rounding)
    frame = draw_frame(radar, 16, seed=n_samples)
    in_verilator = simulator == "verilator"
    compare_simulated_verilog_with_model(
        tmp_path, frame, radar, dc.Chain(), words,
        stall_percent=20, n_frames=1 + in_verilator, in_verilator=in_verilator,
    )  # fmt: skip
