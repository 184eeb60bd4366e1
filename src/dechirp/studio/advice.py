"""What messages about recordings advise: options of the command line, and what the page has."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

from dechirp.core.errors import DechirpError

_IN_PYTHON = re.compile(r" \(\w+=[^()]*\)")
_CHOSEN = (
    ("Give the radar: --radar FILE", "Choose settings of its radar, under Recordings"),
    ("with --radar", "as settings of its radar, under Recordings"),
)
_WRITTEN = re.compile(r"--(axes|device|encoding|format|iq)\b(?: ([\w,-]+))?")


def for_page(fix: str) -> str:
    """How to mend something on the page: what its panels offer, else a setting of the file."""
    fix = _IN_PYTHON.sub("", fix)
    for option, panel in _CHOSEN:
        fix = fix.replace(option, panel)
    return _WRITTEN.sub(_written, fix)


def _written(option: re.Match[str]) -> str:
    name, given = option.groups()
    return f"recording.{name}{f': {given}' if given else ''} (under File)"


@contextmanager
def advised() -> Iterator[None]:
    """Let errors inside say how they are mended on the page."""
    try:
        yield
    except DechirpError as error:
        mistakes = (replace(one, fix=for_page(one.fix)) for one in error.mistakes)
        raise DechirpError(*mistakes) from None
