"""C99 without a library and without dynamic memory, for a microcontroller or a DSP."""

from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from dechirp.core.argument_types import check_argument_types
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.generators.base import (
    BANNER,
    Design,
    Generator,
    code_templates,
    twiddles_by_pair,
)
from dechirp.processing.chain import Chain
from dechirp.processing.fixed_point.coefficients import INTEGER_BITS
from dechirp.processing.fixed_point.fft import max_growth_per_stage
from dechirp.processing.fixed_point.word_lengths import Rounding, WordLengths
from dechirp.radar.radar import Radar

# fmt: off
_RESERVED_WORDS = frozenset({
    "auto", "break", "case", "char", "const", "continue", "default", "do", "double", "else", "enum",
    "extern", "float", "for", "goto", "if", "inline", "int", "long", "register", "restrict",
    "return", "short", "signed", "sizeof", "static", "struct", "switch", "typedef", "union",
    "unsigned", "void", "volatile", "while",
    # Headers of the standard library, which a generated header would hide.
    "assert", "complex", "ctype", "errno", "features", "fenv", "inttypes", "iso646", "limits",
    "locale", "math", "setjmp", "signal", "stdarg", "stdbool", "stddef", "stdint", "stdio",
    "stdlib", "string", "tgmath", "time", "wchar", "wctype",
    # Files and targets of make and CMake.
    "main", "makefile", "all", "check", "clean", "depend", "edit_cache", "help", "install",
    "package", "package_source", "preinstall", "rebuild_cache", "test",
})
# fmt: on
_ROUNDING_TEXTS: dict[Rounding, str] = {
    "convergent": "rounded to the nearest number, halves to even ones; n is at least 1",
    "half-up": "rounded to the nearest number, halves up; n is at least 1",
    "truncate": "rounded down",
}
_MAX_LINE_CHARACTERS = 96


class _Table(NamedTuple):
    """Constant array in the generated code."""

    name: str
    help: str
    type: str
    numbers: np.ndarray

    @property
    def is_complex(self) -> bool:
        """True if the last axis is that of real and imaginary part."""
        return self.numbers.ndim == 2

    @property
    def length(self) -> int:
        """Number of entries."""
        return len(self.numbers)

    @property
    def lines(self) -> list[str]:
        """Initialisers, in lines of limited length."""
        if self.is_complex:
            entries = [f"{{{real}, {imaginary}}}" for real, imaginary in self.numbers]
        else:
            entries = [str(number) for number in self.numbers]
        lines = [""]
        for entry in entries:
            if lines[-1] and len(lines[-1]) + len(entry) + 2 > _MAX_LINE_CHARACTERS:
                lines.append("")
            lines[-1] += f"{' ' if lines[-1] else ''}{entry},"
        return lines


