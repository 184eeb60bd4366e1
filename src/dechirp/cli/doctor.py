"""`dechirp doctor`: what is installed, and whether it works."""

import re
import sys
from typing import Any

from dechirp.cli.options import Json


def doctor(*, as_json: Json = False) -> int:
    """Check versions, extras, memory and compiled kernels.

    Ends with status 1 if something that is needed is missing or does not work.
    """
    import os
    import platform

    import numba

    import dechirp
    from dechirp.core.memory import free_bytes
    from dechirp.store.tables import json_text

    needed, extras = _installed()
    kernels, problem = _kernels()
    found = {
        "version": dechirp.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "dependencies": needed,
        "extras": extras,
        "cores": os.cpu_count(),
        "threads": numba.get_num_threads(),
        "free_memory_bytes": free_bytes(),
        "kernels": kernels,
        "problem": problem,
    }
    if as_json:
        print(json_text(found), end="")
    else:
        _show(found)
    return 1 if problem or None in needed.values() else 0


def _installed() -> tuple[dict[str, str | None], dict[str, dict[str, str | None]]]:
    """Version of each dependency, and of those of each extra; None where one is missing."""
    from importlib.metadata import PackageNotFoundError, requires, version

    def found(name: str) -> str | None:
        try:
            return version(name)
        except PackageNotFoundError:
            return None

    needed: dict[str, str | None] = {}
    extras: dict[str, dict[str, str | None]] = {}
    lines = (requires("dechirp") or []) if found("dechirp") else []  # none in a bare checkout
    for line in lines:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([^'\"]+)", line)
        group = extras.setdefault(extra[1], {}) if extra else needed
        group[name] = found(name)
    return needed, extras


def _kernels() -> tuple[dict[str, str], str | None]:
    """Where each compiled kernel came from in a small run, and what went wrong with one."""
    from numba.core.dispatcher import Dispatcher

    from dechirp.experiment.run import run
    from dechirp.experiment.scenario import reference

    try:
        run(reference(["radar.frame.n_chirps=32"]))
    except Exception as error:  # whatever it is, it is what was asked for
        return {}, f"{type(error).__name__}: {error}"
    kernels: dict[str, str] = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("dechirp.")]:
        for name, kernel in vars(module).items():
            if isinstance(kernel, Dispatcher) and kernel.signatures:
                file = kernel.py_func.__module__.rpartition(".")[2]
                kept = "kept for later" if kernel.stats.cache_path else "not kept: no cache"
                came = "from the cache" if kernel.stats.cache_hits else f"compiled, {kept}"
                kernels[f"{file}.{name.lstrip('_')}"] = came
    return kernels, None


def _show(found: dict[str, Any]) -> None:
    from dechirp.cli.show import console, table

    screen = console()
    versions = table(f"dechirp {found['version']}", left=["", ""])
    versions.show_header = False
    versions.add_row("Python", found["python"])
    for name, version in found["dependencies"].items():
        versions.add_row(name, version or "missing")
    for name, group in found["extras"].items():
        missing = [part for part, version in group.items() if version is None]
        versions.add_row(
            f"extra {name}", f"without {', '.join(missing)}" if missing else "complete"
        )
    versions.add_row("machine", found["machine"])
    versions.add_row("cores, threads", f"{found['cores']}, {found['threads']}")
    versions.add_row("free memory", f"{found['free_memory_bytes'] / 2**30:.1f} GiB")
    for name, state in found["kernels"].items():
        versions.add_row(f"kernel {name}", state)
    screen.print(versions)
    if not found["dependencies"]:
        screen.print("Not installed, so its requirements are not known.")
    if found["problem"]:
        screen.print(f"A small run failed: {found['problem']}")
