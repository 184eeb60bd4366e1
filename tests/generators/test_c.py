"""Generated C99 equals the fixed-point chain in every word, under sanitizers and on a Cortex-M7."""

import itertools
import subprocess
from dataclasses import replace

import pytest

import dechirp as dc
from dechirp.generators.base import Design
from dechirp.processing.fixed_point.lookup_tables import make_lookup_tables
from dechirp.processing.fixed_point.word_lengths import WordLengths
from generators.compiled_c import (
    CORTEX_M7_COMPILER,
    WARNINGS,
    compare_compiled_c_with_model,
    draw_frame,
    make_radar,
    require_program,
    run_program,
    small_window_chain,
)
from nightly import nightly, nightly_except

SCALINGS, ROUNDINGS = ("block", "halving", "none"), ("convergent", "half-up", "truncate")
MODES = list(itertools.product(SCALINGS, ROUNDINGS))
RANGE_ONLY = dc.Cfar(
    estimator=dc.cfar.CellAveraging(),
    n_training=dc.Cells(range=4, velocity=0),
    n_guard=dc.Cells(range=1, velocity=0),
    offset=3.0,
)


def tdm_radar() -> dc.Radar:
    """Return a radar with two transmitters in turn and two receivers."""
    radar = make_radar(64, 16, n_rx=2)
    return replace(
        radar,
        array=replace(radar.array, tx_m=[(0, 0, 0), (0, 3.8e-3, 0)]),
        frame=replace(radar.frame, multiplexing=dc.multiplexing.Tdm(order=(1, 0))),
    )


# The three kept modes contain each scaling and each rounding.
@pytest.mark.parametrize(
    ("scaling", "rounding"),
    nightly_except({("block", "convergent"), ("halving", "half-up"), ("none", "truncate")}, MODES),
)
@pytest.mark.parametrize("bits", nightly_except([16], [8, 16, 20, 24]))
def test_every_word_equals_model_in_each_mode(tmp_path, scaling, rounding, bits):
    words = WordLengths(
        scaling=scaling, rounding=rounding, range_bits=bits, doppler_bits=bits, twiddle_bits=bits
    )
    radar = make_radar(64, 32)

    n_words = compare_compiled_c_with_model(
        tmp_path, draw_frame(radar, 16, seed=bits), radar, small_window_chain(), words
    )

    # Window, transform of range and of Doppler: 2 x 4 parts; power, logarithm, threshold and
    # detection; shifts of 6 and of 5 stages.
    assert n_words == 64 * 32 * (8 + 4) + 32 * 6 + 64 * 5


@pytest.mark.parametrize(
    ("name", "radar", "chain", "words"),
    nightly_except(
        1,
        [
            (
                "real samples, padded, and saturated products",
                make_radar(48, 20, sampling="real"),
                small_window_chain(n_range_bins=128, n_velocity_bins=64),
                WordLengths(sample_bits=12, range_bits=18, doppler_bits=14, scaling="none"),
            ),
            (
                "slots of transmitters in turn, one detector over range",
                tdm_radar(),
                dc.Chain(cfar=RANGE_ONLY),
                WordLengths(sample_bits=24, window_bits=9, power_bits=20, factor_bits=24),
            ),
            (
                "shortest words, products shifted left",
                make_radar(64, 16),
                small_window_chain(range_window="rectangular", doppler_window="taylor-50"),
                WordLengths(
                    sample_bits=2,
                    window_bits=4,
                    twiddle_bits=4,
                    range_bits=4,
                    doppler_bits=24,
                    power_bits=48,
                    factor_bits=4,
                    log_fraction_bits=1,
                    log_table_bits=12,
                    rounding="half-up",
                ),
            ),
        ],
    ),
    ids=lambda value: value.replace(" ", "-") if isinstance(value, str) else "",
)
def test_every_word_equals_model_for_other_settings(tmp_path, name, radar, chain, words):
    frame = draw_frame(radar, words.sample_bits, seed=3)
    assert compare_compiled_c_with_model(tmp_path, frame, radar, chain, words) > 10_000, name


LENGTHS = [(64, 4096), (128, 1024), (256, 512), (512, 256), (1024, 128), (2048, 64), (4096, 64)]


