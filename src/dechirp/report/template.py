"""Templates of pages, and the dates and library versions that pages show."""

import importlib.metadata
import platform
import re
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from jinja2 import (
    ChoiceLoader,
    Environment,
    FileSystemBytecodeCache,
    PackageLoader,
    StrictUndefined,
    Template,
)
from jinja2.bccache import Bucket

from dechirp.core.disk_cache import cache_folder

# fmt: off
_MONTHS = (
    "January", "February", "March", "April", "May", "June",
    "July", "August", "September", "October", "November", "December",
)
# fmt: on
_SPACE_BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=(?:[kMGmµn]?(?:m|s|Hz|W)|km/h|m/s|MHz/µs|rad|dB\w{0,2}|%|°)(?![\w/]))"
)
_LIBRARIES = ("numpy", "scipy", "numba", "xarray", "matplotlib")


class _CompiledTemplates(FileSystemBytecodeCache):
    """Compiled templates on disk, where it can be written: compiling them takes 0.04 s."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        with suppress(OSError):
            Path(self.directory).mkdir(parents=True, exist_ok=True)
            super().dump_bytecode(bucket)


@cache
def template_environment(*packages: str) -> Environment:
    """Return the templates of this folder and of further packages.

    All pages extend `base.html`, with the macros of `parts.html`.
    """
    folder = cache_folder()
    environment = Environment(
        bytecode_cache=None if folder is None else _CompiledTemplates(str(folder / "templates")),
        loader=ChoiceLoader([PackageLoader(name, "") for name in ("dechirp.report", *packages)]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["versions"] = library_versions
    environment.filters["unbroken"] = keep_numbers_and_units_together
    return environment


def keep_numbers_and_units_together(text: str) -> str:
    """Put no-break spaces between numbers and their units, so that lines do not end between them.

    Only for texts that nobody copies into a settings file, which has plain spaces.
    """
    return type(text)(_SPACE_BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", text))  # safe HTML stays safe


def load_template(name: str) -> Template:
    """Load a page template of this folder."""
    return template_environment().get_template(name)


@cache
def library_versions() -> tuple[tuple[str, str], ...]:
    """Return names and versions of Python and of the libraries: reading them takes 30 ms."""
    versions = [("Python", platform.python_version())]
    for name in ("dechirp", *_LIBRARIES):
        try:
            versions.append((name, importlib.metadata.version(name)))
        except importlib.metadata.PackageNotFoundError:  # imported from a folder, not installed
            continue
    return tuple(versions)


def format_date_and_time(iso: str) -> str:
    """Write an ISO 8601 date to the minute, in English and UTC; UTC is the default time zone."""
    date = datetime.fromisoformat(iso)
    date = date.replace(tzinfo=UTC) if date.tzinfo is None else date.astimezone(UTC)
    return f"{date.day} {_MONTHS[date.month - 1]} {date:%Y, %H:%M} UTC"
