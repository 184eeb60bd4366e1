"""Optional dependencies, imported on first use."""

import importlib
from typing import Any

from dechirp.core.errors import InvalidSetting


def import_from_extra(extra: str, name: str, *, setting: str = "objects") -> Any:
    """Import a module of an extra, or raise `InvalidSetting` with the install command.

    `setting`: what it would read or write, in the words of the setting.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InvalidSetting(
            setting,
            value=f"a format that needs {error.name or name}, which is not installed",
            expected=f"a format without optional dependencies, or the extra {extra} installed",
            fix=f"run pip install 'dechirp[{extra}]'",
        ) from None
