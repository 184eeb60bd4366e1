"""Verilog-2005 of one sample a clock, for an FPGA."""

import re
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np

from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.generators.base import (
    BANNER,
    Design,
    Generator,
    code_templates,
    twiddles_by_pair,
)
from dechirp.processing.fixed_point.coefficients import INTEGER_BITS
from dechirp.processing.fixed_point.fft import max_growth_per_stage
from dechirp.processing.fixed_point.word_lengths import ROUNDING_CODES, Scaling

_SHIFT_PER_STAGE: dict[Scaling, int] = {"block": -1, "halving": 1, "none": 0}  # -1: by block
_MIN_POINTS = 4
_MODULE_PREFIX = "dechirp_"  # of names in verilog_modules

# Tools that read the files as SystemVerilog reserve the words of the second paragraph as well.
_KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        """
    always and assign automatic begin buf bufif0 bufif1 case casex casez cell cmos config
    deassign default defparam design disable edge else end endcase endconfig endfunction
    endgenerate endmodule endprimitive endspecify endtable endtask event for force forever
    fork function generate genvar highz0 highz1 if ifnone incdir include initial inout input
    instance integer join large liblist library localparam macromodule medium module nand
    negedge nmos nor noshowcancelled not notif0 notif1 or output parameter pmos posedge
    primitive pull0 pull1 pulldown pullup pulsestyle_ondetect pulsestyle_onevent rcmos real
    realtime reg release repeat rnmos rpmos rtran rtranif0 rtranif1 scalared showcancelled
    signed small specify specparam strong0 strong1 supply0 supply1 table task time tran
    tranif0 tranif1 tri tri0 tri1 triand trior trireg unsigned use uwire vectored wait wand
    weak0 weak1 while wire wor xnor xor

    accept_on alias always_comb always_ff always_latch assert assume before bind bins binsof
    bit break byte chandle checker class clocking const constraint context continue cover
    covergroup coverpoint cross dist do endchecker endclass endclocking endgroup endinterface
    endpackage endprogram endproperty endsequence enum eventually expect export extends extern
    final first_match foreach forkjoin global iff ignore_bins illegal_bins implements implies
    import inside int interconnect interface intersect join_any join_none let local logic
    longint matches modport nettype new nexttime null package packed priority program property
    protected pure rand randc randcase randsequence ref reject_on restrict return s_always
    s_eventually s_nexttime s_until s_until_with sequence shortint shortreal soft solve static
    string strong struct super sync_accept_on sync_reject_on tagged this throughout
    timeprecision timeunit type typedef union unique unique0 until until_with untyped var
    virtual void wait_order weak wildcard with within
    """,
    )
)


@frozen_dataclass
class Verilog(Generator):
    """Verilog-2005 of one sample a clock with a test bench, for an FPGA."""

    def render_files(self, design: Design) -> dict[str, str]:
        _check_has_hardware_form(design)
        name, templates = self.prefix, code_templates("verilog_templates")
        context = {"banner": BANNER, "name": name, **_top_level_context(design)}
        texts = {
            f"{name}.v": templates.get_template("prefix.v").render(context),
            f"test_{name}.v": templates.get_template("test_prefix.v").render(context),
            f"{name}_twiddles.v": templates.get_template("prefix_twiddles.v").render(
                context | _twiddle_context(design)
            ),
        }
        for table in _table_contexts(design):
            text = templates.get_template("prefix_table.v").render(context | table)
            texts[f"{name}_{table['table']}.v"] = text
        modules = files("dechirp.generators").joinpath("verilog_modules")
        for module in sorted(modules.iterdir(), key=lambda file: file.name):
            text = module.read_text(encoding="utf-8").replace(_MODULE_PREFIX, f"{name}_")
            texts[f"{name}_{module.name}"] = f"// {BANNER}\n//\n{text}"
        return texts

    def build_products(self) -> frozenset[str]:
        return frozenset({f"{self.prefix}_check", "*.vvp", "*.vcd", "a.out", "build", "obj_dir"})

    def reserved_words(self) -> frozenset[str]:
        return _KEYWORDS | _names_in_modules()