# 63 cases of 1.6e6 to 3.1e6 words.
@nightly
@pytest.mark.parametrize(("n_samples", "n_chirps"), LENGTHS)
@pytest.mark.parametrize(("scaling", "rounding"), MODES)
def test_a_million_words_equal_model_at_each_length(
    tmp_path, n_samples, n_chirps, scaling, rounding
):
    words = WordLengths(scaling=scaling, rounding=rounding)
    radar = make_radar(n_samples, n_chirps)
    frame = draw_frame(radar, 16, seed=n_samples)
    n_words = compare_compiled_c_with_model(
        tmp_path, frame, radar, dc.Chain(), words, optimisation="-O3"
    )
    assert n_words > 1_000_000


@nightly
def test_reference_scene_equals_model(tmp_path, reference, clean):
    chain = replace(reference.chain, n_range_bins=4096)
    n_words = compare_compiled_c_with_model(
        tmp_path, clean.isel(frame=0), reference.radar, chain, WordLengths()
    )
    assert n_words > 4096 * 128 * 12


@nightly
@pytest.mark.parametrize(("scaling", "rounding"), MODES)
def test_emulated_cortex_m7_equals_model(tmp_path, scaling, rounding):
    words = WordLengths(sample_bits=12, range_bits=18, scaling=scaling, rounding=rounding)
    radar = make_radar(64, 16, n_rx=2)
    frame = draw_frame(radar, 12, seed=5)
    n_words = compare_compiled_c_with_model(
        tmp_path, frame, radar, small_window_chain(), words, on_cortex_m7=True
    )
    assert n_words > 64 * 16 * (2 * 8 + 4)


@nightly
@pytest.mark.parametrize(
    "compiler", [("gcc",), ("clang",), CORTEX_M7_COMPILER], ids=lambda words: words[0]
)
@pytest.mark.parametrize(
    "words",
    [WordLengths(), WordLengths(sample_bits=12, range_bits=20, scaling="none")],
    ids=["32 bits", "64 bits"],
)
def test_compiles_without_warning(tmp_path, compiler, words):
    command = (require_program(compiler[0]), *compiler[1:], *WARNINGS, "-O2", "-c")
    (tmp_path / "objects").mkdir()
    chains = (small_window_chain(), small_window_chain(cfar=RANGE_ONLY))
    for radar, chain in zip((make_radar(64, 16), tdm_radar()), chains, strict=True):
        folder = tmp_path / "c"
        dc.generators.C().write(folder, radar, chain, words)
        for sources in ((), ("-DRADAR_TRACE", folder / "main.c")):
            run_program(*command, folder / "radar.c", *sources, cwd=tmp_path / "objects")


# Names of main.c and radar.c begin with these words as well.
@pytest.mark.parametrize("prefix", ["read", "to", "exit", "next", "split"])
def test_compiles_with_prefixes_of_other_names(tmp_path, prefix):
    dc.fixed_point.write_c(tmp_path, make_radar(64, 16), small_window_chain(), prefix=prefix)
    sources = (f"-D{prefix.upper()}_TRACE", "-I.", "-fsyntax-only", "main.c", f"{prefix}.c")
    run_program(require_program("gcc"), *WARNINGS, *sources, cwd=tmp_path)


@nightly
def test_cmake_builds_check_program(tmp_path):
    radar, chain = make_radar(64, 16), small_window_chain()
    dc.fixed_point.write_c(tmp_path / "c", radar, chain, prefix="front_left")
    dc.fixed_point.write_vectors(tmp_path / "vectors", draw_frame(radar, 16, 1), radar, chain)
    require_program("gcc")
    run_program(require_program("cmake"), "-S", tmp_path / "c", "-B", tmp_path / "build")
    run_program("cmake", "--build", tmp_path / "build")
    output = run_program(tmp_path / "build" / "front_left_check", tmp_path / "vectors")
    assert " words compared, 0 differ" in output


def test_check_program_finds_one_wrong_bit(tmp_path):
    radar, chain = make_radar(64, 16), small_window_chain()
    dc.fixed_point.write_c(tmp_path / "c", radar, chain)
    dc.fixed_point.write_vectors(tmp_path / "vectors", draw_frame(radar, 16, 1), radar, chain)
    compiler, sources = require_program("gcc"), ("-DRADAR_TRACE", "main.c", "radar.c")
    run_program(compiler, "-std=c99", *sources, "-o", tmp_path / "check", cwd=tmp_path / "c")
    file = tmp_path / "vectors" / "power.hex"
    words = file.read_text().split("\n")
    words[700] = f"{int(words[700], 16) ^ 1:012x}"

    for text, status, message in (
        ("\n".join(words), 1, "power, word 701: "),
        ("\n".join(words[:700]), 2, "power.hex: only 700 words"),
        ("\n".join([*words[:5], "xyz", *words[5:]]), 2, "no hexadecimal word in line 6"),
    ):
        file.write_text(text)
        call = [tmp_path / "check", tmp_path / "vectors"]
        result = subprocess.run(call, capture_output=True, check=False, text=True)
        assert result.returncode == status
        assert message in result.stderr


