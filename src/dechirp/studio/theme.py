"""Colours of the page by role, light and dark."""

from dataclasses import dataclass, fields
from importlib import resources
from typing import Literal

from bokeh.palettes import Viridis256
from bokeh.themes import Theme as Defaults

Shade = Literal["light", "dark"]


@dataclass(frozen=True)
class Theme:
    """Colours by role."""

    shade: Shade
    ground: str
    """Background behind tiles."""
    tile: str
    ink: str
    muted: str
    rule: str
    """Lines of axes and grids."""
    edge: str
    """Edges of fields and buttons, 3:1 against their surroundings as WCAG 1.4.11 demands."""
    echo: str
    """Measured values."""
    truth: str
    threshold: str
    track: str
    cursor: str
    map: tuple[str, ...]
    """Colour map of powers, weak to strong, perceptually uniform."""


# Colours after Okabe and Ito, darkened on white. Without the cones for red or for green, echoes and
# tracks still differ by 28 units of CIELAB and more.
LIGHT = Theme(
    shade="light",
    ground="#eef1f4",
    tile="#ffffff",
    ink="#1d2733",
    muted="#56626f",
    rule="#d5dbe1",
    edge="#78838f",
    echo="#0868ac",
    truth="#00795a",
    threshold="#c8500a",
    track="#6e14c8",
    cursor="#1d2733",
    map=tuple(Viridis256),
)
DARK = Theme(
    shade="dark",
    ground="#12161b",
    tile="#1b2128",
    ink="#e6ebf0",
    muted="#9aa7b4",
    rule="#343d47",
    edge="#74808c",
    echo="#56b4e9",
    truth="#2fc39a",
    threshold="#f0a35e",
    track="#ffe94a",
    cursor="#e6ebf0",
    map=tuple(Viridis256),
)


def page_css() -> str:
    """Return the style sheet of all pages; widgets inherit its colour properties: `--ink` ..."""
    light, dark = (
        f"{_theme_css_properties(theme)} color-scheme: {theme.shade};" for theme in (LIGHT, DARK)
    )
    css = resources.files("dechirp.studio").joinpath("page.css").read_text("utf-8")
    return f':root {{ {light} }}\n:root[data-shade="dark"] {{ {dark} }}\n{css}'


def _theme_css_properties(theme: Theme) -> str:
    colours = (field.name for field in fields(theme) if field.name not in ("shade", "map"))
    return " ".join(f"--{name}: {getattr(theme, name)};" for name in colours)


def bokeh_widget_theme() -> Defaults:
    """Return the Bokeh theme of all widgets; its colours are variables that follow the page.

    The style is text: models in a theme would make Bokeh scan all models for each of them.
    """
    css = resources.files("dechirp.studio").joinpath("widgets.css").read_text("utf-8")
    return Defaults(json={"attrs": {"Widget": {"stylesheets": [css]}}})
