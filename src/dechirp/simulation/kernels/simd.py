"""Vector instructions for small blocks: eight complex numbers, or sixteen floats, at once.

The compiler vectorises such loops, but first checks whether the arrays overlap, which takes as long
as the additions. These functions are explicit vectors, which every processor can execute, wide or
narrow. All arrays are flat and float32; positions count floats.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTH = 8
"""Complex numbers of a vector, rows of a patch, and grid points of a tone."""

_VECTOR = ir.VectorType(ir.FloatType(), 2 * WIDTH)
_FLOATS, _INTEGER = types.Array(types.float32, 1, "C"), types.int64


def _array_element_pointer(
    context: Any, builder: Any, array_type: Any, array: Any, index: Any
) -> Any:
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [index])


def _load_vector(builder: Any, pointer: Any) -> Any:
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _store_vector(builder: Any, vector: Any, pointer: Any) -> None:
    builder.store(vector, builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _vector_of_repeated_numbers(builder: Any, *numbers: Any) -> Any:
    """Return a vector of one repeated number, or of several in turn."""
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for i in range(2 * WIDTH):
        place = ir.Constant(ir.IntType(32), i)
        vector = builder.insert_element(vector, numbers[i % len(numbers)], place)
    return vector


def _multiply_add(builder: Any, total: Any, a: Any, b: Any) -> Any:
    return builder.fadd(total, builder.fmul(a, b, flags=["contract"]), flags=["contract"])


def _make_weighted_row_adder(n_rows: int) -> Callable[..., None]:
    @intrinsic
    def add(context, grid, first, stride, rows, line, real, imag):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            zero = ir.Constant(ir.IntType(64), 0)
            points = _array_element_pointer(
                context, builder, signature.args[0], values[0], values[1]
            )
            weights = _array_element_pointer(context, builder, signature.args[3], values[3], zero)
            taps = _array_element_pointer(context, builder, signature.args[4], values[4], zero)
            both = _vector_of_repeated_numbers(builder, values[5], values[6])
            scaled = builder.fmul(_load_vector(builder, taps), both)
            for b in range(n_rows):
                weight = builder.load(builder.gep(weights, [ir.Constant(ir.IntType(64), 2 * b)]))
                row = _vector_of_repeated_numbers(builder, weight)
                _store_vector(
                    builder,
                    _multiply_add(builder, _load_vector(builder, points), row, scaled),
                    points,
                )
                points = builder.gep(points, [values[2]])
            return context.get_dummy_value()

        number = types.float32
        return (
            types.void(_FLOATS, _INTEGER, _INTEGER, _FLOATS, _FLOATS, number, number),
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
            points = _array_element_pointer(context, builder, kinds[2], values[2], values[3])
            taps = _array_element_pointer(context, builder, kinds[5], values[5], values[1])
            total = builder.fmul(_load_vector(builder, points), _load_vector(builder, taps))
            for _ in range(WIDTH - 1):
                points = builder.gep(points, [values[4]])
                taps = builder.gep(taps, [values[6]])
                total = _multiply_add(
                    builder, total, _load_vector(builder, points), _load_vector(builder, taps)
                )
            _store_vector(
                builder,
                total,
                _array_element_pointer(context, builder, kinds[0], values[0], values[1]),
            )
            return context.get_dummy_value()

        return types.void(_FLOATS, _INTEGER, _FLOATS, _INTEGER, _INTEGER, _FLOATS, _INTEGER), code

    return add


set_weighted_sum = _make_weighted_row_sum()
"""Set 2 WIDTH floats of the first array, from a position on, to the weighted sum of WIDTH rows
of a grid that are `stride` floats apart; the weights have as many rows, from the same position
on."""