@cache
def _names_in_modules() -> frozenset[str]:
    """Return the names of signals, instances and tasks, in lower case.

    A module of the same name hides them, or is found instead of them.
    """
    folder = files("dechirp.generators")
    texts = [
        file.read_text(encoding="utf-8")
        for name in ("verilog_modules", "verilog_templates")
        for file in folder.joinpath(name).iterdir()
        if file.name.endswith(".v")
    ]
    code = re.sub(r"//.*|\"[^\"\n]*\"|{%.*?%}|{{.*?}}", " ", "\n".join(texts))
    return frozenset(name.lower() for name in re.findall(r"[A-Za-z]\w*", code))


def _check_has_hardware_form(design: Design) -> None:
    """Check that the pipeline can process transforms of these lengths."""
    tables = design.tables
    for name, transform in (
        ("n_range_bins", tables.range_transform),
        ("n_velocity_bins", tables.doppler_transform),
    ):
        if transform.n_bins < _MIN_POINTS:
            raise InvalidSetting(
                f"Chain.{name}",
                value=transform.n_bins,
                expected=f"at least {_MIN_POINTS} in Verilog",
                fix=f"pad with zeros: set {name} to {_MIN_POINTS}",
            )


def _address_bits(n_words: int) -> int:
    return (n_words - 1).bit_length()


