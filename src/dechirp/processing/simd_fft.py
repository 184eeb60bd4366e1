"""Vectorised twin of `scipy.fft.fft`: transforms of sixteen series at once in vector registers.

Series are interleaved: each point has the real parts of sixteen series, then their imaginary parts.
So a butterfly of any radix is a dozen vector additions without shuffles, which a transform along
one series would need. The code is written in vectors of fixed width, which every processor can
execute: the compiler does not vectorise the loops, as it cannot exclude that points overlap.

Transforms are in place and leave the frequencies in another order, `output_position_of_frequency`.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from dechirp.core.compiled_kernels import kernel
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
    store_vector,
)

RADICES = (8, 5, 4, 3, 2, 7, 11, 13)
"""Factors of the lengths that can be transformed."""

_Complex = tuple[Any, Any]


class Stages(NamedTuple):
    """Stages of a transform of n points, one for each radix."""

    radices: np.ndarray
    """(n_stages,) int64: the largest first, so that the parts after it fit into the L1 cache."""
    twiddles: np.ndarray
    """float32: of all stages in order, cosine and sine alternating."""


@lru_cache(maxsize=32)
def plan_fft_stages(n: int) -> Stages | None:
    """Plan the stages for n points; None if n has a factor that is not in `RADICES`."""
    remaining, radices = n, []
    for radix in RADICES:
        while remaining % radix == 0:
            radices.append(radix)
            remaining //= radix
    if remaining != 1:
        return None
    radices.sort(reverse=True)
    tables, length = [np.empty(0)], n
    for radix in radices:
        part = length // radix
        turns = np.outer(np.arange(part), np.arange(1, radix)) / length
        tables.append(np.exp(-2j * np.pi * turns).ravel().view(float))
        length = part
    stages = Stages(np.array(radices, np.int64), np.concatenate(tables).astype(np.float32))
    for array in stages:
        array.setflags(write=False)
    return stages


@lru_cache(maxsize=32)
def output_position_of_frequency(n: int) -> np.ndarray:
    """Return the point of each frequency after a transform of n points, (n,)."""
    stages = plan_fft_stages(n)
    assert stages is not None
    positions, length, step = np.zeros(n, np.int64), n, 1
    frequency = np.arange(n)
    for radix in stages.radices:
        length //= radix
        positions += frequency // step % radix * length
        step *= radix
    positions.setflags(write=False)
    return positions


def _constant_vector(number: float) -> Any:
    return ir.Constant(VECTOR, [float(np.float32(number))] * WIDTH)


def _shuffle_vectors(builder: Any, a: Any, b: Any, lanes: Sequence[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes))
    return builder.shuffle_vector(a, b, mask)


class _ComplexBuilder:
    """Builder of complex vector arithmetic, with fused multiply-add where possible."""

    def __init__(self, builder: Any) -> None:
        self.builder, self.flags = builder, ["contract"]

    def add_real(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=self.flags)

    def subtract_real(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=self.flags)

    def multiply_real(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=self.flags)

    def sum_and_difference(self, a: _Complex, b: _Complex) -> tuple[_Complex, _Complex]:
        """Return sum and difference."""
        return (
            (self.add_real(a[0], b[0]), self.add_real(a[1], b[1])),
            (self.subtract_real(a[0], b[0]), self.subtract_real(a[1], b[1])),
        )

    def rotate(self, a: _Complex, cosine: Any, sine: Any) -> _Complex:
        """Multiply by c + i s."""
        return (
            self.subtract_real(self.multiply_real(a[0], cosine), self.multiply_real(a[1], sine)),
            self.add_real(self.multiply_real(a[0], sine), self.multiply_real(a[1], cosine)),
        )

    def rotate_back_by_fraction(self, a: _Complex, k: int, n: int) -> _Complex:
        """Rotate by minus k / n cycles."""
        if k == 0:
            return a
        if 4 * k == n:
            return a[1], self.multiply_real(a[0], _constant_vector(-1))
        turn = -2 * math.pi * k / n
        return self.rotate(a, _constant_vector(math.cos(turn)), _constant_vector(math.sin(turn)))

    def weighted_sum(self, start: Any, factors: Sequence[float], vectors: Sequence[Any]) -> Any:
        total = start
        for factor, vector in zip(factors, vectors, strict=True):
            product = self.multiply_real(vector, _constant_vector(factor))
            total = product if total is None else self.add_real(total, product)
        return total

    def transform_few_points(self, points: list[_Complex]) -> list[_Complex]:
        """Transform a few points directly."""
        n = len(points)
        if n == 1:
            return points
        if n % 2 == 0:
            low, high = [], []
            pairs = zip(
                self.transform_few_points(points[0::2]),
                self.transform_few_points(points[1::2]),
                strict=True,
            )
            for k, (even, odd) in enumerate(pairs):
                plus, minus = self.sum_and_difference(even, self.rotate_back_by_fraction(odd, k, n))
                low.append(plus)
                high.append(minus)
            return low + high
        half = range(1, n // 2 + 1)
        pairs_of = [self.sum_and_difference(points[k], points[n - k]) for k in half]
        first = points[0]
        for plus, _ in pairs_of:
            first = self.add_real(first[0], plus[0]), self.add_real(first[1], plus[1])
        out = [first] * n
        for j in half:
            cosines = [math.cos(2 * math.pi * j * k / n) for k in half]
            sines = [math.sin(2 * math.pi * j * k / n) for k in half]
            a = [
                self.weighted_sum(points[0][i], cosines, [plus[i] for plus, _ in pairs_of])
                for i in (0, 1)
            ]
            b = [
                self.weighted_sum(None, sines, [minus[i] for _, minus in pairs_of]) for i in (0, 1)
            ]
            out[j] = self.add_real(a[0], b[1]), self.subtract_real(a[1], b[0])
            out[n - j] = self.subtract_real(a[0], b[1]), self.add_real(a[1], b[0])
        return out


def _build_butterfly(radix: int) -> Callable[..., None]:
    @intrinsic
    def turn(context, work, place, stride, twiddles, first):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            sums = _ComplexBuilder(builder)
            pointers = [element_pointer(context, builder, signature.args[0], values[0], values[1])]
            factors = element_pointer(context, builder, signature.args[3], values[3], values[4])
            for _ in range(radix - 1):
                pointers.append(builder.gep(pointers[-1], [values[2]]))
            imaginary = [builder.gep(pointer, [int64_constant(WIDTH)]) for pointer in pointers]
            x = [
                (load_vector(builder, re), load_vector(builder, im))
                for re, im in zip(pointers, imaginary, strict=True)
            ]
            first, *others = sums.transform_few_points(x)
            turned = [first]
            for k, y in enumerate(others):
                c, s = (
                    broadcast_to_vector(
                        builder, builder.load(builder.gep(factors, [int64_constant(2 * k + part)]))
                    )
                    for part in (0, 1)
                )
                turned.append(sums.rotate(y, c, s))
            for y, re, im in zip(turned, pointers, imaginary, strict=True):
                store_vector(builder, y[0], re)
                store_vector(builder, y[1], im)
            return context.get_dummy_value()

        return types.void(FLOATS, INTEGER, INTEGER, twiddles, INTEGER), code

    return turn


_turn2, _turn3, _turn4, _turn5, _turn7, _turn8, _turn11, _turn13 = (
    _build_butterfly(radix) for radix in sorted(RADICES)
)


@kernel()
def _run_radix_stage(
    work: np.ndarray,
    place: int,
    n_parts: int,
    radix: int,
    part: int,
    twiddles: np.ndarray,
    twiddle: int,
) -> None:
    """Run the stage of one radix on consecutive groups of radix x part points."""
    stride, step = part * POINT, 2 * (radix - 1)
    for stretch in range(n_parts):
        start = place + stretch * radix * stride
        for q in range(part):
            start_q, twiddle_q = start + q * POINT, twiddle + q * step
            if radix == 8:
                _turn8(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 5:
                _turn5(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 4:
                _turn4(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 11:
                _turn11(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 3:
                _turn3(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 2:
                _turn2(work, start_q, stride, twiddles, twiddle_q)
            elif radix == 7:
                _turn7(work, start_q, stride, twiddles, twiddle_q)
            else:
                _turn13(work, start_q, stride, twiddles, twiddle_q)


@kernel()
def fft_sixteen_series_in_place(
    work: np.ndarray, place: int, n: int, radices: np.ndarray, twiddles: np.ndarray
) -> None:
    """Transform n points of sixteen series in place, from an index of `work`, flat float32."""
    if len(radices) == 0:
        return
    first = radices[0]
    part = n // first
    _run_radix_stage(work, place, 1, first, part, twiddles, 0)
    # The groups of the first radix are transformed one by one: 200 of 2200 points stay in L1.
    for group in range(first):
        twiddle, length, n_parts = part * 2 * (first - 1), part, 1
        for radix in radices[1:]:
            _run_radix_stage(
                work,
                place + group * part * POINT,
                n_parts,
                radix,
                length // radix,
                twiddles,
                twiddle,
            )
            length //= radix
            n_parts *= radix
            twiddle += length * 2 * (radix - 1)


def _transpose_vectors(builder: Any, rows: list[Any]) -> list[Any]:
    """Transpose sixteen vectors by swapping squares of decreasing size."""
    size = WIDTH // 2
    while size:
        low = [lane if not lane & size else WIDTH + lane - size for lane in range(WIDTH)]
        high = [lane + size if not lane & size else WIDTH + lane for lane in range(WIDTH)]
        for i in range(WIDTH):
            if not i & size:
                a, b = rows[i], rows[i + size]
                rows[i], rows[i + size] = (
                    _shuffle_vectors(builder, a, b, low),
                    _shuffle_vectors(builder, a, b, high),
                )
        size //= 2
    return rows


def _pointers_to_sixteen_points(
    context: Any, builder: Any, kinds: Sequence[Any], values: Sequence[Any]
) -> list[Any]:
    """Return pointers to sixteen points of an array, at consecutive entries of `places`."""
    places = element_pointer(context, builder, kinds[1], values[1], values[2])
    return [
        element_pointer(
            context,
            builder,
            kinds[0],
            values[0],
            builder.load(builder.gep(places, [int64_constant(i)])),
        )
        for i in range(WIDTH)
    ]


def _build_windowed_point_loader() -> Callable[..., None]:
    @intrinsic
    def run(context, work, place, numbers, start, window, first, weight):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds, sums = signature.args, _ComplexBuilder(builder)
            source = element_pointer(context, builder, kinds[2], values[2], values[3])
            lower, upper = (
                load_vector(builder, builder.gep(source, [int64_constant(i)])) for i in (0, WIDTH)
            )
            taper = load_vector(
                builder, element_pointer(context, builder, kinds[4], values[4], values[5])
            )
            taper = sums.multiply_real(taper, broadcast_to_vector(builder, values[6]))
            target = element_pointer(context, builder, kinds[0], values[0], values[1])
            for part in (0, 1):
                part_values = _shuffle_vectors(builder, lower, upper, range(part, POINT, 2))
                store_vector(
                    builder,
                    sums.multiply_real(part_values, taper),
                    builder.gep(target, [int64_constant(part * WIDTH)]),
                )
            return context.get_dummy_value()

        # Read-only arrays have another type than writable ones.
        kinds = FLOATS, INTEGER, numbers, INTEGER, window, INTEGER, types.float32
        return types.void(*kinds), code

    return run


load_windowed = _build_windowed_point_loader()
"""Set one point to sixteen complex numbers in a row, times a window and one weight.

