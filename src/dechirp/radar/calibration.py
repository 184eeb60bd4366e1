"""Array calibration: gain, phase and position errors of the virtual elements."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dechirp.core.checks import (
    Vector,
    as_tuple_or_none,
    check_and_convert_vectors_field,
    check_integer,
    check_number,
)
from dechirp.core.errors import InvalidSetting
from dechirp.core.values import frozen_dataclass
from dechirp.radar.array import Array


@frozen_dataclass
class Calibration:
    """Corrections for each virtual element, measured with a reflector or by the manufacturer.

    Processing multiplies the amplitude of each element by its gain, adds the position error to
    its position, and subtracts the offset from each range; ranges below zero become zero.
    """

    elements: tuple[tuple[int, int], ...]
    """Transmitter and receiver of each element, as indices into `Array.tx_m` and `Array.rx_m`;
    every pair of the array once, in any order."""
    gain: tuple[tuple[float, float], ...]
    """Factor of the amplitude that undoes the channel's gain and phase, real and imaginary part
    without a unit, for each element. Only ratios between elements affect directions."""
    position_error_m: tuple[Vector, ...] | None = None
    """True minus nominal position of each element; none: no error."""
    range_offset_m: float = 0.0
    """Excess of the measured ranges."""
    residual: float | None = None
    """RMS error of the elements after correction, relative to the echo; none: unknown. An
    amplitude: 0.01 is 0.6 degrees of phase."""

    def __post_init__(self) -> None:
        elements = tuple(
            _check_two_members(f"Calibration.elements.{index}", pair)
            for index, pair in enumerate(
                _check_nonempty_pair_list("Calibration.elements", self.elements)
            )
        )
        for index, (tx, rx) in enumerate(elements):
            check_integer(f"Calibration.elements.{index}", tx, at_least=0)
            check_integer(f"Calibration.elements.{index}", rx, at_least=0)
        object.__setattr__(self, "elements", tuple((int(tx), int(rx)) for tx, rx in elements))
        if len(set(self.elements)) < len(self.elements):
            duplicate = next(pair for pair in self.elements if self.elements.count(pair) > 1)
            raise InvalidSetting(
                "Calibration.elements",
                value=f"a list with {list(duplicate)} twice",
                expected="each pair of transmitter and receiver once",
                fix="remove one of them, with its gain",
            )
        gain = tuple(
            _check_complex_gain(f"Calibration.gain.{index}", pair)
            for index, pair in enumerate(_check_nonempty_pair_list("Calibration.gain", self.gain))
        )
        object.__setattr__(self, "gain", gain)
        if self.position_error_m is not None:
            # Boards are far more accurate: a value outside has a wrong unit.
            check_and_convert_vectors_field(self, "position_error_m", max_magnitude=0.1)
        for name in ("gain", "position_error_m"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.elements):
                raise InvalidSetting(
                    f"Calibration.{name}",
                    value=f"a list of {len(values)}",
                    expected=f"one for each of the {len(self.elements)} elements",
                    fix="give both lists in the same order, of the same length",
                )
        object.__setattr__(
            self,
            "range_offset_m",
            check_number(
                "Calibration.range_offset_m", self.range_offset_m, at_least=-1e6, at_most=1e6
            ),
        )
        if self.residual is not None:
            residual = check_number("Calibration.residual", self.residual, at_least=0.0)
            object.__setattr__(self, "residual", residual)

    def check_array(self, array: Array) -> None:
        """Check that the calibration has one element for each pair of the array."""
        pairs = {(tx, rx) for tx in range(len(array.tx_m)) for rx in range(array.n_rx)}
        missing, unknown = pairs - set(self.elements), set(self.elements) - pairs
        if not missing and not unknown:
            return
        problems = [f"{len(self.elements)} elements"]
        problems += [f"none for {_format_antenna_pairs(missing)}"] if missing else []
        problems += (
            [f"of them {_format_antenna_pairs(unknown)} not in the array"] if unknown else []
        )
        raise InvalidSetting(
            "Radar.calibration",
            value=", ".join(problems),
            expected=f"an element for each pair [tx, rx] of {len(array.tx_m)} transmitters and"
            f" {array.n_rx} receivers, counted from 0",
            fix="give the calibration of these antennas, or remove it",
        )

    def select_receivers(self, receivers: Sequence[int]) -> "Calibration":
        """Return the calibration of some receivers, which are counted from 0 in their order."""
        rows = [
            (index, (tx, list(receivers).index(rx)))
            for index, (tx, rx) in enumerate(self.elements)
            if rx in receivers
        ]
        errors_m = self.position_error_m
        return replace(
            self,
            elements=tuple(element for _, element in rows),
            gain=tuple(self.gain[index] for index, _ in rows),
            position_error_m=errors_m and tuple(errors_m[index] for index, _ in rows),
        )

    def element_corrections(self) -> np.ndarray:
        """Return the gains in the order of `Array.virtual_positions_m`, (n_elements,) complex."""
        return np.array(self.gain)[self._indices_in_virtual_array_order()] @ np.array([1, 1j])

    def element_position_errors_m(self) -> np.ndarray:
        """Return position errors in the order of `Array.virtual_positions_m`, (n_elements, 3)."""
        if self.position_error_m is None:
            return np.zeros((len(self.elements), 3))
        return np.array(self.position_error_m)[self._indices_in_virtual_array_order()]

    def _indices_in_virtual_array_order(self) -> list[int]:
        return sorted(range(len(self.elements)), key=self.elements.__getitem__)


def _format_antenna_pairs(pairs: set[tuple[int, int]]) -> str:
    examples = [str(list(pair)) for pair in sorted(pairs)[:3]]
    return ", ".join(examples) + (f" and {len(pairs) - 3} more" if len(pairs) > 3 else "")


def _check_nonempty_pair_list(setting: str, pairs: object) -> tuple[Any, ...]:
    members = as_tuple_or_none(pairs)
    if not members:
        raise InvalidSetting(
            setting,
            value=pairs,
            expected="a list of pairs, one for each element",
            fix="write [[0, 0], [0, 1]] for the first two",
        )
    return members


def _check_two_members(setting: str, pair: object) -> tuple[Any, Any]:
    members = as_tuple_or_none(pair) or ()
    if len(members) != 2:
        raise InvalidSetting(
            setting, value=pair, expected="two numbers", fix="write both in brackets"
        )
    return members[0], members[1]


def _check_complex_gain(setting: str, pair: object) -> tuple[float, float]:
    real, imaginary = (check_number(setting, part) for part in _check_two_members(setting, pair))
    # A factor of 1e-6 is 120 dB: a channel that needs it receives nothing.
    if not 1e-6 < np.hypot(real, imaginary) < 1e6:
        raise InvalidSetting(
            setting,
            value=f"[{real:.6g}, {imaginary:.6g}]",
            expected="a magnitude from 1e-6 to 1e6",
            fix="to exclude an element, remove it from the array",
        )
    return real, imaginary