def _round_up_to_bytes(bits: int) -> int:
    return 8 * -(-bits // 8)


def _top_level_context(design: Design) -> dict[str, Any]:
    """Return the values of the top level and of the test bench."""
    words, tables = design.words, design.tables
    window = tables.training_window
    is_complex, n_searched = design.is_complex, design.n_searched_rows
    data_in_bits = words.sample_bits * (2 if is_complex else 1)
    range_index_bits = _address_bits(tables.range_transform.n_bins)
    velocity_bits = _address_bits(tables.doppler_transform.n_bins)
    row_bits = max(1, _address_bits(tables.n_rows))
    channel_bits = _address_bits(tables.n_channels)
    chirp_bits = max(1, _address_bits(tables.doppler_transform.n_points))
    n_transforms = tables.n_rows * tables.n_channels
    parameters = {
        "SAMPLE_BITS": words.sample_bits,
        "COMPLEX_SAMPLES": int(is_complex),
        "WINDOW_BITS": words.window_bits,
        "TWIDDLE_BITS": words.twiddle_bits,
        "RANGE_BITS": words.range_bits,
        "DOPPLER_BITS": words.doppler_bits,
        "POWER_BITS": words.power_bits,
        "FACTOR_BITS": words.factor_bits,
        "SCALING_SHIFT": _SHIFT_PER_STAGE[words.scaling],
        "ROUNDING": ROUNDING_CODES[words.rounding],
        "EXPONENT_BITS": (2 * max(range_index_bits, velocity_bits)).bit_length(),
        "N_SAMPLES": tables.range_transform.n_points,
        "N_CHANNELS": tables.n_channels,
        "N_CHIRPS": tables.doppler_transform.n_points,
        "RANGE_INDEX_BITS": range_index_bits,
        "DOPPLER_INDEX_BITS": velocity_bits,
        "N_ROWS": tables.n_rows,
        "ROW_BITS": row_bits,
        "FIRST_SEARCHED": tables.searched_rows.start,
        "N_SEARCHED": n_searched,
        "SEARCHED_BITS": max(1, _address_bits(n_searched)),
        "CHANNEL_ADDRESS_BITS": channel_bits,
        "CHIRP_ADDRESS_BITS": chirp_bits,
        "RANGE_SHIFT": tables.range_product_right_shift,
        "DOPPLER_SHIFT": tables.doppler_product_right_shift,
        "POWER_SHIFT": -tables.power_left_shift,
        "HALF_RANGE": window.half_range,
        "HALF_VELOCITY": window.half_velocity,
        "GUARD_RANGE": window.n_guard.range,
        "GUARD_VELOCITY": window.n_guard.velocity,
        "FACTOR_SHIFT": tables.factor_shift,
        "TRANSFORM_BITS": (transform_bits := _address_bits(n_transforms)),
    }
    return {
        "parameters": parameters,
        "n_samples": tables.range_transform.n_points,
        "n_channels": tables.n_channels,
        "n_chirps": tables.doppler_transform.n_points,
        "range_limits": _block_scaling_limits(
            tables.range_twiddles, range_index_bits, words.range_bits, words.twiddle_bits
        ),
        "doppler_limits": _block_scaling_limits(
            tables.doppler_twiddles, velocity_bits, words.doppler_bits, words.twiddle_bits
        ),
        "is_complex": is_complex,
        "sample_bits": words.sample_bits,
        "range_bits": words.range_bits,
        "doppler_bits": words.doppler_bits,
        "power_bits": words.power_bits,
        "data_in_bits": data_in_bits,
        "sample_stream_bits": _round_up_to_bytes(data_in_bits),
        "cell_stream_bits": _round_up_to_bytes(2 * words.power_bits + 1),
        "velocity_bits": velocity_bits,
        "user_bits": range_index_bits + velocity_bits,
        "user_stream_bits": _round_up_to_bytes(range_index_bits + velocity_bits),
        "bank_words": tables.n_rows << (channel_bits + chirp_bits),
        "spectrum_words": n_transforms << velocity_bits if words.scaling == "block" else 0,
        "spectrum_address_bits": transform_bits + velocity_bits,
        "address_bits": 1 + row_bits + channel_bits + chirp_bits,
    }


def _block_scaling_limits(twiddles: np.ndarray, n_stages: int, bits: int, twiddle_bits: int) -> str:
    """Return the largest parts that need no shift, and one of a single bit, in each stage.

    In one hexadecimal word, the first stage lowest.
    """
    largest_word, fraction_bits = 2 ** (bits - 1) - 1, twiddle_bits - INTEGER_BITS
    packed = 0
    for stage, growth in enumerate(max_growth_per_stage(twiddles, 2**n_stages, twiddle_bits)):
        for shift in range(2):
            limit = (largest_word << (fraction_bits + shift)) // int(growth)
            packed |= limit << ((2 * stage + shift) * bits)
    n_bits = 2 * n_stages * bits
    return f"{n_bits}'h{packed:0{-(-n_bits // 4)}x}"


def _table_contexts(design: Design) -> list[dict[str, Any]]:
    """Return the values of each table of weights or factors."""
    tables = design.tables
    n_addresses = {
        "range_weights": tables.range_transform.n_bins,
        "doppler_weights": tables.doppler_transform.n_bins,
        "factors": design.n_searched_rows,
    }
    return [
        {
            "table": name,
            "help": table.help,
            "address_bits": max(1, _address_bits(n_addresses[name])),
            "bits": table.bits,
            "digits": -(-table.bits // 4),
            "words": [int(number) & ((1 << table.bits) - 1) for number in table.numbers],
        }
        for name, table in design.coefficients.items()
    ]


def _twiddle_context(design: Design) -> dict[str, Any]:
    """Return the values of the table of twiddle factors, by address bits."""
    tables, part_bits = design.tables, design.words.twiddle_bits
    by_pair = twiddles_by_pair(tables.range_twiddles) | twiddles_by_pair(tables.doppler_twiddles)
    pairs = {
        _address_bits(n_points): [_join_parts(factor, part_bits) for factor in factors]
        for n_points, factors in sorted(by_pair.items())
    }
    return {"bits": 2 * part_bits, "digits": -(-2 * part_bits // 4), "pairs": pairs}


def _join_parts(factor: np.ndarray, bits: int) -> int:
    """Return imaginary and real part in one word, the imaginary part in the upper half."""
    mask = (1 << bits) - 1
    real, imaginary = (int(part) & mask for part in factor)
    return imaginary << bits | real
