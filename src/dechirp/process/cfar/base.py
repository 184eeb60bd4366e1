"""Constant-false-alarm-rate thresholds: what all noise estimators share."""

from abc import abstractmethod
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from dechirp.core.checks import count, positive
from dechirp.core.errors import InvalidSetting
from dechirp.core.families import Family
from dechirp.core.values import value
from dechirp.process.spectrum import Transform
from dechirp.theory.calibrated import Factor, calibrated_factor
from dechirp.theory.correlated import Box

# Places of the cell under test in the box for which the factor is found. Between them what
# correlation makes of it is interpolated, within 0.1 % of the factor.
MOST_PLACES = 16
# Places for which it is calibrated, where a ring of so many cells takes half a second for each.
_FEWEST_PLACES, _MANY_CELLS = 5, 2000
# Cells whose training cells are held at a time, over the cells of a map: memory of that map.
_HELD = 0.1
# The exact law for correlated cells inverts a matrix of so many rows, in 2 s at this size.
MOST_GUARD_CELLS = 2000


@value
class Cells:
    """Numbers of cells on each side of the cell under test."""

    range: int
    velocity: int

    def __post_init__(self) -> None:
        count(self, "range", "velocity", at_least=0)


_USUAL_TRAINING = Cells(range=10, velocity=8)
_USUAL_GUARD = Cells(range=4, velocity=4)


@value
class Noise:
    """What white noise looks like in a map: the transforms it went through, channels summed."""

    over_range: Transform
    over_velocity: Transform
    n_channels: int = 1


@value
class Ring:
    """The training cells about a cell under test: a box less the guard cells.

    Velocity wraps round, so the ring is whole at both ends of that axis. Range ends: there
    the box stays within the map and the cell under test moves out of its middle, so that
    the training cells are the nearest that exist.
    """

    n_training: Cells
    n_guard: Cells

    @property
    def half_range(self) -> int:
        """Rows from the cell under test to the edge of the box."""
        return self.n_training.range + self.n_guard.range

    @property
    def half_velocity(self) -> int:
        """Columns from the cell under test to the edge of the box."""
        return self.n_training.velocity + self.n_guard.velocity

    @property
    def sizes(self) -> tuple[int, int, int, int]:
        """Training cells along range and velocity, then guard cells, on each side."""
        training, guard = self.n_training, self.n_guard
        return training.range, training.velocity, guard.range, guard.velocity

    def offsets(self, place: int) -> np.ndarray:
        """Training cells from a cell under test in row `place` of the box, (n_training, 2).

        Velocity and range; in order of range, then velocity.
        """
        return _offsets(self, place)

    def guard_rows(self, place: int) -> slice:
        """Rows of the box that the guard takes, for the cell under test in row `place`."""
        return slice(max(place - self.n_guard.range, 0), place + self.n_guard.range + 1)

    def box(self, noise: Noise, place: int) -> Box:
        """Covariance of the noise in the box, for the cell under test in row `place`."""
        guard = self.guard_rows(place)
        n_rows = 2 * self.half_range + 1
        return Box(
            range_covariance=noise.over_range.covariance(n_rows),
            velocity_covariance=noise.over_velocity.covariance(2 * self.half_velocity + 1),
            guard_range=slice(guard.start, min(guard.stop, n_rows)),
            guard_velocity=slice(
                self.n_training.velocity, self.n_training.velocity + 2 * self.n_guard.velocity + 1
            ),
            under_test=(place, self.half_velocity),
        )

    def places(self, n_range: int) -> np.ndarray:
        """Row of the box in which each of n_range rows of a map is tested, (n_range,)."""
        return _places(self.half_range, n_range)

    def n_cells(self, n_range: int) -> np.ndarray:
        """Training cells of each of n_range rows of a map, (n_range,): most near its ends."""
        place = self.places(n_range)
        width, guard = 2 * self.half_range + 1, self.n_guard.range
        n_rows = np.minimum(place + guard + 1, width) - np.maximum(place - guard, 0)
        n_guard = n_rows * (2 * self.n_guard.velocity + 1)
        return np.asarray(width * (2 * self.half_velocity + 1) - n_guard)

    def fits(self, n_velocity: int, n_range: int) -> None:
        """Raise `InvalidSetting` unless the box is within a map of that size."""
        n_guard = (2 * self.n_guard.range + 1) * (2 * self.n_guard.velocity + 1)
        if n_guard > MOST_GUARD_CELLS:
            raise InvalidSetting(
                "Cfar.n_guard",
                got=f"{n_guard} cells with the cell under test",
                need=f"at most {MOST_GUARD_CELLS}",
                fix="Lower n_guard.range or n_guard.velocity; pad less if the main lobe is wide.",
            )
        sizes = (
            ("range", self.half_range, n_range),
            ("velocity", self.half_velocity, n_velocity),
        )
        for name, half, n_cells in sizes:
            if 2 * half + 1 > n_cells:
                raise InvalidSetting(
                    "Cfar.n_training",
                    got=f"{2 * half + 1} {name} cells with the guard",
                    need=f"at most {n_cells}, the {name} cells of the map",
                    fix=f"Lower n_training.{name} or n_guard.{name}.",
                )


