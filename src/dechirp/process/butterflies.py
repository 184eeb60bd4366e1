"""Discrete Fourier transforms of sixteen series at once, in vector registers.

Series lie side by side: at each point the real parts of sixteen, then their imaginary parts. So
a butterfly of any radix is a dozen vector additions without any shuffle, where a transform along
one series must turn numbers within vectors. Written as vectors, which every processor can run,
wide or narrow: the compiler by itself would ask whether the points overlap, and not begin.

Transforms are in place and leave their frequencies in another order, `order_of`: whoever takes
them picks rows by it.
"""

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

WIDTH = 16
"""Series that are transformed together; a point of them takes twice as many floats."""
POINT = 2 * WIDTH

RADICES = (8, 5, 4, 3, 2, 7, 11, 13)
"""Factors of the lengths that can be transformed."""

_VECTOR = ir.VectorType(ir.FloatType(), WIDTH)
_FLOATS, _WHOLE = types.Array(types.float32, 1, "C"), types.int64
_Complex = tuple[Any, Any]


class Stages(NamedTuple):
    """A transform of n points, radix by radix."""

    radices: np.ndarray
    """(n_stages,) int64: the largest first, for the parts after it to fit into L1."""
    twiddles: np.ndarray
    """float32: of all stages, one after the other, cosine and sine in turn."""


@lru_cache(maxsize=32)
def stages_of(n: int) -> Stages | None:
    """How n points are transformed; none where n has a factor that is not among `RADICES`."""
    left, radices = n, []
    for radix in RADICES:
        while left % radix == 0:
            radices.append(radix)
            left //= radix
    if left != 1:
        return None
    radices.sort(reverse=True)
    tables, length = [np.empty(0)], n
    for radix in radices:
        part = length // radix
        turns = np.outer(np.arange(part), np.arange(1, radix)) / length
        tables.append(np.exp(-2j * np.pi * turns).ravel().view(float))
        length = part
    kept = Stages(np.array(radices, np.int64), np.concatenate(tables).astype(np.float32))
    for array in kept:
        array.setflags(write=False)
    return kept


@lru_cache(maxsize=32)
def order_of(n: int) -> np.ndarray:
    """At which point each frequency lies after a transform of n points, (n,)."""
    stages = stages_of(n)
    assert stages is not None
    at, length, step = np.zeros(n, np.int64), n, 1
    frequency = np.arange(n)
    for radix in stages.radices:
        length //= radix
        at += frequency // step % radix * length
        step *= radix
    at.setflags(write=False)
    return at


def _pointer(context: Any, builder: Any, kind: Any, array: Any, place: Any) -> Any:
    data = context.make_array(kind)(context, builder, array).data
    return builder.gep(data, [place])


def _load(builder: Any, pointer: Any) -> Any:
    return builder.load(builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _store(builder: Any, vector: Any, pointer: Any) -> None:
    builder.store(vector, builder.bitcast(pointer, _VECTOR.as_pointer()), align=4)


def _whole(number: int) -> Any:
    return ir.Constant(ir.IntType(64), number)


def _constant(number: float) -> Any:
    return ir.Constant(_VECTOR, [float(np.float32(number))] * WIDTH)


def _everywhere(builder: Any, number: Any) -> Any:
    one = builder.insert_element(
        ir.Constant(_VECTOR, ir.Undefined), number, ir.Constant(ir.IntType(32), 0)
    )
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)


def _mixed(builder: Any, a: Any, b: Any, places: Sequence[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), list(places))
    return builder.shuffle_vector(a, b, mask)