The numbers lie in `numbers` from `start` on, the window in `window` from `first` on."""


def _build_transposed_point_store() -> Callable[..., None]:
    @intrinsic
    def run(context, out, to, stride, apart, work, places, first):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            target = element_pointer(context, builder, kinds[0], values[0], values[1])
            points = _pointers_to_sixteen_points(context, builder, kinds[4:6], values[4:])
            for part in (0, WIDTH):
                rows = [
                    load_vector(builder, builder.gep(point, [int64_constant(part)]))
                    for point in points
                ]
                row_at = target if part == 0 else builder.gep(target, [values[3]])
                for row in _transpose_vectors(builder, rows):
                    store_vector(builder, row, row_at)
                    row_at = builder.gep(row_at, [values[2]])
            return context.get_dummy_value()

        return types.void(FLOATS, INTEGER, INTEGER, INTEGER, FLOATS, places, INTEGER), code

    return run


store_transposed = _build_transposed_point_store()
"""Set sixteen rows of `out`, one for each series, to sixteen points of `work`.

Those of `work` lie at sixteen of the places, from `first` on. Rows of real parts lie `stride`
floats from each other, those of imaginary parts `apart` behind them: rows at `POINT` and `WIDTH`
are points again, of series that were points."""


def _build_transposed_power_store(*, adds: bool) -> Callable[..., None]:
    @intrinsic
    def run(context, out, to, stride, work, places, first, share):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds, sums = signature.args, _ComplexBuilder(builder)
            target = element_pointer(context, builder, kinds[0], values[0], values[1])
            share, rows = broadcast_to_vector(builder, values[6]), []
            for point in _pointers_to_sixteen_points(context, builder, kinds[3:5], values[3:6]):
                re, im = (
                    load_vector(builder, builder.gep(point, [int64_constant(i)]))
                    for i in (0, WIDTH)
                )
                power = sums.add_real(sums.multiply_real(re, re), sums.multiply_real(im, im))
                rows.append(sums.multiply_real(power, share))
            for row in _transpose_vectors(builder, rows):
                total = sums.add_real(load_vector(builder, target), row) if adds else row
                store_vector(builder, total, target)
                target = builder.gep(target, [values[2]])
            return context.get_dummy_value()

        return (
            types.void(FLOATS, INTEGER, INTEGER, FLOATS, places, INTEGER, types.float32),
            code,
        )

    return run


set_powers, add_powers = (
    _build_transposed_power_store(adds=False),
    _build_transposed_power_store(adds=True),
)
"""Set sixteen rows of `out`, one for each series, to a share of the powers of sixteen points; or
add it to them.

Points as in `recordings`; the row stride is in floats."""
