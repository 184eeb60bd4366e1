"""Block diagrams of the data flow and of the I/Q demodulator."""

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from dechirp.report.figures.style import BLUE, INK, MUTED, ORANGE

_SIMULATION_COLOR, _PROCESSING_COLOR, _EVALUATION_COLOR = "#e0ecf5", "#f1f3f5", "#f9e7db"
_FONT_POINTS = 7.5
_WIDTH = 100.0  # of the canvas in its own units

Point = tuple[float, float]


def draw_data_flow(axes: Axes) -> Axes:
    """Draw the data flow from requirements and scene to the verdict on each claim.

    Parameters
    ----------
    axes : Axes
        Axes to draw on: a canvas 100 wide and 55 high, without scales.

    Returns
    -------
    Axes
        The given axes.
    """
    columns = [8.0 + 21.0 * index for index in range(5)]
    simulation_y, processing_y, evaluation_y = 31.0, 17.0, 3.0
    boxes = [
        (columns[0], simulation_y, "requirements", _SIMULATION_COLOR),
        (columns[1], simulation_y, "radar: chirp\nand frame", _SIMULATION_COLOR),
        (columns[2], simulation_y, "echoes", _SIMULATION_COLOR),
        (columns[3], simulation_y, "noise", _SIMULATION_COLOR),
        (columns[4], simulation_y, "samples,\nchirp by chirp", _SIMULATION_COLOR),
        (columns[4], processing_y, "range\ntransform", _PROCESSING_COLOR),
        (columns[3], processing_y, "Doppler\ntransform", _PROCESSING_COLOR),
        (columns[2], processing_y, "threshold\n(CFAR)", _PROCESSING_COLOR),
        (columns[1], processing_y, "peaks", _PROCESSING_COLOR),
        (columns[0], processing_y, "refinement\nof each peak", _PROCESSING_COLOR),
        (columns[0], evaluation_y, "estimates\nminus truth", _EVALUATION_COLOR),
        (columns[1], evaluation_y, "confidence\ninterval", _EVALUATION_COLOR),
        (columns[2], evaluation_y, "verdict on\neach claim", _EVALUATION_COLOR),
        (columns[2], simulation_y + 13.0, "scene", _SIMULATION_COLOR),
    ]
    half_width, half_height = 8.5, 4.0
    _set_up_canvas(axes, height=55.0, bottom=-3.0)
    for x, y, text, color in boxes:
        _draw_box(axes, x, y, text, width=2 * half_width, height=2 * half_height, color=color)
    for start_x, end_x in pairwise(columns):
        _draw_polyline_arrow(
            axes, [(start_x + half_width, simulation_y), (end_x - half_width, simulation_y)]
        )
        _draw_polyline_arrow(
            axes, [(end_x - half_width, processing_y), (start_x + half_width, processing_y)]
        )
    for start_x, end_x in pairwise(columns[:3]):
        _draw_polyline_arrow(
            axes, [(start_x + half_width, evaluation_y), (end_x - half_width, evaluation_y)]
        )
    for x, upper_y, lower_y in (
        (columns[4], simulation_y, processing_y),
        (columns[0], processing_y, evaluation_y),
        (columns[2], simulation_y + 13.0, simulation_y),
    ):
        _draw_polyline_arrow(axes, [(x, upper_y - half_height), (x, lower_y + half_height)])
    truth = [
        (columns[2] - half_width, simulation_y + 13.0),
        (columns[0] - half_width - 4.0, simulation_y + 13.0),
        (columns[0] - half_width - 4.0, evaluation_y),
        (columns[0] - half_width, evaluation_y),
    ]
    _draw_polyline_arrow(axes, truth, color=ORANGE, dashed=True)
    _draw_centred_text(axes, columns[0], simulation_y + 15.0, "truth", color=ORANGE)
    axes.set_label(
        "Data flow: requirements, radar and scene give echoes and noise; the samples pass range"
        " and Doppler transform, threshold, peaks and refinement; estimates minus truth decide"
        " on each claim"
    )
    return axes


