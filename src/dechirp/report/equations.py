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
_EM = 100.0  # units of the outlines at this size
_DISPLAY = re.compile(r"\\\[(\w+)\|(.*?)\\\]", re.DOTALL)
_INLINE = re.compile(r"\\\((.*?)\\\)", re.DOTALL)
_REFERENCE = re.compile(r"\\eqref\{(\w+)\}")
_LETTERS = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C"}
_POINTS = {Path.MOVETO: 1, Path.LINETO: 1, Path.CURVE3: 2, Path.CURVE4: 3}


def typeset(text: str) -> str:
    """Replace all mathematics in a page by SVG, equations numbered as they come.

    Raises
    ------
    KeyError
        If the page refers to an equation that it does not have.
    """
    numbers = {match[1]: number for number, match in enumerate(_DISPLAY.finditer(text), start=1)}

    def displayed(match: re.Match[str]) -> str:
        name = match[1]
        return (
            f'<div class="equation" id="eq-{name}"><span>{svg(match[2])}</span>'
            f"<i>({numbers[name]})</i></div>"
        )

    text = _DISPLAY.sub(displayed, text)
    text = _INLINE.sub(lambda match: svg(match[1]), text)
    return _REFERENCE.sub(lambda match: f'<a href="#eq-{match[1]}">({numbers[match[1]]})</a>', text)


@cache
def svg(tex: str) -> Markup:
    """Formula as an SVG of outlines in the colour of the text, its baseline on the line's."""
    tex = " ".join(tex.split())
    math = f"${tex}$"
    width, height, descent = text_to_path.get_text_width_height_descent(math, _FONT, ismath=True)
    vertices, codes = text_to_path.get_text_path(_FONT, math, ismath=True)
    outline = Path(vertices, codes)
    box = outline.get_extents()
    # Slanted letters reach beyond their own width.
    left, right = min(box.x0, 0.0), max(box.x1, width)
    bottom, top = min(box.y0, -descent), max(box.y1, height - descent)
    label = escape(tex).replace("{", "&#123;")  # no brace that a template would read
    return Markup(
        f'<svg class="math" role="img" aria-label="{label}"'
        f' viewBox="{left:.0f} {-top:.0f} {right - left:.0f} {top - bottom:.0f}"'
        f' style="width:{(right - left) / _EM:.3f}em;vertical-align:{bottom / _EM:.3f}em">'
        f'<path d="{_outline(outline)}"/></svg>'
    )


def _outline(path: Path) -> str:
    """Data of an SVG path, y down."""
    parts = []
    for points, code in path.iter_segments(simplify=False, curves=True):
        if code == Path.CLOSEPOLY:
            parts.append("Z")
            continue
        numbers = [f"{x:.1f}" for x in points[: 2 * _POINTS[code]] * ([1, -1] * _POINTS[code])]
        parts.append(_LETTERS[code] + " ".join(number.removesuffix(".0") for number in numbers))
    return "".join(parts)
