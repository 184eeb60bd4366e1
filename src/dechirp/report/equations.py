r"""Mathematics in a page: LaTeX notation to SVG that stands in the line.

    \(\tau = 2R/c\)              in the line
    \[beat| f = 2 S R / c \]     on a line of its own, numbered
    \eqref{beat}                 its number, with a link

Letters are outlines, so that no reader needs a font; sizes are in em, so that they fit the
text around them.
"""

import re
from functools import cache

from markupsafe import Markup, escape
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import text_to_path

_FONT = FontProperties(math_fontfamily="stix", size=100)
_EM = 100.0  # units of the outlines per em
_DISPLAY = re.compile(r"\\\[(\w+)\|(.*?)\\\]", re.DOTALL)
_INLINE = re.compile(r"\\\((.*?)\\\)", re.DOTALL)
_REFERENCE = re.compile(r"\\eqref\{(\w+)\}")
_LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}
_POINTS = {Path.MOVETO: 1, Path.LINETO: 1, Path.CURVE3: 2, Path.CURVE4: 3}


def typeset_equations(text: str) -> str:
    """Replace all formulas of a page by SVG, with display equations numbered in order.

    Raises
    ------
    KeyError
        If the page refers to a missing equation.
    """
    numbers = {match[1]: number for number, match in enumerate(_DISPLAY.finditer(text), start=1)}

    def displayed(match: re.Match[str]) -> str:
        name = match[1]
        return (
            f'<div class="equation" id="eq-{name}"><span>{equation_svg(match[2])}</span>'
            f"<i>({numbers[name]})</i></div>"
        )

    text = _DISPLAY.sub(displayed, text)
    text = _INLINE.sub(lambda match: equation_svg(match[1]), text)
    return _REFERENCE.sub(lambda match: f'<a href="#eq-{match[1]}">({numbers[match[1]]})</a>', text)


@cache
def equation_svg(tex: str) -> Markup:
    """Return a formula as SVG outlines in the text colour, aligned with the baseline."""
    tex = " ".join(tex.split())
    math = f"${tex}$"
    width, height, descent = text_to_path.get_text_width_height_descent(math, _FONT, ismath=True)
    vertices, codes = text_to_path.get_text_path(_FONT, math, ismath=True)
    outline = Path(vertices, codes)
    box = outline.get_extents()
    # Slanted letters extend beyond their width.
    min_x, max_x = min(box.x0, 0.0), max(box.x1, width)
    min_y, max_y = min(box.y0, -descent), max(box.y1, height - descent)
    label = escape(tex).replace("{", "&#123;")  # protects braces from the template engine
    return Markup(
        f'<svg class="math" role="img" aria-label="{label}"'
        f' viewBox="{min_x:.0f} {-max_y:.0f} {max_x - min_x:.0f} {max_y - min_y:.0f}"'
        f' style="width:{(max_x - min_x) / _EM:.3f}em;vertical-align:{min_y / _EM:.3f}em">'
        f'<path d="{_svg_path_data(outline)}"/></svg>'
    )


def _svg_path_data(path: Path) -> str:
    """Return the data of an SVG path, with y downwards."""
    parts = []
    for points, code in path.iter_segments(simplify=False, curves=True):
        if code == Path.CLOSEPOLY:
            parts.append("Z")
            continue
        numbers = [f"{x:.1f}" for x in points[: 2 * _POINTS[code]] * ([1, -1] * _POINTS[code])]
        parts.append(_LETTERS[code] + " ".join(number.removesuffix(".0") for number in numbers))
    return "".join(parts)