class _Sums:
    """Complex vectors, with products that may be fused into sums."""

    def __init__(self, builder: Any) -> None:
        self.builder, self.flags = builder, ["contract"]

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b, flags=self.flags)

    def less(self, a: Any, b: Any) -> Any:
        return self.builder.fsub(a, b, flags=self.flags)

    def times(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b, flags=self.flags)

    def both(self, a: _Complex, b: _Complex) -> tuple[_Complex, _Complex]:
        """Sum and difference."""
        return (
            (self.add(a[0], b[0]), self.add(a[1], b[1])),
            (self.less(a[0], b[0]), self.less(a[1], b[1])),
        )

    def turned(self, a: _Complex, c: Any, s: Any) -> _Complex:
        """Times c + i s."""
        return (
            self.less(self.times(a[0], c), self.times(a[1], s)),
            self.add(self.times(a[0], s), self.times(a[1], c)),
        )

    def on_by(self, a: _Complex, k: int, n: int) -> _Complex:
        """Turned back by k of n parts of a cycle."""
        if k == 0:
            return a
        if 4 * k == n:
            return a[1], self.times(a[0], _constant(-1))
        turn = -2 * math.pi * k / n
        return self.turned(a, _constant(math.cos(turn)), _constant(math.sin(turn)))

    def weighted(self, start: Any, factors: Sequence[float], vectors: Sequence[Any]) -> Any:
        total = start
        for factor, vector in zip(factors, vectors, strict=True):
            product = self.times(vector, _constant(factor))
            total = product if total is None else self.add(total, product)
        return total

    def transform(self, x: list[_Complex]) -> list[_Complex]:
        """Discrete Fourier transform of a few points, straight on."""
        n = len(x)
        if n == 1:
            return x
        if n % 2 == 0:
            low, high = [], []
            pairs = zip(self.transform(x[0::2]), self.transform(x[1::2]), strict=True)
            for k, (even, odd) in enumerate(pairs):
                plus, minus = self.both(even, self.on_by(odd, k, n))
                low.append(plus)
                high.append(minus)
            return low + high
        half = range(1, n // 2 + 1)
        pairs_of = [self.both(x[k], x[n - k]) for k in half]
        first = x[0]
        for plus, _ in pairs_of:
            first = self.add(first[0], plus[0]), self.add(first[1], plus[1])
        out = [first] * n
        for j in half:
            cosines = [math.cos(2 * math.pi * j * k / n) for k in half]
            sines = [math.sin(2 * math.pi * j * k / n) for k in half]
            a = [self.weighted(x[0][i], cosines, [plus[i] for plus, _ in pairs_of]) for i in (0, 1)]
            b = [self.weighted(None, sines, [minus[i] for _, minus in pairs_of]) for i in (0, 1)]
            out[j] = self.add(a[0], b[1]), self.less(a[1], b[0])
            out[n - j] = self.less(a[0], b[1]), self.add(a[1], b[0])
        return out


def _butterfly(radix: int) -> Callable[..., None]:
    @intrinsic
    def turn(context, work, place, stride, twiddles, first):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            sums = _Sums(builder)
            pointers = [_pointer(context, builder, signature.args[0], values[0], values[1])]
            factors = _pointer(context, builder, signature.args[3], values[3], values[4])
            for _ in range(radix - 1):
                pointers.append(builder.gep(pointers[-1], [values[2]]))
            imaginary = [builder.gep(pointer, [_whole(WIDTH)]) for pointer in pointers]
            x = [
                (_load(builder, re), _load(builder, im))
                for re, im in zip(pointers, imaginary, strict=True)
            ]
            first, *others = sums.transform(x)
            turned = [first]
            for k, y in enumerate(others):
                c, s = (
                    _everywhere(builder, builder.load(builder.gep(factors, [_whole(2 * k + part)])))
                    for part in (0, 1)
                )
                turned.append(sums.turned(y, c, s))
            for y, re, im in zip(turned, pointers, imaginary, strict=True):
                _store(builder, y[0], re)
                _store(builder, y[1], im)
            return context.get_dummy_value()

        return types.void(_FLOATS, _WHOLE, _WHOLE, twiddles, _WHOLE), code

    return turn


_turn2, _turn3, _turn4, _turn5, _turn7, _turn8, _turn11, _turn13 = (
    _butterfly(radix) for radix in sorted(RADICES)
)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _stage(
    work: np.ndarray, place: int, n_parts: int, radix: int, part: int, twiddles: np.ndarray, at: int
) -> None:
    """One radix for some stretches of radix x part points, one behind the other."""
    stride, step = part * POINT, 2 * (radix - 1)
    for stretch in range(n_parts):
        here = place + stretch * radix * stride
        for q in range(part):
            here_q, at_q = here + q * POINT, at + q * step
            if radix == 8:
                _turn8(work, here_q, stride, twiddles, at_q)
            elif radix == 5:
                _turn5(work, here_q, stride, twiddles, at_q)
            elif radix == 4:
                _turn4(work, here_q, stride, twiddles, at_q)
            elif radix == 11:
                _turn11(work, here_q, stride, twiddles, at_q)
            elif radix == 3:
                _turn3(work, here_q, stride, twiddles, at_q)
            elif radix == 2:
                _turn2(work, here_q, stride, twiddles, at_q)
            elif radix == 7:
                _turn7(work, here_q, stride, twiddles, at_q)
            else:
                _turn13(work, here_q, stride, twiddles, at_q)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def transform(
    work: np.ndarray, place: int, n: int, radices: np.ndarray, twiddles: np.ndarray
) -> None:
    """Transform n points of sixteen series, from a place of `work` on, flat float32."""
    if len(radices) == 0:
        return
    first = radices[0]
    part = n // first
    _stage(work, place, 1, first, part, twiddles, 0)
    # What the first radix parts is done with one by one: 200 of 2200 points stay in L1.
    for own in range(first):
        at, length, n_parts = part * 2 * (first - 1), part, 1
        for radix in radices[1:]:
            _stage(work, place + own * part * POINT, n_parts, radix, length // radix, twiddles, at)
            length //= radix
            n_parts *= radix
            at += length * 2 * (radix - 1)


def _transposed(builder: Any, rows: list[Any]) -> list[Any]:
    """Sixteen vectors, lanes for rows: by swapping ever smaller squares."""
    size = WIDTH // 2
    while size:
        low = [lane if not lane & size else WIDTH + lane - size for lane in range(WIDTH)]
        high = [lane + size if not lane & size else WIDTH + lane for lane in range(WIDTH)]
        for i in range(WIDTH):
            if not i & size:
                a, b = rows[i], rows[i + size]
                rows[i], rows[i + size] = (
                    _mixed(builder, a, b, low),
                    _mixed(builder, a, b, high),
                )
        size //= 2
    return rows


def _points(context: Any, builder: Any, kinds: Sequence[Any], values: Sequence[Any]) -> list[Any]:
    """Where sixteen points of an array are, by places from a first one on."""
    places = _pointer(context, builder, kinds[1], values[1], values[2])
    return [
        _pointer(
            context,
            builder,
            kinds[0],
            values[0],
            builder.load(builder.gep(places, [_whole(i)])),
        )
        for i in range(WIDTH)
    ]


def _taker() -> Callable[..., None]:
    @intrinsic
    def run(context, work, place, numbers, at, window, first, weight):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds, sums = signature.args, _Sums(builder)
            source = _pointer(context, builder, kinds[2], values[2], values[3])
            lower, upper = (_load(builder, builder.gep(source, [_whole(i)])) for i in (0, WIDTH))
            taper = _load(builder, _pointer(context, builder, kinds[4], values[4], values[5]))
            taper = sums.times(taper, _everywhere(builder, values[6]))
            target = _pointer(context, builder, kinds[0], values[0], values[1])
            for part in (0, 1):
                own = _mixed(builder, lower, upper, range(part, POINT, 2))
                _store(builder, sums.times(own, taper), builder.gep(target, [_whole(part * WIDTH)]))
            return context.get_dummy_value()

        # What may be read only is of another type than what may be written to.
        kinds = _FLOATS, _WHOLE, numbers, _WHOLE, window, _WHOLE, types.float32
        return types.void(*kinds), code

    return run


take = _taker()
"""Set one point to sixteen complex numbers in a row, times a window and one weight.

The numbers lie in `numbers` from `at` on, the window in `window` from `first` on."""


def _exchanger() -> Callable[..., None]:
    @intrinsic
    def run(context, out, to, stride, apart, work, places, first):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds = signature.args
            target = _pointer(context, builder, kinds[0], values[0], values[1])
            points = _points(context, builder, kinds[4:6], values[4:])
            for part in (0, WIDTH):
                rows = [_load(builder, builder.gep(point, [_whole(part)])) for point in points]
                row_at = target if part == 0 else builder.gep(target, [values[3]])
                for row in _transposed(builder, rows):
                    _store(builder, row, row_at)
                    row_at = builder.gep(row_at, [values[2]])
            return context.get_dummy_value()

        return types.void(_FLOATS, _WHOLE, _WHOLE, _WHOLE, _FLOATS, places, _WHOLE), code

    return run


exchange = _exchanger()
"""Set sixteen rows of `out`, one for each series, to sixteen points of `work`.

Those of `work` lie at sixteen of the places, from `first` on. Rows of real parts lie `stride`
floats from each other, those of imaginary parts `apart` behind them: rows at `POINT` and `WIDTH`
are points again, of series that were points."""


def _powers(*, adds: bool) -> Callable[..., None]:
    @intrinsic
    def run(context, out, to, stride, work, places, first, share):  # type: ignore[no-untyped-def] # noqa: ANN001
        def code(context, builder, signature, values):  # type: ignore[no-untyped-def] # noqa: ANN001
            kinds, sums = signature.args, _Sums(builder)
            target = _pointer(context, builder, kinds[0], values[0], values[1])
            share, rows = _everywhere(builder, values[6]), []
            for point in _points(context, builder, kinds[3:5], values[3:6]):
                re, im = (_load(builder, builder.gep(point, [_whole(i)])) for i in (0, WIDTH))
                power = sums.add(sums.times(re, re), sums.times(im, im))
                rows.append(sums.times(power, share))
            for row in _transposed(builder, rows):
                total = sums.add(_load(builder, target), row) if adds else row
                _store(builder, total, target)
                target = builder.gep(target, [values[2]])
            return context.get_dummy_value()

        return (
            types.void(_FLOATS, _WHOLE, _WHOLE, _FLOATS, places, _WHOLE, types.float32),
            code,
        )

    return run


set_powers, add_powers = _powers(adds=False), _powers(adds=True)
"""Set sixteen rows of `out`, one for each series, to a share of the powers of sixteen points; or
add it to them.

Points as in `exchange`; rows lie so many floats apart."""
