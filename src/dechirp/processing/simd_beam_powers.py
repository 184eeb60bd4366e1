"""Compiled loop of `simd_beamforming`: largest beam powers, with all sums in vector registers.

Sixteen ranges at a time, and four directions with their mirror images: sixteen sums stay in
registers where a processor has 32 of 64 bytes, and each term is loaded once for eight products.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from dechirp.core.compiled_kernels import IN_CALLER, kernel
from dechirp.core.simd_vectors import (
    FLOATS,
    INTEGER,
    POINT,
    VECTOR,
    WIDTH,
    broadcast_to_vector,
    element_pointer,
    int64_constant,
    load_vector,
    multiply_add,
    store_vector,
)

GROUP = 4
"""Pairs of mirrored directions that are computed together."""
BLOCK = 4 * WIDTH
"""Ranges per block: the powers of 87 azimuths, 22 KiB, stay in the L1 cache."""

_INTEGERS = types.Array(types.int64, 1, "C")
_FLAGS = ["contract"]


def _allocate_sums(builder: Any, n: int) -> list[Any]:
    """Return pointers to vectors of zeros, which the compiler keeps in registers."""
    with builder.goto_entry_block():  # else they stay in memory
        sums = [builder.alloca(VECTOR) for _ in range(n)]
    for total in sums:
        builder.store(ir.Constant(VECTOR, [0.0] * WIDTH), total)
    return sums


def _add_product(builder: Any, total: Any, a: Any, b: Any) -> None:
    builder.store(multiply_add(builder, builder.load(total), a, b), total)


def _build_rotated_sum() -> Callable[..., None]:
    @intrinsic
    def run(context, terms, to, spectrum, start, imaginary, offsets, factors, first, last):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            real_sum, imaginary_sum = _allocate_sums(builder, 2)
            row = element_pointer(context, builder, kinds[2], values[2], values[3])
            row_offsets = element_pointer(context, builder, kinds[5], values[5], int64_constant(0))
            numbers = element_pointer(context, builder, kinds[6], values[6], int64_constant(0))
            with cgutils.for_range(builder, values[8], start=values[7]) as loop:
                pair = builder.gep(numbers, [builder.mul(loop.index, int64_constant(2))])
                real, imag = (
                    builder.load(builder.gep(pair, [int64_constant(part)])) for part in (0, 1)
                )
                place = builder.gep(row, [builder.load(builder.gep(row_offsets, [loop.index]))])
                x, y = (
                    load_vector(builder, place),
                    load_vector(builder, builder.gep(place, [values[4]])),
                )
                c, s = (broadcast_to_vector(builder, number) for number in (real, imag))
                minus_s = broadcast_to_vector(builder, builder.fneg(imag))
                for total, a, b in (
                    (real_sum, c, x),
                    (real_sum, minus_s, y),
                    (imaginary_sum, c, y),
                    (imaginary_sum, s, x),
                ):
                    _add_product(builder, total, a, b)
            target = element_pointer(context, builder, kinds[0], values[0], values[1])
            for part, total in enumerate((real_sum, imaginary_sum)):
                pointer = builder.gep(target, [int64_constant(part * WIDTH)])
                store_vector(builder, builder.load(total), pointer)
            return context.get_dummy_value()

        # Read-only arrays have another type than writable ones.
        kinds = FLOATS, INTEGER, spectrum, INTEGER, INTEGER, offsets, FLOATS, INTEGER, INTEGER
        return types.void(*kinds), code

    return run


_set_rotated_sum = _build_rotated_sum()
"""Set sixteen complex terms to a sum of rows of a spectrum times complex factors.

