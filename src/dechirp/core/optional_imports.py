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
    except ModuleNotFoundError as error:
        reason = f"{error.name or name}, which is not installed"
        fix = f"run pip install 'dechirp[{extra}]'"
    except (ImportError, OSError) as error:  # OSError: soundfile without the library libsndfile
        reason = f"{name}, which cannot be loaded: {error}"
        fix = (
            "install the library that the reason names with the packages of the system, or run"
            f" pip install --force-reinstall 'dechirp[{extra}]'"
        )
    raise InvalidSetting(
        setting,
        value=f"a format that needs {reason}",
        expected=f"a format without optional dependencies, or the extra {extra} installed",
        fix=fix,
    )