@frozen_dataclass
class C(Generator):
    """C99 source with a test program, for a microcontroller or a DSP."""

    def render_files(self, design: Design) -> dict[str, str]:
        _check_cube_size(design)
        templates, context = code_templates("c_templates"), self._context(design)
        names = {
            f"{self.prefix}.h": "prefix.h",
            f"{self.prefix}.c": "prefix.c",
            f"{self.prefix}_tables.h": "prefix_tables.h",
            **{name: name for name in ("main.c", "Makefile", "CMakeLists.txt")},
        }
        return {
            name: templates.get_template(template).render(context)
            for name, template in names.items()
        }

    def build_products(self) -> frozenset[str]:
        program = f"{self.prefix}_check"
        return frozenset({"build", "*.o", "*.obj", "a.out", program, f"{program}.exe"})

    def reserved_words(self) -> frozenset[str]:
        return _RESERVED_WORDS

    def _context(self, design: Design) -> dict[str, Any]:
        """Return the values of the templates."""
        words, tables = design.words, design.tables
        frame, chirp = design.radar.frame, design.radar.frame.chirp
        window = tables.training_window
        is_complex = design.is_complex
        accumulator_bits = _needed_accumulator_bits(design)
        range_bins, velocity_bins = (
            tables.range_transform.n_bins,
            tables.doppler_transform.n_bins,
        )
        return {
            "name": self.prefix,
            "NAME": self.prefix.upper(),
            "banner": BANNER,
            "settings_lines": _comment_lines(design),
            "words": words,
            "n_samples": chirp.n_samples,
            "n_rx": tables.n_channels // frame.n_slots,
            "n_slots": frame.n_slots,
            "n_chirps": frame.n_chirps,
            "n_range_bins": range_bins,
            "n_rows": tables.n_rows,
            "n_velocity_bins": velocity_bins,
            "n_range_stages": range_bins.bit_length() - 1,
            "n_doppler_stages": velocity_bins.bit_length() - 1,
            "first_searched_row": tables.searched_rows.start,
            "n_searched_rows": design.n_searched_rows,
            "sample_parts": 2 if is_complex else 1,
            "sample_files": ["samples_i", "samples_q"] if is_complex else ["samples"],
            "range_step_m": f"{chirp.range_bins_m(range_bins)[1]:.6g}",
            "velocity_step_m_per_s": f"{_velocity_step(design):.6g}",
            "half_velocity": window.half_velocity,
            "guard_velocity": window.n_guard.velocity,
            "half_range": window.half_range,
            "guard_range": window.n_guard.range,
            "sample_type": _signed_type(words.sample_bits),
            "sample_bits_of_type": _type_bits(words.sample_bits),
            "sample_top": 2 ** (words.sample_bits - 1) - 1,
            "word_type": _signed_type(max(words.range_bits, words.doppler_bits)),
            "twiddle_type": _signed_type(words.twiddle_bits),
            "accumulator_type": "int32_t" if accumulator_bits <= 32 else "int64_t",
            "accumulator_bits_needed": accumulator_bits,
            "max_shift": 31 if accumulator_bits <= 32 else 62,
            "range_product_shift": tables.range_product_right_shift,
            "doppler_product_shift": tables.doppler_product_right_shift,
            "power_left_shift": tables.power_left_shift,
            "factor_shift": tables.factor_shift,
            "range_top": 2 ** (words.range_bits - 1) - 1,
            "doppler_top": 2 ** (words.doppler_bits - 1) - 1,
            "rounding_text": _ROUNDING_TEXTS[words.rounding],
            "traced_stages": _traced_stages(design),
            "tables": _tables(design),
        }


@check_argument_types
def write_c(
    out: str | Path,
    radar: Radar,
    chain: Chain | None = None,
    words: WordLengths | None = None,
    *,
    prefix: str = "radar",
) -> dict[str, Path]:
    """Write the fixed-point chain as C99 into a folder, atomically, and replace an earlier one.

    Parameters
    ----------
    out : str or Path
        The folder.
    radar, chain, words
        As for `fixed_point_map`. Transforms are zero-padded to powers of two, where their lengths
        are not set.
    prefix : str
        Start of all names in the code.

    Returns
    -------
    dict
        Path of each file by its name.

    Raises
    ------
    InvalidSetting
        If settings have no fixed-point form, or the prefix is no C identifier.
    DechirpError
        If the folder holds other files or cannot be written. It is then unchanged.
    """
    return C(prefix=prefix).write(out, radar, chain, words)


def _check_cube_size(design: Design) -> None:
    """Check that 32-bit numbers count the words of the cube."""
    tables = design.tables
    n_words = 2 * tables.n_channels * tables.n_rows * tables.doppler_transform.n_bins
    if n_words >= 2**31:
        raise InvalidSetting(
            "Chain.n_range_bins",
            value=f"{n_words:,} words in the buffer of the corner turn",
            expected=f"fewer than {2**31:,} = 2 x channels x rows x velocity bins",
            fix="take fewer bins of range or velocity, or fewer channels",
        )


def _type_bits(bits: int) -> int:
    return 16 if bits <= 16 else 32


def _signed_type(bits: int) -> str:
    return f"int{_type_bits(bits)}_t"


def _unsigned_type(bits: int) -> str:
    return f"uint{_type_bits(bits)}_t"


def _velocity_step(design: Design) -> float:
    bins = design.radar.frame.velocity_bins_m_per_s(design.tables.doppler_transform.n_bins)
    return float(bins[1] - bins[0]) if len(bins) > 1 else 0.0


