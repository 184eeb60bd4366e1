"""What pages share: how templates are read, how they look, and what they are made with."""

import importlib.metadata
import platform
from functools import cache
from importlib.resources import files

from jinja2 import Environment, StrictUndefined, Template
from markupsafe import Markup

_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "matplotlib")


@cache
def template(name: str) -> Template:
    """Read the template of a page of results; `css` is in it how all of them look."""
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["css"] = Markup(_text("page.css"))
    return environment.from_string(_text(name))


def versions() -> list[tuple[str, str]]:
    """Name and version of what results depend on."""
    known = [("Python", platform.python_version())]
    for name in ("dechirp", *_LIBRARIES):
        try:
            known.append((name, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:  # imported from a folder, not installed
            continue
    return known


def _text(name: str) -> str:
    return files("dechirp.report").joinpath(name).read_text(encoding="utf-8")