def draw_demodulator(axes: Axes) -> Axes:
    """Draw the receiver with two mixers for complex samples of the beat signal.

    Parameters
    ----------
    axes : Axes
        Axes to draw on: a canvas 100 wide and 46 high, without scales.

    Returns
    -------
    Axes
        The given axes.
    """
    upper, middle, lower = 38.0, 22.0, 6.0
    _set_up_canvas(axes, height=46.0, bottom=-1.0)
    _draw_antenna_symbol(axes, 3.0, middle)
    _draw_box(
        axes, 13.0, middle, "low-noise\namplifier", width=13.0, height=8.0, color=_PROCESSING_COLOR
    )
    _draw_line(axes, [(3.0, middle), (6.5, middle)])
    _draw_line(axes, [(19.5, middle), (23.0, middle)])
    _draw_dot(axes, 23.0, middle)
    _draw_box(axes, 33.0, middle, " 0°\n90°", width=8.0, height=9.0, color=_SIMULATION_COLOR)
    for y, name in ((upper, "I"), (lower, "Q")):
        toward = 1.0 if y > middle else -1.0
        _draw_polyline_arrow(axes, [(23.0, middle), (23.0, y), (30.2, y)])
        _draw_polyline_arrow(axes, [(33.0, middle + 4.5 * toward), (33.0, y - 2.8 * toward)])
        _draw_mixer_symbol(axes, 33.0, y)
        _draw_polyline_arrow(axes, [(35.8, y), (46.0, y)])
        _draw_box(axes, 52.5, y, "low-pass", width=13.0, height=7.0, color=_PROCESSING_COLOR)
        _draw_polyline_arrow(axes, [(59.0, y), (65.5, y)])
        _draw_box(axes, 72.0, y, "ADC", width=13.0, height=7.0, color=_PROCESSING_COLOR)
        _draw_polyline_arrow(axes, [(78.5, y), (92.0, y), (92.0, middle + 5.0 * toward)])
        _draw_centred_text(axes, 85.0, y + 2.2, name)
    _draw_box(
        axes, 52.5, middle, "ramp\ngenerator", width=13.0, height=8.0, color=_SIMULATION_COLOR
    )
    _draw_polyline_arrow(axes, [(46.0, middle), (37.0, middle)])
    _draw_polyline_arrow(axes, [(59.0, middle), (63.5, middle)])
    _draw_box(
        axes, 69.5, middle, "power\namplifier", width=12.0, height=8.0, color=_SIMULATION_COLOR
    )
    _draw_line(axes, [(75.5, middle), (80.0, middle)])
    _draw_antenna_symbol(axes, 80.0, middle)
    _draw_box(axes, 92.0, middle, "x = I + jQ", width=13.0, height=9.0, color=_EVALUATION_COLOR)
    axes.set_label(
        "I/Q demodulator: the echo is mixed with the transmitted ramp and with its quadrature;"
        " after low-pass filters and ADCs the two signals are real and imaginary part"
    )
    return axes


def _set_up_canvas(axes: Axes, *, height: float, bottom: float) -> None:
    axes.set(xlim=(-5.0, _WIDTH + 1.0), ylim=(bottom, bottom + height))
    axes.set_axis_off()


def _draw_box(
    axes: Axes, x: float, y: float, text: str, *, width: float, height: float, color: str
) -> None:
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle="round,pad=0,rounding_size=1",
            facecolor=color,
            edgecolor=MUTED,
            linewidth=0.7,
        )
    )
    _draw_centred_text(axes, x, y, text)


def _draw_centred_text(axes: Axes, x: float, y: float, text: str, *, color: str = INK) -> None:
    # One call per line, because line spacing within one call depends on the font.
    lines = text.split("\n")
    for index, line in enumerate(lines):
        offset_y = ((len(lines) - 1) / 2 - index) * 2.9
        axes.text(
            x, y + offset_y, line, ha="center", va="center", color=color, fontsize=_FONT_POINTS
        )


def _draw_line(axes: Axes, points: Sequence[Point]) -> None:
    axes.plot(*zip(*points, strict=True), color=INK, linewidth=0.9)


def _draw_polyline_arrow(
    axes: Axes, points: Sequence[Point], *, color: str = INK, dashed: bool = False
) -> None:
    axes.plot(
        *zip(*points, strict=True), color=color, linewidth=0.9, linestyle="--" if dashed else "-"
    )
    axes.annotate(
        "",
        xy=points[-1],
        xytext=points[-2],
        arrowprops={
            "arrowstyle": "-|>",
            "color": color,
            "linewidth": 0.0,
            "shrinkA": 0,
            "shrinkB": 0,
            "mutation_scale": 7,
        },
    )


def _draw_dot(axes: Axes, x: float, y: float) -> None:
    axes.add_patch(Circle((x, y), 0.6, color=INK))


def _draw_mixer_symbol(axes: Axes, x: float, y: float) -> None:
    radius, arm = 2.8, 2.0
    axes.add_patch(Circle((x, y), radius, facecolor="#ffffff", edgecolor=BLUE, linewidth=1.2))
    for slant in (1.0, -1.0):
        axes.plot([x - arm, x + arm], [y - slant * arm, y + slant * arm], color=BLUE, linewidth=1.2)


def _draw_antenna_symbol(axes: Axes, x: float, y: float) -> None:
    _draw_line(axes, [(x, y), (x, y + 5.0)])
    axes.add_patch(
        Polygon(
            [(x, y + 5.0), (x - 2.2, y + 9.0), (x + 2.2, y + 9.0)],
            facecolor="#ffffff",
            edgecolor=INK,
            linewidth=0.9,
        )
    )