def _needed_accumulator_bits(design: Design) -> int:
    """Return the bits of a signed number that holds all products and sums, rounding included.

    A butterfly adds up to (growth x largest part), and half a unit of the last bit kept. Products
    of a window need one bit more, since alignment shifts them by any number of bits: half a unit is
    then larger than the product, up to 2^30 in 32 bits.
    """
    words, tables = design.words, design.tables
    fraction_bits = words.twiddle_bits - INTEGER_BITS
    largest = [2 ** (words.sample_bits - 1) * int(abs(tables.range_window).max()) * 2]
    largest += [2 ** (words.range_bits - 1) * int(abs(tables.doppler_window).max()) * 2]
    for bits, twiddles, transform in (
        (words.range_bits, tables.range_twiddles, tables.range_transform),
        (words.doppler_bits, tables.doppler_twiddles, tables.doppler_transform),
    ):
        growth = max_growth_per_stage(twiddles, transform.n_bins, words.twiddle_bits)
        sums = int(growth.max(initial=1)) * 2 ** (bits - 1)
        largest += [sums + 2 ** (fraction_bits + 1)]
    return max(largest).bit_length() + 1


def _traced_stages(design: Design) -> list[dict[str, Any]]:
    """Return name and bits of the vectors of each stage, in the order of the chain."""
    words = design.words
    bits_of_complex = {
        "range_window": words.range_bits,
        "range_fft": words.range_bits,
        "doppler_window": words.doppler_bits,
        "doppler_fft": words.doppler_bits,
    }
    bits = {f"{name}_{part}": n for name, n in bits_of_complex.items() for part in "iq"}
    if design.tables.range_transform.n_bins > 1:
        bits["range_shifts"] = 2
    bits |= {"doppler_shifts": 2, "power": words.power_bits, "log_power": words.log_bits}
    bits |= {"threshold": words.power_bits, "detected": 1}
    return [{"name": name, "bits": n} for name, n in bits.items()]


def _tables(design: Design) -> list[_Table]:
    """Return the constant arrays."""
    words, tables = design.words, design.tables
    twiddle_type = _signed_type(words.twiddle_bits)
    twiddle_fraction = words.twiddle_bits - INTEGER_BITS
    transforms = {
        "range": (tables.range_twiddles, tables.range_transform),
        "doppler": (tables.doppler_twiddles, tables.doppler_transform),
    }
    weights_and_factors = {
        name: _Table(
            name,
            table.help,
            (_unsigned_type if name == "factors" else _signed_type)(table.bits),
            table.numbers,
        )
        for name, table in design.coefficients.items()
    }
    arrays = []
    for name, (twiddles, transform) in transforms.items():
        cosines, sines = _twiddles_without_ones(twiddles).T
        growth = max_growth_per_stage(twiddles, transform.n_bins, words.twiddle_bits)
        arrays += [
            weights_and_factors[f"{name}_weights"],
            *(
                _Table(
                    f"{name}_{part}",
                    f"{formula} of exp(-2 pi i e / m) of each pair, e = 2 k, k and 3 k for"
                    f" k < m / 4; {twiddle_fraction} fraction bits.",
                    twiddle_type,
                    numbers,
                )
                for part, formula, numbers in (("cosines", "Re", cosines), ("sines", "Im", sines))
            ),
            _Table(
                f"{name}_growth",
                "Largest growth of a part in each stage, 2 or 2 (|Re W| + |Im W|), in words of W.",
                "uint32_t",
                growth if len(growth) else np.ones(1, np.int64),
            ),
        ]
    return [
        *arrays,
        _Table(
            "logarithms",
            f"log2(1 + f) in the middle of each interval of f, {words.log_fraction_bits} bits"
            " behind the point.",
            "uint16_t",
            tables.logarithms,
        ),
        weights_and_factors["factors"],
    ]


def _twiddles_without_ones(twiddles: np.ndarray) -> np.ndarray:
    """Return the factors of each pair of stages one after the other, without its first quarter.

    Compilers vectorise loops over successive factors, but not over every n-th one.
    """
    pairs = [factors[len(factors) // 4 :] for factors in twiddles_by_pair(twiddles).values()]
    return np.concatenate(pairs) if pairs else np.zeros((1, 2), np.int64)


def _comment_lines(design: Design) -> list[str]:
    """Return the lines of the settings, of limited length; none ends the comment."""
    text = design.settings_text + design.words_text
    text = text.replace("*/", "* /").replace("??/", "?? /")
    return [
        part
        for line in text.splitlines()
        for part in wrap(
            line, _MAX_LINE_CHARACTERS, subsequent_indent=" " * 8, break_on_hyphens=False
        )
    ]
