"""Libraries that not everybody needs: imported when they are used, or named when missing."""

import importlib
from typing import Any

from dechirp.core.errors import InvalidSetting


def library(name: str, *, of: str = "objects") -> Any:
    """Import a module of the extra `io`, or raise `InvalidSetting` that says how to get it.

    `of`: what it would read or write, in the words of the setting.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidSetting(
            of,
            got=f"of a format that needs {error.name or name}, which is not installed",
            need="of one that needs nothing else, or the extra io installed",
            fix="Run pip install 'dechirp[io]'.",
        ) from None
