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
            got=f"to be written or read by {name.partition('.')[0]}, while "
            f"{error.name or name} is not installed",
            need="the libraries of the extra io",
            fix="Run pip install 'dechirp[io]'.",
        ) from None
