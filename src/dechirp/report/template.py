"""What pages share: how templates are read, and what they are made with."""

import importlib.metadata
import platform
from functools import cache

from jinja2 import Environment, PackageLoader, StrictUndefined, Template

_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "matplotlib")


@cache
def environment() -> Environment:
    """Templates of this folder; all of them extend `base.html`, of parts in `parts.html`."""
    made = Environment(
        loader=PackageLoader("dechirp.report", ""),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.globals["versions"] = versions
    return made


def template(name: str) -> Template:
    """Read the template of a page of results."""
    return environment().get_template(name)


def versions() -> list[tuple[str, str]]:
    """Name and version of what results depend on."""
    known = [("Python", platform.python_version())]
    for name in ("dechirp", *_LIBRARIES):
        try:
            known.append((name, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:  # imported from a folder, not installed
            continue
    return known
