"""Optional dependencies, imported on first use."""

import importlib
from typing import Any

from dechirp.core.errors import InvalidSetting


def import_from_io_extra(name: str, *, setting: str = "objects") -> Any:
    """Import a module of the extra `io`, or raise `InvalidSetting` with the install command.

    `setting`: what it would read or write, in the words of the setting.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidSetting(
            setting,
            value=f"a format that needs {error.name or name}, which is not installed",
            expected="a format without optional dependencies, or the extra io installed",
            fix="run pip install 'dechirp[io]'",
        ) from None
