"""Missing window: spectral leakage of strong echoes along an axis."""

from dataclasses import dataclass

import numpy as np
import scipy

from dechirp.core.units import to_decibels
from dechirp.processing.diagnosis.diagnosis import NOTHING_FOUND, Diagnosis, mistake_found
from dechirp.processing.diagnosis.map_peaks import measure_main_lobes, median_noise

_AXES = ("velocity", "range")
_N_LINES = 12
_MIN_POINTS = 32
_NEAREST = 3.5  # resolution cells, beyond the main lobe of usual windows
_MAX_ECHOES, _MIN_ECHO_OVER_NOISE, _MIN_UNEXPLAINED = 12, 100.0, 6.0
_MIN_LEAKAGE_OVER_NOISE = 15.0
_MAX_DEVIATION_DB = 6.0
_MAX_MISFIT = 0.15
_SHARE_BY_CHANCE = 0.2
"""Share of cells that lie within 6 dB of a leakage of 12 dB and more by chance: 0.07 in noise,
more between the main lobes of other echoes; at most 0.22 in 40 crowded maps with windows."""
_FALSE_ALARM_PROBABILITY = 1e-6
_MIN_SHARE = 0.6  # static clutter of a recorded room has reached 0.48 under a Hann window


_MIN_OFFSET_LOBE = 0.1  # echoes on the grid do not leak
_LOBE_MARGIN = 0.06
_MIN_NARROW_LOBES = 3
# Share of matching cells from which sidelobes are those without a window: 0.59 and 0.71 in crowded
# maps without one, at most 0.2 in 400 maps with a Taylor window, whose sidelobes are 8 dB weaker.
_MIN_SHARE_WITH_LOBES = 0.5
_TAYLOR_30_COEFFICIENT, _HAMMING_COEFFICIENT = 0.2925, 0.23 / 0.54
_NARROW_SHARE_BY_CHANCE = 0.06  # 1 of 17 in crowded maps with windows
_MAX_CHANCE_OF_LOBES = 3e-3


@dataclass(frozen=True)
class Leakage:
    """Leakage of strong echoes along one axis, compared with that of a rectangular window."""

    n_matching: int
    """Cells within 6 dB of the prediction."""
    n_cells: int
    """Cells in which the leakage of a rectangular window would exceed the noise by 12 dB."""
    over_noise: float
    """Largest leakage over the noise in matching cells."""
    n_narrow: int = 0
    """Main lobes of strong echoes that are narrower than those of usual windows."""
    n_lobes: int = 0
    """Main lobes of strong echoes."""

    @property
    def chance(self) -> float:
        """Return the probability that so many cells match by chance."""
        return float(scipy.stats.binom.sf(self.n_matching - 1, self.n_cells, _SHARE_BY_CHANCE))

    @property
    def has_rectangular_sidelobes(self) -> bool:
        """Return whether the cells show the sidelobes of a rectangular window."""
        is_frequent = self.n_matching > _MIN_SHARE * self.n_cells
        return is_frequent and self.chance < _FALSE_ALARM_PROBABILITY

    @property
    def chance_of_lobes(self) -> float:
        """Return the probability that so many main lobes are narrow by chance."""
        tail = scipy.stats.binom.sf(self.n_narrow - 1, self.n_lobes, _NARROW_SHARE_BY_CHANCE)
        return float(tail)

    @property
    def is_rectangular(self) -> bool:
        """Return whether sidelobes or main lobes show a rectangular window.

        Sidelobes of crowded echoes interfere; their main lobes stay narrow.
        """
        has_narrow_lobes = (
            self.n_narrow >= _MIN_NARROW_LOBES and self.chance_of_lobes < _MAX_CHANCE_OF_LOBES
        )
        return self.has_rectangular_sidelobes or has_narrow_lobes


def measure_leakage(power: np.ndarray, axis: int, padding: float) -> Leakage:
    """Compare the leakage of strong echoes along an axis with that of a rectangular window.

    An echo that lies a fraction of a cell beside the grid has the leakage
    sin^2(pi x) / (n sin(pi x / n))^2 at a distance of x resolution cells. Echoes on the grid have
    none, and are not tested. Leakages of several echoes in a line add up in power on average.
    """
    lines = np.moveaxis(power, axis, -1)
    floor = np.moveaxis(np.broadcast_to(median_noise(power), power.shape), axis, -1)
    n_matching, n_cells, largest = 0, 0, 0.0
    if lines.shape[-1] / padding < _MIN_POINTS:
        return Leakage(n_matching=0, n_cells=0, over_noise=0.0)
    for line in _strongest_lines(lines, floor):
        measured, noise = lines[line], floor[line]
        if axis == 1 and _is_at_range_zero(measured, padding):
            continue
        predicted, distance, misfit = _predict_leakage(measured, noise, padding)
        is_clear = (predicted > _MIN_LEAKAGE_OVER_NOISE * noise) & (distance > _NEAREST)
        ratio = np.maximum(measured, 1e-300)[is_clear] / predicted[is_clear]
        is_matching = (abs(to_decibels(ratio)) < _MAX_DEVIATION_DB) & (misfit < _MAX_MISFIT)
        n_cells += int(is_clear.sum() / padding)
        n_matching += int(is_matching.sum() / padding)
        over_noise = (measured / noise)[is_clear][is_matching]
        largest = max(largest, float(over_noise.max(initial=0.0)))
    lobes = measure_main_lobes(power, axis)
    has_sidelobes = n_matching > _MIN_SHARE_WITH_LOBES * n_cells > 0
    narrowest = _narrowest_lobe_of_window(
        padding, _HAMMING_COEFFICIENT if has_sidelobes else _TAYLOR_30_COEFFICIENT
    )
    return Leakage(
        n_matching=n_matching,
        n_cells=n_cells,
        over_noise=largest,
        n_narrow=int(np.count_nonzero((lobes > _MIN_OFFSET_LOBE) & (lobes < narrowest))),
        n_lobes=lobes.size,
    )


