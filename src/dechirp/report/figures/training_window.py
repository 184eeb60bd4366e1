"""Training and guard cells of a detector."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from dechirp.processing.cfar.base import TrainingWindow
from dechirp.report.figures.common import add_legend
from dechirp.report.figures.style import ORANGE

_TRAINING, _GUARD = "#bcd6ea", "#e6e9ec"


def draw_training_window(axes: Axes, training_window: TrainingWindow, *, n_training: int) -> Axes:
    """Draw the cell under test with its guard and training cells.

    Parameters
    ----------
    axes : Axes
        Axes to draw on, with square cells.
    training_window : TrainingWindow
        Training window.
    n_training : int
        Number of training cells.

    Returns
    -------
    Axes
        The given axes.
    """
    reach_range, reach_velocity = training_window.half_range, training_window.half_velocity
    range_cells = abs(np.arange(-reach_range, reach_range + 1))
    velocity_cells = abs(np.arange(-reach_velocity, reach_velocity + 1))[:, None]
    guard = (range_cells <= training_window.n_guard.range) & (
        velocity_cells <= training_window.n_guard.velocity
    )
    tested = (range_cells == 0) & (velocity_cells == 0)
    kinds = guard.astype(int) + tested
    n_guard = int(np.count_nonzero(kinds == 1))
    axes.grid(False)
    edges = (
        -reach_range - 0.5,
        reach_range + 0.5,
        -reach_velocity - 0.5,
        reach_velocity + 0.5,
    )
    axes.imshow(
        kinds,
        cmap=ListedColormap([_TRAINING, _GUARD, ORANGE]),
        extent=edges,
        origin="lower",
        interpolation="none",
        aspect="equal",
    )
    for x in np.arange(*edges[:2]):
        axes.axvline(x, color="#ffffff", linewidth=0.7)
    for y in np.arange(*edges[2:]):
        axes.axhline(y, color="#ffffff", linewidth=0.7)
    axes.set_xlabel("Range offset (cells)")
    axes.set_ylabel("Velocity offset (cells)")
    ends = (
        (reach_range, reach_velocity),
        (training_window.n_guard.range, training_window.n_guard.velocity),
    )
    axes.set_xticks(sorted({0, *(sign * end[0] for end in ends for sign in (-1, 1))}))
    axes.set_yticks(sorted({0, *(sign * end[1] for end in ends for sign in (-1, 1))}))
    add_legend(
        axes,
        handles=[
            Patch(color=ORANGE, label="cell under test"),
            Patch(color=_GUARD, label=f"{n_guard} guard cells"),
            Patch(color=_TRAINING, label=f"{n_training} training cells"),
        ],
    )
    axes.set_label("Cell under test, guard cells and training cells")
    return axes