Entries `first` to `last` give the offsets of the rows and the factors, real and imaginary
parts in turn; imaginary parts of a row lie `imaginary` floats behind the real ones."""


def _build_beam_powers_of_group() -> Callable[..., None]:
    @intrinsic
    def run(context, largest, start, direct, mirrored, first, terms, weights, at, n):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            # P and Q of each direction, real and imaginary parts.
            sums = _allocate_sums(builder, 4 * GROUP)
            all_terms = element_pointer(context, builder, kinds[5], values[5], int64_constant(0))
            all_weights = element_pointer(context, builder, kinds[6], values[6], values[7])
            with cgutils.for_range(builder, values[8]) as loop:
                point = builder.gep(all_terms, [builder.mul(loop.index, int64_constant(2 * POINT))])
                factors = builder.gep(
                    all_weights, [builder.mul(loop.index, int64_constant(2 * GROUP))]
                )
                parts = [
                    load_vector(builder, builder.gep(point, [int64_constant(i * WIDTH)]))
                    for i in range(4)
                ]
                for i in range(2 * GROUP):
                    factor = builder.load(builder.gep(factors, [int64_constant(i)]))
                    weight, is_q = broadcast_to_vector(builder, factor), i // GROUP
                    for part in (0, 1):
                        total = sums[4 * (i % GROUP) + 2 * is_q + part]
                        _add_product(builder, total, weight, parts[2 * is_q + part])
            powers = element_pointer(context, builder, kinds[0], values[0], values[1])
            for i in range(GROUP):
                p, ip, q, iq = (builder.load(total) for total in sums[4 * i : 4 * i + 4])
                plus = builder.fsub(p, iq, flags=_FLAGS), builder.fadd(ip, q, flags=_FLAGS)
                minus = builder.fadd(p, iq, flags=_FLAGS), builder.fsub(ip, q, flags=_FLAGS)
                for k, (real, imag) in ((2, plus), (3, minus)):
                    rows = element_pointer(context, builder, kinds[k], values[k], values[4])
                    row = builder.load(builder.gep(rows, [int64_constant(i)]))
                    target = builder.gep(powers, [row])
                    square = builder.fmul(real, real, flags=_FLAGS)
                    power = multiply_add(builder, square, imag, imag)
                    old = load_vector(builder, target)
                    is_larger = builder.fcmp_ordered(">", power, old)
                    store_vector(builder, builder.select(is_larger, power, old), target)
            return context.get_dummy_value()

        kinds = FLOATS, INTEGER, _INTEGERS, _INTEGERS, INTEGER, FLOATS, weights, INTEGER, INTEGER
        return types.void(*kinds), code

    return run


_raise_to_powers_of_group = _build_beam_powers_of_group()
"""Raise powers of sixteen ranges to those of the beams P + iQ and P - iQ of a group.

Their rows lie at the entries of `direct` and `mirrored` from `first` on. `terms` are n terms
of P and Q in turn, `weights` from `at` on the weights of a group for each of them."""


@kernel(plain=IN_CALLER)
def raise_to_powers_of_groups(
    power: np.ndarray,
    spectrum: np.ndarray,
    compensation: np.ndarray,
    channels: np.ndarray,
    products: np.ndarray,
    starts: np.ndarray,
    weights: np.ndarray,
) -> None:
    """Raise powers to those of beams, as `simd_beamforming.raise_to_largest_beam_power`.

    Parameters
    ----------
    power, spectrum, compensation
        As there, with at least sixteen ranges.
    channels : array (n_entries,) int64
        Channel of each entry of `pair_sums` that is not zero, term by term.
    products : array (n_entries,) complex64
        These entries.
    starts : array (2 n + 1,) int64
        First entry of each term, of P and Q in turn, and the number of entries.
    weights : array (n_groups, n, 2, 4) float32
        Of four pairs of directions for the terms of P, then of Q.
    """
    n_velocities, n_channels, _, n_ranges = spectrum.shape
    n_groups, n = weights.shape[:2]
    numbers, flat_weights = spectrum.reshape(-1), weights.reshape(-1)
    offsets = channels * (2 * n_ranges)
    azimuths = np.arange(n_groups * GROUP) % len(power)
    direct, mirrored = azimuths * BLOCK, (len(power) - 1 - azimuths) * BLOCK
    factors = np.empty(2 * len(channels), np.float32)
    terms = np.empty(2 * n * POINT, np.float32)
    largest = np.empty(len(power) * BLOCK, np.float32)
    for block in range(0, n_ranges, BLOCK):
        first = min(block, n_ranges - WIDTH)
        size = min(BLOCK, n_ranges - first)
        largest[:] = 0
        for v in range(n_velocities):
            for i in range(len(channels)):
                factor = compensation[v, channels[i]] * products[i]
                factors[2 * i], factors[2 * i + 1] = factor.real, factor.imag
            start = v * n_channels * 2 * n_ranges + first
            for column in range(0, size, WIDTH):
                # The last ones are sixteen, too: some are computed twice, with the same result.
                offset = min(column, size - WIDTH)
                for term in range(2 * n):
                    _set_rotated_sum(
                        terms, term * POINT, numbers, start + offset, n_ranges, offsets, factors,
                        starts[term], starts[term + 1],
                    )  # fmt: skip
                for group in range(n_groups):
                    _raise_to_powers_of_group(
                        largest, offset, direct, mirrored, group * GROUP, terms, flat_weights,
                        group * n * 2 * GROUP, n,
                    )  # fmt: skip
        for azimuth in range(len(power)):
            for i in range(size):
                power[azimuth, first + i] = max(
                    power[azimuth, first + i], largest[azimuth * BLOCK + i]
                )
