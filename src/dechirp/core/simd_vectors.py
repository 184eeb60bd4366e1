"""Vectors of sixteen floats for compiled loops, which every processor can execute, wide or narrow.

The compiler vectorises such loops by itself only where it can exclude that arrays overlap, and
then in vectors of eight. All arrays are flat and float32; positions count floats.
"""

from typing import Any

from llvmlite import ir
from numba.core import types

WIDTH = 16
"""Floats of a vector."""
POINT = 2 * WIDTH
"""Floats of sixteen complex numbers: their real parts, then their imaginary parts."""

VECTOR = ir.VectorType(ir.FloatType(), WIDTH)
FLOATS, INTEGER = types.Array(types.float32, 1, "C"), types.int64


def element_pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    """Return the pointer to an element of an array of the given type."""
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [place])


def load_vector(builder: Any, pointer: Any) -> Any:
    """Load a vector, from any address."""
    return builder.load(builder.bitcast(pointer, VECTOR.as_pointer()), align=4)


def store_vector(builder: Any, vector: Any, pointer: Any) -> None:
    """Store a vector, at any address."""
    builder.store(vector, builder.bitcast(pointer, VECTOR.as_pointer()), align=4)


def multiply_add(builder: Any, total: Any, a: Any, b: Any) -> Any:
    """Return total + a b, in one instruction."""
    return builder.fadd(total, builder.fmul(a, b, flags=["contract"]), flags=["contract"])


def int64_constant(number: int) -> Any:
    """Return a constant of 64 bits."""
    return ir.Constant(ir.IntType(64), number)


def broadcast_to_vector(builder: Any, number: Any) -> Any:
    """Return a vector of one repeated number."""
    vector = builder.insert_element(
        ir.Constant(VECTOR, ir.Undefined), number, ir.Constant(ir.IntType(32), 0)
    )
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(vector, ir.Constant(VECTOR, ir.Undefined), zeros)