def test_library_needs_neither_other_functions_nor_static_data(tmp_path):
    dc.generators.C().write(tmp_path / "c", make_radar(64, 16), small_window_chain())
    compiler, *options = (require_program(CORTEX_M7_COMPILER[0]), *CORTEX_M7_COMPILER[1:])
    run_program(compiler, *options, "-std=c99", "-O2", "-c", "radar.c", cwd=tmp_path / "c")

    names = run_program("arm-none-eabi-nm", "radar.o", cwd=tmp_path / "c").split("\n")
    kinds = {name: kind for kind, name in (line.split()[-2:] for line in names if line.strip())}

    # 64-bit shifts and divisions of the compiler's own library, and its copy of memory.
    assert all(name.startswith(("__aeabi_", "mem")) for name, kind in kinds.items() if kind == "U")
    assert {name for name, kind in kinds.items() if kind == "T"} == {
        f"radar_{name}" for name in ("initialise", "push_chirp", "finish_frame", "read_detections")
    }
    assert not {"B", "b", "D", "d"} & set(kinds.values())


def test_refuses_cube_whose_words_32_bits_cannot_count():
    radar, chain, words = make_radar(64, 16), small_window_chain(), WordLengths()
    tables = make_lookup_tables(radar, chain.fit_to_radar(radar), words)
    design = Design(radar, chain, words, tables._replace(n_channels=2**20))
    with pytest.raises(dc.InvalidSetting, match="2,147,483,648 words in the buffer"):
        dc.generators.C().render_files(design)


STATES_PROGRAM = r"""
#include <stdio.h>
#include "radar.h"
static radar_state state;
static radar_word cube[RADAR_CUBE_WORDS];
static radar_sample samples[RADAR_CHIRP_WORDS];
static radar_detection found[3];
int main(void)
{
    unsigned k, frame;
    for (k = 0; k < RADAR_CHIRP_WORDS; k += 2) samples[k] = 1000;
    radar_initialise(&state, cube);
    printf("%d ", (int)radar_finish_frame(&state));
    printf("%d ", (int)radar_read_detections(&state, found, 3));
    samples[0] = 2048;
    printf("%d ", (int)radar_push_chirp(&state, samples));
    samples[0] = -2048;
    for (frame = 0; frame < 2; ++frame) {
        size_t n, n_all = 0;
        for (k = 0; k < RADAR_N_CHIRPS_SENT; ++k)
            printf("%d", (int)radar_push_chirp(&state, samples));
        printf(" %d ", (int)radar_push_chirp(&state, samples));
        printf("%d ", (int)radar_finish_frame(&state));
        printf("%d ", (int)radar_finish_frame(&state));
        while ((n = radar_read_detections(&state, found, 3)) > 0) n_all += n;
        printf("%d %d\n", (int)n_all, (int)radar_read_detections(&state, found, 3));
    }
    return 0;
}
"""


def test_states_refuse_calls_out_of_order_and_samples_beyond_their_bits(tmp_path):
    folder = tmp_path / "c"
    radar = make_radar(64, 16)
    dc.generators.C().write(folder, radar, small_window_chain(), WordLengths(sample_bits=12))
    (folder / "states.c").write_text(STATES_PROGRAM)
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    sources = ("states.c", "radar.c", "-o", tmp_path / "states")
    run_program(require_program("gcc"), *WARNINGS, *sanitizers, *sources, cwd=folder)

    first, second = run_program(tmp_path / "states").splitlines()

    # 2: too few chirps; 3: sample too large; 1: too many chirps. The frames are equal: a tone at
    # range 0 and velocity 0, of which a Hann window leaves 2 x 3 strong cells.
    assert first == f"2 0 3 {second}"
    assert second.split()[:4] == ["0" * 16, "1", "0", "2"]
    assert int(second.split()[4]) >= 6
    assert second.split()[5] == "0"
