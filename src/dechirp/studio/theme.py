"""Colours of the page by what they mean, light and dark."""

from dataclasses import dataclass, fields
from importlib import resources
from typing import Literal

from bokeh.palettes import Viridis256
from bokeh.themes import Theme as Defaults

Shade = Literal["light", "dark"]


@dataclass(frozen=True)
class Theme:
    """Colours by what they mean."""

    shade: Shade
    ground: str
    """Behind tiles."""
    tile: str
    ink: str
    muted: str
    rule: str
    """Lines of axes and grids."""
    echo: str
    """What was measured."""
    truth: str
    threshold: str
    track: str
    cursor: str
    map: tuple[str, ...]
    """Of powers, weak to strong, even steps of lightness."""


# Okabe and Ito's colours, told apart by colour-blind readers, darkened on white.
LIGHT = Theme(
    shade="light",
    ground="#eef1f4",
    tile="#ffffff",
    ink="#1d2733",
    muted="#56626f",
    rule="#d5dbe1",
    echo="#0868ac",
    truth="#00795a",
    threshold="#c8500a",
    track="#8a3d8f",
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
    echo="#56b4e9",
    truth="#2fc39a",
    threshold="#f0a35e",
    track="#d99be0",
    cursor="#e6ebf0",
    map=tuple(Viridis256),
)


def of_pages() -> str:
    """Style that all pages share; widgets inherit its colours, which are properties: `--ink` ..."""
    light, dark = (f"{_properties(theme)} color-scheme: {theme.shade};" for theme in (LIGHT, DARK))
    css = resources.files("dechirp.studio").joinpath("page.css").read_text("utf-8")
    return f':root {{ {light} }}\n:root[data-shade="dark"] {{ {dark} }}\n{css}'


def _properties(theme: Theme) -> str:
    colours = (field.name for field in fields(theme) if field.name not in ("shade", "map"))
    return " ".join(f"--{name}: {getattr(theme, name)};" for name in colours)


def of_widgets() -> Defaults:
    """Style of all widgets of a page; its colours are variables, so that it needs no change.

    As text: a document that is given models by its theme looks through all it has for each.
    """
    css = resources.files("dechirp.studio").joinpath("widgets.css").read_text("utf-8")
    return Defaults(json={"attrs": {"Widget": {"stylesheets": [css]}}})