@lru_cache(maxsize=64)
def _places(half_range: int, n_range: int) -> np.ndarray:
    rows = np.arange(n_range)
    start = np.clip(rows - half_range, 0, n_range - 1 - 2 * half_range)
    return _only_read(rows - start)


@lru_cache(maxsize=256)
def _offsets(ring: Ring, place: int) -> np.ndarray:
    rows = np.arange(2 * ring.half_range + 1) - place
    columns = np.arange(2 * ring.half_velocity + 1) - ring.half_velocity
    trains = (abs(rows)[:, None] > ring.n_guard.range) | (abs(columns) > ring.n_guard.velocity)
    row, column = np.nonzero(trains)
    return _only_read(np.stack([columns[column], rows[row]], axis=1))


def _only_read(found: np.ndarray) -> np.ndarray:
    """What is kept and handed out again cannot be written to."""
    found.setflags(write=False)
    return found


class NoiseEstimator(Family):
    """What sets one CFAR apart from the next: how it estimates the noise from training cells.

    A member must give that `statistic`, and has a law for it by simulation and a threshold map
    by brute force. One that is fast gives the map itself; one whose law has a closed form for
    independent cells gives that.
    """

    group: ClassVar[str] = "dechirp.cfar"

    @abstractmethod
    def statistic(self, cells: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """Noise power from the training cells of one box, (..., n_training) to (...).

        `offsets` (n_training, 2) are the places of the cells, velocity and range, from the cell
        under test. Of cells twice as strong it is twice as much.
        """

    def check(self, ring: Ring) -> None:
        """Raise `InvalidSetting` unless the statistic has the training cells that it needs."""

    def threshold(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Noise power about each cell of a map times the factor of its row.

        `power` (velocity, range) and `factors` (range,) are float32, as is what is given.
        """
        at = np.stack(np.unravel_index(np.arange(power.size), power.shape), axis=1)
        return self.threshold_at(power, at, ring, factors).reshape(power.shape)

    def threshold_at(
        self, power: np.ndarray, at: np.ndarray, ring: Ring, factors: np.ndarray
    ) -> np.ndarray:
        """The same for some cells (n, 2), velocity and range, only: (n,)."""
        levels = np.empty(len(at), np.float32)
        places = ring.places(power.shape[1])[at[:, 1]]
        for place in np.unique(places):
            offsets = ring.offsets(int(place))
            chosen = np.flatnonzero(places == place)
            n_held = max(int(_HELD * power.size / len(offsets)), 1)
            for some in np.split(chosen, range(n_held, chosen.size, n_held)):
                velocity, row = (at[some, None] + offsets).transpose(2, 0, 1)
                levels[some] = self.statistic(power[velocity % len(power), row], offsets)
        return np.asarray(levels * factors[at[:, 1]])

    def exceeds(self, power: np.ndarray, ring: Ring, factors: np.ndarray) -> np.ndarray:
        """Which cells of a map exceed their threshold, bool (velocity, range)."""
        return np.asarray(power > self.threshold(power, ring, factors))

    def independent_factor(
        self, false_alarm_probability: float, offsets: np.ndarray, *, n_channels: int
    ) -> float | None:
        """Factor for cells that are independent, if its law has a closed form."""
        return None

    def low(self, offsets: np.ndarray) -> np.ndarray:
        """Sets of training cells each of which brings alarms when it is low, bool (n_sets, n)."""
        return np.ones((1, len(offsets)), bool)

    def factor(self, false_alarm_probability: float, box: Box, *, n_channels: int) -> Factor:
        """Threshold over statistic that gives the probability in noise with that covariance.

        The closed form where cells are independent, if there is one, or calibrated by
        simulation, see `theory.calibrated`.
        """
        offsets = box.offsets
        if box.is_white:
            exact = self.independent_factor(false_alarm_probability, offsets, n_channels=n_channels)
            if exact is not None:
                return Factor(value=exact)
        return calibrated_factor(
            false_alarm_probability,
            lambda cells: self.statistic(cells, offsets),
            box,
            n_summed=n_channels,
            low=self.low(offsets),
        )


@value
class Cfar:
    """A threshold for every cell of a map, from the cells around it.

    Give the false-alarm probability for each cell, or an offset over the noise, not both.
    """

    estimator: NoiseEstimator
    n_training: Cells = _USUAL_TRAINING
    n_guard: Cells = _USUAL_GUARD
    false_alarm_probability: float | None = None
    offset: float | None = None
    """Threshold over the estimated noise power, a ratio (dB of power in files)."""

    def __post_init__(self) -> None:
        if (self.false_alarm_probability is None) == (self.offset is None):
            raise InvalidSetting(
                "Cfar.false_alarm_probability",
                got="neither it nor an offset" if self.offset is None else "beside an offset",
                need="given, or else offset given: one of the two",
                fix="Set the other to null.",
            )
        if self.offset is not None:
            positive(self, "offset")
        elif not 0 < (self.false_alarm_probability or 0.0) < 1:
            raise InvalidSetting(
                "Cfar.false_alarm_probability",
                got=self.false_alarm_probability,
                need="between 0 and 1, both excluded",
                fix="Give the probability for each cell, such as 1e-6.",
            )
        if self.n_training.range + self.n_training.velocity < 1:
            raise InvalidSetting(
                "Cfar.n_training",
                got="0 cells on both axes",
                need="training cells along range or velocity",
                fix="Give at least one.",
            )
        self.estimator.check(self.ring)

    def fitted(self, n_velocity: int, n_range: int) -> "Cfar":
        """The same with fewer cells, if the default ones have no room in a map of that size.

        Cells that were set otherwise stay as they are, whether they fit or not.
        """
        if (self.n_training, self.n_guard) != (_USUAL_TRAINING, _USUAL_GUARD):
            return self
        room = {"range": (n_range - 1) // 2, "velocity": (n_velocity - 1) // 2}
        if room["range"] >= self.ring.half_range and room["velocity"] >= self.ring.half_velocity:
            return self
        guard, training = {}, {}
        for axis, half in room.items():
            most = getattr(self.n_guard, axis) + getattr(self.n_training, axis)
            # Fewer than three cells on each side are no guard and ring: none of either then.
            reach = min(half, most) if half > 1 else 0
            guard[axis] = min(getattr(self.n_guard, axis), reach // 2)
            training[axis] = reach - guard[axis]
        return replace(self, n_training=Cells(**training), n_guard=Cells(**guard))

    @property
    def ring(self) -> Ring:
        """The training cells about a cell under test."""
        return Ring(n_training=self.n_training, n_guard=self.n_guard)

    def threshold(self, power: np.ndarray, noise: Noise) -> np.ndarray:
        """Threshold for each cell of a map, (velocity, range), every cell included.

        Raises
        ------
        InvalidSetting
            If the training cells with the guard do not fit into the map, or the guard is
            too small for the window and the zero padding.
        """
        return self.estimator.threshold(power, self.ring, self.factor_of_rows(power, noise))

    def threshold_at(self, power: np.ndarray, at: np.ndarray, noise: Noise) -> np.ndarray:
        """The same for some cells (n, 2), velocity and range, only: (n,)."""
        factors = self.factor_of_rows(power, noise)
        return self.estimator.threshold_at(power, at, self.ring, factors)

    def exceeds(self, power: np.ndarray, noise: Noise) -> np.ndarray:
        """Which cells of a map exceed their threshold, bool (velocity, range); as `threshold`."""
        return self.estimator.exceeds(power, self.ring, self.factor_of_rows(power, noise))

    def error(self, noise: Noise) -> float:
        """Standard error of the false-alarm probability, relative; 0 where its law is exact."""
        return 0.0 if self.offset is not None else _factors(self, noise)[1]

    def factor_of_rows(self, power: np.ndarray, noise: Noise) -> np.ndarray:
        """Factor of each row of a map, (n_range,), of which only the size counts.

        Found once, in seconds where it is calibrated; with it the estimator judges maps alone.
        """
        self.ring.fits(*power.shape)
        if self.offset is not None:
            return np.full(power.shape[1], self.offset, np.float32)
        return np.asarray(_factors(self, noise)[0][self.ring.places(power.shape[1])])


@lru_cache(maxsize=64)
def _factors(cfar: Cfar, noise: Noise) -> tuple[np.ndarray, float]:
    """Factor for each place of the cell under test in the box, and the largest error."""
    pfa, ring = cfar.false_alarm_probability, cfar.ring
    assert pfa is not None
    last = ring.half_range

    def found(place: int) -> Factor:
        return cfar.estimator.factor(pfa, ring.box(noise, place), n_channels=noise.n_channels)

    def closed(place: int) -> float:
        offsets = ring.offsets(place)
        form = cfar.estimator.independent_factor(pfa, offsets, n_channels=noise.n_channels)
        return 1.0 if form is None else form

    middle = found(last)
    n_places = MOST_PLACES
    if middle.error:
        n_places = int(np.clip(_MANY_CELLS / len(ring.offsets(last)), _FEWEST_PLACES, MOST_PLACES))
    places = np.unique(np.linspace(0, last, min(last + 1, n_places)).round().astype(int))
    factors = [*(found(int(place)) for place in places[:-1]), middle]
    # Of a factor, what correlation makes of it is smooth: numbers of cells go in steps.
    ratios = [factor.value / closed(int(at)) for factor, at in zip(factors, places, strict=True)]
    every = np.arange(last + 1)
    half = np.interp(every, places, ratios) * [closed(int(place)) for place in every]
    # Mirrored places have mirrored covariances, and the same law.
    values = np.concatenate([half, half[-2::-1]]).astype(np.float32)
    return values, max(factor.error for factor in factors)
