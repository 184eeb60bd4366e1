"""A calibration: what the channels of a radar do to an echo, and where its elements are."""

from typing import Any

import numpy as np

from dechirp.core.checks import Vector, listed, number, vectors, whole
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import value
from dechirp.radar.array import Array


@value
class Calibration:
    """Corrections for each virtual element, measured with a reflector or by the maker.

    Processing multiplies the amplitude of each element by its gain, adds the position error
    to its position, and takes the offset off each range.
    """

    elements: tuple[tuple[int, int], ...]
    """Transmitter and receiver of each, places in `Array.tx_m` and `Array.rx_m`; every pair of
    the array once, in any order."""
    gain: tuple[tuple[float, float], ...]
    """Factor of the amplitude that undoes the channel's gain and phase, real and imaginary part,
    bare numbers, for each element. Only ratios between elements tell directions."""
    position_error_m: tuple[Vector, ...] | None = None
    """Where each element is, less where the array says; none: there."""
    range_offset_m: float = 0.0
    """By how much measured ranges are too long."""
    residual: float | None = None
    """What is left in the elements after correction, a root mean square relative to the echo,
    where it was measured; none: not known. An amplitude: 0.01 is 0.6 degrees of phase."""

    def __post_init__(self) -> None:
        elements = tuple(
            _two(f"Calibration.elements.{place}", pair)
            for place, pair in enumerate(_some("Calibration.elements", self.elements))
        )
        for place, (tx, rx) in enumerate(elements):
            whole(f"Calibration.elements.{place}", tx, at_least=0)
            whole(f"Calibration.elements.{place}", rx, at_least=0)
        object.__setattr__(self, "elements", tuple((int(tx), int(rx)) for tx, rx in elements))
        if len(set(self.elements)) < len(self.elements):
            twice = next(pair for pair in self.elements if self.elements.count(pair) > 1)
            raise InvalidSetting(
                "Calibration.elements",
                got=f"a list with {list(twice)} twice",
                need="each pair of transmitter and receiver once",
                fix="Take one of them out, with its gain.",
            )
        gain = tuple(
            _factor(f"Calibration.gain.{place}", pair)
            for place, pair in enumerate(_some("Calibration.gain", self.gain))
        )
        object.__setattr__(self, "gain", gain)
        if self.position_error_m is not None:
            # Far beyond what is out of place on a board: outside, a unit is wrong.
            vectors(self, "position_error_m", at_most=0.1)
        for name in ("gain", "position_error_m"):
            given = getattr(self, name)
            if given is not None and len(given) != len(self.elements):
                raise InvalidSetting(
                    f"Calibration.{name}",
                    got=f"a list of {len(given)}",
                    need=f"one for each of the {len(self.elements)} elements",
                    fix="Give both lists in the same order, of the same length.",
                )
        object.__setattr__(
            self,
            "range_offset_m",
            number("Calibration.range_offset_m", self.range_offset_m, at_least=-1e6, at_most=1e6),
        )
        if self.residual is not None:
            residual = number("Calibration.residual", self.residual, at_least=0.0)
            object.__setattr__(self, "residual", residual)

    def must_fit(self, array: Array) -> None:
        """Raise `InvalidSetting` unless there is one element for each pair of the array."""
        pairs = {(tx, rx) for tx in range(len(array.tx_m)) for rx in range(array.n_rx)}
        missing, foreign = pairs - set(self.elements), set(self.elements) - pairs
        if not missing and not foreign:
            return
        got = [f"{len(self.elements)} elements"]
        got += [f"none for {_pairs(missing)}"] if missing else []
        got += [f"of them {_pairs(foreign)} not in the array"] if foreign else []
        raise InvalidSetting(
            "Radar.calibration",
            got=", ".join(got),
            need=f"of this array of {len(array.tx_m)} transmitters and {array.n_rx} receivers,"
            " each pair [tx, rx] once, counted from 0",
            fix="Give the calibration of these antennas, or leave it out.",
        )

    def factors(self) -> np.ndarray:
        """Gains in the order of `Array.virtual_m`, (n_elements,) complex."""
        return np.array(self.gain)[self._order()] @ np.array([1, 1j])

    def errors_m(self) -> np.ndarray:
        """Position errors in the order of `Array.virtual_m`, (n_elements, 3)."""
        if self.position_error_m is None:
            return np.zeros((len(self.elements), 3))
        return np.array(self.position_error_m)[self._order()]

    def _order(self) -> list[int]:
        return sorted(range(len(self.elements)), key=self.elements.__getitem__)


def _pairs(pairs: set[tuple[int, int]]) -> str:
    some = [str(list(pair)) for pair in sorted(pairs)[:3]]
    return ", ".join(some) + (f" and {len(pairs) - 3} more" if len(pairs) > 3 else "")


def _some(where: str, given: object) -> tuple[Any, ...]:
    members = listed(given)
    if not members:
        raise InvalidSetting(
            where,
            got=given,
            need="a list of pairs, one for each element",
            fix="Write [[0, 0], [0, 1]] for the first two.",
        )
    return members


def _two(where: str, pair: object) -> tuple[Any, Any]:
    members = listed(pair) or ()
    if len(members) != 2:
        raise InvalidSetting(where, got=pair, need="two numbers", fix="Write both in brackets.")
    return members[0], members[1]


def _factor(where: str, pair: object) -> tuple[float, float]:
    real, imaginary = (number(where, part) for part in _two(where, pair))
    # A factor of 1e-6 is 120 dB: the channel that needs it does not hear.
    if not 1e-6 < np.hypot(real, imaginary) < 1e6:
        raise InvalidSetting(
            where,
            got=f"[{real:.6g}, {imaginary:.6g}]",
            need="of magnitude from 1e-6 to 1e6",
            fix="An element that is to be left out is left out of the array.",
        )
    return real, imaginary
