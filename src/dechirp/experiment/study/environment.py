"""What results depend on to the bit beside the study itself: versions and the processor."""

import platform
from functools import cache
from importlib.metadata import PackageNotFoundError, version

LIBRARIES = ("dechirp", "numpy", "scipy", "numba")


@cache
def versions() -> dict[str, str]:
    """Versions that trials must share, by name: Python's and those of the libraries."""
    found = {"python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # imported from a folder, not installed
            found[name] = "not installed"
    return found


@cache
def environment() -> dict[str, str]:
    """Versions, system and processor of this process, by name.

    The processor is named as compilers do: code that was compiled for the same name, by the
    same libraries, rounds alike.
    """
    from llvmlite.binding import get_host_cpu_name

    return {
        **versions(),
        "system": f"{platform.system()} {platform.machine()}",
        "processor": get_host_cpu_name(),
    }


def differences(here: dict[str, str], there: dict[str, str]) -> list[str]:
    """Names of what is another there."""
    return [name for name in {**here, **there} if here.get(name) != there.get(name)]
