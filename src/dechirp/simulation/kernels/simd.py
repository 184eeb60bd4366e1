"""Vector instructions for small blocks: eight complex numbers, or sixteen floats, at once.

The compiler vectorises such loops, but first checks whether the arrays overlap, which takes as long
as the additions, and keeps no sums in registers. These functions are explicit vectors, which every
processor can execute, wide or narrow. All arrays are flat; positions count numbers.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from dechirp.core.simd_vectors import (
    FLOATS,
    INTEGER,
    VECTOR,
    element_pointer,
    load_vector,
    multiply_add,
    store_vector,
)

WIDTH = 8
"""Complex numbers of a vector, rows of a patch, and grid points of a tone."""
VECTOR_BYTES = 64
"""Size of a vector: sixteen floats, or eight doubles."""


def _vector_of_repeated_numbers(builder: Any, *numbers: Any) -> Any:
    """Return a vector of one repeated number, or of several in turn."""
    vector = ir.Constant(VECTOR, ir.Undefined)
    for i in range(2 * WIDTH):
        place = ir.Constant(ir.IntType(32), i)
        vector = builder.insert_element(vector, numbers[i % len(numbers)], place)
    return vector


def _make_weighted_row_adder(n_rows: int) -> Callable[..., None]:
    @intrinsic
    def add(context, grid, first, stride, rows, line, real, imag):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            zero = ir.Constant(ir.IntType(64), 0)
            points = element_pointer(context, builder, signature.args[0], values[0], values[1])
            weights = element_pointer(context, builder, signature.args[3], values[3], zero)
            taps = element_pointer(context, builder, signature.args[4], values[4], zero)
            both = _vector_of_repeated_numbers(builder, values[5], values[6])
            scaled = builder.fmul(load_vector(builder, taps), both)
            for b in range(n_rows):
                weight = builder.load(builder.gep(weights, [ir.Constant(ir.IntType(64), 2 * b)]))
                row = _vector_of_repeated_numbers(builder, weight)
                store_vector(
                    builder,
                    multiply_add(builder, load_vector(builder, points), row, scaled),
                    points,
                )
                points = builder.gep(points, [values[2]])
            return context.get_dummy_value()

        number = types.float32
        return (
            types.void(FLOATS, INTEGER, INTEGER, FLOATS, FLOATS, number, number),
            code,
        )

    return add


add_line, add_patch = _make_weighted_row_adder(1), _make_weighted_row_adder(WIDTH)
"""Add real + i imag to one row of a grid (`add_line`), or to WIDTH rows `stride` floats apart
(`add_patch`), from the position `first` on: times the taps of the row, each given twice, and of
the line, each given twice."""


def _make_weighted_row_sum() -> Callable[..., None]:
    @intrinsic
    def add(context, out, at, grid, first, stride, weights, weights_stride):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            points = element_pointer(context, builder, kinds[2], values[2], values[3])
            taps = element_pointer(context, builder, kinds[5], values[5], values[1])
            total = builder.fmul(load_vector(builder, points), load_vector(builder, taps))
            for _ in range(WIDTH - 1):
                points = builder.gep(points, [values[4]])
                taps = builder.gep(taps, [values[6]])
                total = multiply_add(
                    builder, total, load_vector(builder, points), load_vector(builder, taps)
                )
            store_vector(
                builder,
                total,
                element_pointer(context, builder, kinds[0], values[0], values[1]),
            )
            return context.get_dummy_value()

        return types.void(FLOATS, INTEGER, FLOATS, INTEGER, INTEGER, FLOATS, INTEGER), code

    return add


set_weighted_sum = _make_weighted_row_sum()
"""Set 2 WIDTH floats of the first array, from a position on, to the weighted sum of WIDTH rows
of a grid that are `stride` floats apart; the weights have as many rows, from the same position
on."""


def _make_complex_product_sum(n_sums: int) -> Callable[..., None]:
    @intrinsic
    def add(context, sums, at, pitch, factors, first, factor_pitch, tables, start, table_pitch, n):  # type: ignore[no-untyped-def] # noqa: ANN001
        number = sums.dtype
        n_lanes = 8 * VECTOR_BYTES // number.bitwidth

        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            vector_type = ir.VectorType(context.get_value_type(number), n_lanes)
            undefined = ir.Constant(vector_type, ir.Undefined)
            zeros = ir.Constant(vector_type, [0.0] * n_lanes)
            first_lane = ir.Constant(ir.VectorType(ir.IntType(32), n_lanes), [0] * n_lanes)

            def point(array: int) -> Any:
                return element_pointer(
                    context, builder, kinds[array], values[array], values[array + 1]
                )

            def load(place: Any) -> Any:
                vector = builder.bitcast(place, vector_type.as_pointer())
                return builder.load(vector, align=number.bitwidth // 8)

            def repeat(place: Any) -> Any:
                zero = ir.Constant(ir.IntType(32), 0)
                single = builder.insert_element(undefined, builder.load(place), zero)
                return builder.shuffle_vector(single, undefined, first_lane)

            def add_product(total: Any, a: Any, b: Any) -> None:
                builder.store(multiply_add(builder, builder.load(total), a, b), total)

            # These places are registers in the compiled code.
            totals = [cgutils.alloca_once(builder, vector_type) for _ in range(2 * n_sums)]  # type: ignore[no-untyped-call]
            for total in totals:
                builder.store(zeros, total)
            with cgutils.for_range(builder, values[9]) as term:
                row = builder.add(term.index, term.index)
                table = builder.gep(point(6), [builder.mul(row, values[8])])
                real, imag = load(table), load(builder.gep(table, [values[8]]))
                minus_imag = builder.fneg(imag)
                factor = builder.gep(point(3), [builder.mul(row, values[5])])
                for m in range(n_sums):
                    a, b = repeat(factor), repeat(builder.gep(factor, [values[5]]))
                    add_product(totals[2 * m], a, real)
                    add_product(totals[2 * m], b, minus_imag)
                    add_product(totals[2 * m + 1], a, imag)
                    add_product(totals[2 * m + 1], b, real)
                    factor = builder.gep(factor, [ir.Constant(ir.IntType(64), 1)])
            place = point(0)
            for total in totals:
                vector = builder.bitcast(place, vector_type.as_pointer())
                builder.store(builder.load(total), vector, align=number.bitwidth // 8)
                place = builder.gep(place, [values[2]])
            return context.get_dummy_value()

        arrays = [(array, INTEGER, INTEGER) for array in (sums, factors, tables)]
        return types.void(*arrays[0], *arrays[1], *arrays[2], INTEGER), code

    return add


set_eight_complex_sums, set_two_complex_sums = map(_make_complex_product_sum, (WIDTH, 2))
"""Set eight or two vectors, each the sum of `n` complex factors times vectors of a table, float32
or float64. Three arrays with a position and a pitch each: sums, factors and tables. Real and
imaginary parts alternate, a pitch apart: of the sums, of terms of the table, and of factors, of
which those of the sums are adjacent. The sums stay in registers over all terms, eight of them on
processors with 32 registers of 64 bytes; others hold some in the L1 cache, as fast as before."""
