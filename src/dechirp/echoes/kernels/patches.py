"""Small blocks of numbers in vector registers: eight complex numbers, sixteen floats, at once.

The compiler makes vectors of such loops by itself, but asks before each whether the arrays
overlap, which takes as long as the additions. Here they are written as vectors, which every
processor can run, wide or narrow. All arrays are flat and float32, places in floats.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTH = 8
"""Complex numbers that are taken together, rows of a patch, and grid points of a tone."""

_VECTOR = ir.VectorType(ir.FloatType(), 2 * WIDTH)
_FLOATS, _WHOLE = types.Array(types.float32, 1, "C"), types.int64


def _pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    return builder.gep(context.make_array(kind)(context, builder, array).data, [place])


def _load(builder: Any, pointer: Any) -> Any:
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _store(builder: Any, vector: Any, pointer: Any) -> None:
    builder.store(vector, builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _in_turn(builder: Any, *numbers: Any) -> Any:
    """A vector of one number, or of some that take turns."""
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for i in range(2 * WIDTH):
        place = ir.Constant(ir.IntType(32), i)
        vector = builder.insert_element(vector, numbers[i % len(numbers)], place)
    return vector


def _plus(builder: Any, total: Any, a: Any, b: Any) -> Any:
    return builder.fadd(total, builder.fmul(a, b, flags=["contract"]), flags=["contract"])


def _adder(n_rows: int) -> Callable[..., None]:
    @intrinsic
    def add(context, grid, first, stride, rows, line, real, imag):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            zero = ir.Constant(ir.IntType(64), 0)
            points = _pointer(context, builder, signature.args[0], values[0], values[1])
            weights = _pointer(context, builder, signature.args[3], values[3], zero)
            taps = _pointer(context, builder, signature.args[4], values[4], zero)
            both = _in_turn(builder, values[5], values[6])
            scaled = builder.fmul(_load(builder, taps), both)
            for b in range(n_rows):
                weight = builder.load(builder.gep(weights, [ir.Constant(ir.IntType(64), 2 * b)]))
                row = _in_turn(builder, weight)
                _store(builder, _plus(builder, _load(builder, points), row, scaled), points)
                points = builder.gep(points, [values[2]])
            return context.get_dummy_value()

        number = types.float32
        return (
            types.void(_FLOATS, _WHOLE, _WHOLE, _FLOATS, _FLOATS, number, number),
            code,
        )

    return add


add_line, add_patch = _adder(1), _adder(WIDTH)
"""Add real + i imag to one row of a grid, or to WIDTH rows so many floats apart, from a first
place on: times the taps of the row, given twice each, and of the line, given twice each."""


def _summer() -> Callable[..., None]:
    @intrinsic
    def add(context, out, at, grid, first, stride, weights, weights_stride):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            points = _pointer(context, builder, kinds[2], values[2], values[3])
            taps = _pointer(context, builder, kinds[5], values[5], values[1])
            total = builder.fmul(_load(builder, points), _load(builder, taps))
            for _ in range(WIDTH - 1):
                points = builder.gep(points, [values[4]])
                taps = builder.gep(taps, [values[6]])
                total = _plus(builder, total, _load(builder, points), _load(builder, taps))
            _store(builder, total, _pointer(context, builder, kinds[0], values[0], values[1]))
            return context.get_dummy_value()

        return types.void(_FLOATS, _WHOLE, _FLOATS, _WHOLE, _WHOLE, _FLOATS, _WHOLE), code

    return add


weighted = _summer()
"""Set 2 WIDTH floats of the first array, from a place on, to the sum of WIDTH rows of a grid that
are so many floats apart, times weights, of which there are as many rows from that place on."""
