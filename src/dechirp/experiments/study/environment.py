"""Environment on which bitwise results depend in addition to the study: versions and processor."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

LIBRARIES = ("dechirp", "numpy", "scipy", "numba")


@cache
def library_versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries, by name; all trials must share them."""
    versions = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            versions[name] = version(name)
        except PackageNotFoundError:  # imported from a folder, not installed
            versions[name] = "not installed"
    return versions


@cache
def versions_system_and_processor() -> dict[str, str]:
    """Return versions, system and processor of this process, by name.

    The processor has the name that compilers use: code that the same libraries compile for the same
    name rounds alike.
    """
    from llvmlite.binding import get_host_cpu_name

    return {
        **library_versions(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": get_host_cpu_name(),
    }


def keys_with_different_values(first: dict[str, str], second: dict[str, str]) -> list[str]:
    """Return the names whose values differ between two environments."""
    return [name for name in {**first, **second} if first.get(name) != second.get(name)]
