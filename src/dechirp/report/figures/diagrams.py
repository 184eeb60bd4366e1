"""Block diagrams: how data flow, and the receiver that makes complex samples."""

from collections.abc import Sequence
from itertools import pairwise

from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyBboxPatch, Polygon

from dechirp.report.figures.style import BLUE, INK, MUTED, ORANGE

_MAKES, _READS, _JUDGES = "#e0ecf5", "#f1f3f5", "#f9e7db"
_FONT_POINTS = 7.5
_WIDTH = 100.0  # of the canvas in its own units, whatever its height

Point = tuple[float, float]


def data_flow(axes: Axes) -> Axes:
    """Draw the way from requirements and scene to the verdict on each claim.

    Parameters
    ----------
    axes : Axes
        To draw on: a canvas 100 wide and 55 high, without scales.

    Returns
    -------
    Axes
        Those given.
    """
    columns = [8.0 + 21.0 * index for index in range(5)]
    made, read, judged = 31.0, 17.0, 3.0
    boxes = [
        (columns[0], made, "requirements", _MAKES),
        (columns[1], made, "radar: chirp\nand frame", _MAKES),
        (columns[2], made, "echoes from\ntheir phases", _MAKES),
        (columns[3], made, "noise", _MAKES),
        (columns[4], made, "samples,\nchirp by chirp", _MAKES),
        (columns[4], read, "range\ntransform", _READS),
        (columns[3], read, "Doppler\ntransform", _READS),
        (columns[2], read, "threshold\n(CFAR)", _READS),
        (columns[1], read, "peaks", _READS),
        (columns[0], read, "refinement\nof each peak", _READS),
        (columns[0], judged, "estimates\nless truth", _JUDGES),
        (columns[1], judged, "interval of\nconfidence", _JUDGES),
        (columns[2], judged, "claim holds,\nor fails", _JUDGES),
        (columns[2], made + 13.0, "scene", _MAKES),
    ]
    half_width, half_height = 8.5, 4.0
    _canvas(axes, height=55.0, bottom=-3.0)
    for x, y, text, color in boxes:
        _box(axes, x, y, text, width=2 * half_width, height=2 * half_height, color=color)
    for left, right in pairwise(columns):
        _arrow(axes, [(left + half_width, made), (right - half_width, made)])
        _arrow(axes, [(right - half_width, read), (left + half_width, read)])
    for left, right in pairwise(columns[:3]):
        _arrow(axes, [(left + half_width, judged), (right - half_width, judged)])
    for x, above, below in (
        (columns[4], made, read),
        (columns[0], read, judged),
        (columns[2], made + 13.0, made),
    ):
        _arrow(axes, [(x, above - half_height), (x, below + half_height)])
    truth = [
        (columns[2] - half_width, made + 13.0),
        (columns[0] - half_width - 4.0, made + 13.0),
        (columns[0] - half_width - 4.0, judged),
        (columns[0] - half_width, judged),
    ]
    _arrow(axes, truth, color=ORANGE, dashed=True)
    _text(axes, columns[0], made + 15.0, "truth", color=ORANGE)
    axes.set_label(
        "Data flow: requirements, radar and scene give echoes and noise; their samples go"
        " through range and Doppler transform, threshold, peaks and refinement; estimates less"
        " truth decide on each claim"
    )
    return axes


def demodulator(axes: Axes) -> Axes:
    """Draw the receiver with two mixers that makes complex samples of the beat signal.

    Parameters
    ----------
    axes : Axes
        To draw on: a canvas 100 wide and 46 high, without scales.

    Returns
    -------
    Axes
        Those given.
    """
    upper, middle, lower = 38.0, 22.0, 6.0
    _canvas(axes, height=46.0, bottom=-1.0)
    _antenna(axes, 3.0, middle)
    _box(axes, 13.0, middle, "low-noise\namplifier", width=13.0, height=8.0, color=_READS)
    _line(axes, [(3.0, middle), (6.5, middle)])
    _line(axes, [(19.5, middle), (23.0, middle)])
    _dot(axes, 23.0, middle)
    _box(axes, 33.0, middle, " 0°\n90°", width=8.0, height=9.0, color=_MAKES)
    for y, name in ((upper, "I"), (lower, "Q")):
        toward = 1.0 if y > middle else -1.0
        _arrow(axes, [(23.0, middle), (23.0, y), (30.2, y)])
        _arrow(axes, [(33.0, middle + 4.5 * toward), (33.0, y - 2.8 * toward)])
        _mixer(axes, 33.0, y)
        _arrow(axes, [(35.8, y), (46.0, y)])
        _box(axes, 52.5, y, "low-pass", width=13.0, height=7.0, color=_READS)
        _arrow(axes, [(59.0, y), (65.5, y)])
        _box(axes, 72.0, y, "converter", width=13.0, height=7.0, color=_READS)
        _arrow(axes, [(78.5, y), (92.0, y), (92.0, middle + 5.0 * toward)])
        _text(axes, 85.0, y + 2.2, name)
    _box(axes, 52.5, middle, "ramp\ngenerator", width=13.0, height=8.0, color=_MAKES)
    _arrow(axes, [(46.0, middle), (37.0, middle)])
    _arrow(axes, [(59.0, middle), (63.5, middle)])
    _box(axes, 69.5, middle, "power\namplifier", width=12.0, height=8.0, color=_MAKES)
    _line(axes, [(75.5, middle), (80.0, middle)])
    _antenna(axes, 80.0, middle)
    _box(axes, 92.0, middle, "x = I + jQ", width=13.0, height=9.0, color=_JUDGES)
    axes.set_label(
        "I/Q demodulator: the received echo is mixed twice with the ramp that is being"
        " sent, the second time a quarter of a turn later; after low-pass and converter the two"
        " are real and imaginary part"
    )
    return axes


def _canvas(axes: Axes, *, height: float, bottom: float) -> None:
    axes.set(xlim=(-5.0, _WIDTH + 1.0), ylim=(bottom, bottom + height))
    axes.set_axis_off()


def _box(
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
    _text(axes, x, y, text)


def _text(axes: Axes, x: float, y: float, text: str, *, color: str = INK) -> None:
    # One call a line: the breaks of one call hang together by the metrics of another font.
    lines = text.split("\n")
    for index, line in enumerate(lines):
        above = ((len(lines) - 1) / 2 - index) * 2.9
        axes.text(x, y + above, line, ha="center", va="center", color=color, fontsize=_FONT_POINTS)


def _line(axes: Axes, points: Sequence[Point]) -> None:
    axes.plot(*zip(*points, strict=True), color=INK, linewidth=0.9)


def _arrow(axes: Axes, points: Sequence[Point], *, color: str = INK, dashed: bool = False) -> None:
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


def _dot(axes: Axes, x: float, y: float) -> None:
    axes.add_patch(Circle((x, y), 0.6, color=INK))


def _mixer(axes: Axes, x: float, y: float) -> None:
    radius, arm = 2.8, 2.0
    axes.add_patch(Circle((x, y), radius, facecolor="#ffffff", edgecolor=BLUE, linewidth=1.2))
    for slant in (1.0, -1.0):
        axes.plot([x - arm, x + arm], [y - slant * arm, y + slant * arm], color=BLUE, linewidth=1.2)


def _antenna(axes: Axes, x: float, y: float) -> None:
    _line(axes, [(x, y), (x, y + 5.0)])
    axes.add_patch(
        Polygon(
            [(x, y + 5.0), (x - 2.2, y + 9.0), (x + 2.2, y + 9.0)],
            facecolor="#ffffff",
            edgecolor=INK,
            linewidth=0.9,
        )
    )