def _narrowest_lobe_of_window(padding: float, coefficient: float) -> float:
    """Return a limit below the main lobes of a window, see `measure_main_lobes`.

    With zero padding, the middle between these and those of a rectangular window. The spectrum of
    a window is sinc(x) + b (sinc(x - 1) + sinc(x + 1)), b the coefficient: 0.2925 for a Taylor
    window of -30 dB, the narrowest usual one, whose further terms are below 0.02.
    """
    x = (np.linspace(-0.5, 0.5, 11)[:, None] + np.array([-1, 0, 1])) / padding

    def lobes(b: float) -> np.ndarray:
        amplitude = abs(np.sinc(x) + b * (np.sinc(x - 1) + np.sinc(x + 1)))
        return np.asarray((amplitude[:, 0] + amplitude[:, 2]) / amplitude[:, 1])

    narrowest, widest_rectangular = lobes(coefficient).min(), lobes(0.0).max()
    middle = (narrowest + widest_rectangular) / 2
    return float(min((1 - _LOBE_MARGIN) * narrowest, middle))


def _is_at_range_zero(measured: np.ndarray, padding: float) -> bool:
    """Return whether the strongest cell is the transmitter leakage, which has skirts of its own.

    Phase noise, bumper and housing fill the cells about it, at -20 to -30 dB in a recording.
    """
    strongest = int(np.argmax(measured))
    return min(strongest, measured.size - strongest) <= _NEAREST * padding


def _strongest_lines(lines: np.ndarray, floor: np.ndarray) -> list[int]:
    """Return the lines with the strongest echoes over the noise, without neighbours of stronger."""
    strongest = lines.max(axis=-1)
    over_noise = (lines / floor).max(axis=-1)
    if len(lines) > 2:
        is_peak = (strongest >= np.roll(strongest, 1)) & (strongest >= np.roll(strongest, -1))
        over_noise = np.where(is_peak, over_noise, 0.0)
    order = np.argsort(-over_noise)[:_N_LINES]
    return [int(line) for line in order if over_noise[line] > 0]


def _predict_leakage(
    measured: np.ndarray, noise: np.ndarray, padding: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Predict the leakage of a line, and the distance of each cell from the nearest echo.

    The strongest cell that the leakage so far does not explain is the next echo. The third result
    is the misfit of the main lobe of the first.
    """
    n_cells = measured.size
    n_points = n_cells / padding
    predicted, distance = np.zeros(n_cells), np.full(n_cells, np.inf)
    misfits = []
    for _ in range(_MAX_ECHOES):
        is_echo = (measured > _MIN_UNEXPLAINED * predicted) & (distance > 1)
        place = int(np.argmax(np.where(is_echo, measured, 0.0)))
        if measured[place] < _MIN_ECHO_OVER_NOISE * noise[place]:
            break
        cells = (np.arange(n_cells) - place + n_cells // 2) % n_cells - n_cells // 2
        offset, misfit = _grid_offset_and_misfit(np.roll(measured, -place), padding)
        misfits.append(misfit)
        shape = rectangular_leakage((cells - offset) / padding, n_points)
        predicted += measured[place] * shape / shape[place]
        distance = np.minimum(distance, abs(cells) / padding)
    return predicted, distance, misfits[0] if misfits else np.inf


def _grid_offset_and_misfit(cut: np.ndarray, padding: float) -> tuple[float, float]:
    """Return the offset of a maximum from its cell without a window, and the misfit of its lobe.

    The misfit is the sum of the deviations of both neighbours, relative to the amplitude: 0.25 for
    a Hann window on the grid.
    """
    offsets = np.linspace(-0.5, 0.5, 201)
    cells = np.array([-1, 0, 1])
    shapes = abs(np.sinc((cells - offsets[:, None]) / padding))
    misfits = abs(shapes / shapes[:, 1:2] - np.sqrt(cut[cells] / cut[0])).sum(axis=1)
    best = int(np.argmin(misfits))
    return float(offsets[best]), float(misfits[best])


def rectangular_leakage(distance: np.ndarray, n_points: float) -> np.ndarray:
    """Return the power of a tone at a distance in resolution cells, without a window."""
    return np.asarray((np.sinc(distance) / np.maximum(np.sinc(distance / n_points), 1e-12)) ** 2)


def diagnose_window(leakages: dict[int, Leakage]) -> Diagnosis:
    """Report the axes along which leakage exceeds the noise."""
    missing = {axis: leakage for axis, leakage in leakages.items() if leakage.is_rectangular}
    if not missing:
        return NOTHING_FOUND
    texts = []
    for axis, leakage in sorted(missing.items()):
        if leakage.has_rectangular_sidelobes:
            texts.append(
                f"along {_AXES[axis]}, {leakage.n_matching} of {leakage.n_cells} resolution cells"
                " beside strong echoes have the sidelobes of a rectangular window, up to"
                f" {to_decibels(leakage.over_noise):.0f} dB over the noise (probability of chance"
                f" {leakage.chance:.1g})"
            )
        else:
            texts.append(
                f"along {_AXES[axis]}, {leakage.n_narrow} of {leakage.n_lobes} main lobes of strong"
                " echoes are narrower than those of usual windows (probability of chance"
                f" {leakage.chance_of_lobes:.1g})"
            )
    return mistake_found(
        "window",
        value="; ".join(texts),
        expected="sidelobes below the noise: weaker echoes are hidden under them",
        fix="multiply the samples by a Hann window, or a Chebyshev window for stronger contrasts,"
        " along this axis before its FFT",
    )
