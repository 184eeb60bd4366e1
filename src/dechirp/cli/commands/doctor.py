"""`dechirp doctor`: check of versions, extras, memory and compiled kernels."""

import re
import sys
from typing import Any

from dechirp.cli.options import Json


def doctor(*, as_json: Json = False) -> int:
    """Check versions, extras, memory and compiled kernels.

    The exit status is 1 if a required part is missing or does not work.
    """
    import os
    import platform

    import dechirp
    from dechirp.core.memory import available_memory_bytes
    from dechirp.core.threads import thread_count
    from dechirp.results.text_files import to_json_text

    dependencies, extras = _dependency_and_extra_versions()
    kernels, problem = _try_run_and_find_kernel_origins()
    document = {
        "version": dechirp.__version__,
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        "dependencies": dependencies,
        "extras": extras,
        "cores": os.cpu_count(),
        "threads": thread_count(),
        "free_memory_bytes": available_memory_bytes(),
        "kernels": kernels,
        "problem": problem,
    }
    if as_json:
        print(to_json_text(document), end="")
    else:
        _print_installation_check(document)
    return 1 if problem or None in dependencies.values() else 0


def _dependency_and_extra_versions() -> tuple[
    dict[str, str | None], dict[str, dict[str, str | None]]
]:
    """Return the version of each dependency and of those of each extra; None if missing."""
    from importlib.metadata import PackageNotFoundError, requires, version

    def installed_version(name: str) -> str | None:
        try:
            return version(name)
        except PackageNotFoundError:
            return None

    needed: dict[str, str | None] = {}
    extras: dict[str, dict[str, str | None]] = {}
    # None in a bare checkout.
    lines = (requires("dechirp") or []) if installed_version("dechirp") else []
    for line in lines:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([^'\"]+)", line)
        group = extras.setdefault(extra[1], {}) if extra else needed
        group[name] = installed_version(name)
    return needed, extras


def _try_run_and_find_kernel_origins() -> tuple[dict[str, str], str | None]:
    """Run a small scenario; return the origin of each compiled kernel and the error, if any."""
    import math

    from dechirp.core.compiled_kernels import Kernel, plain_twins_for_small_work
    from dechirp.experiments.run import run
    from dechirp.experiments.scenario import reference

    try:
        with plain_twins_for_small_work(math.inf):  # compiled kernels, even for small work
            run(reference(["radar.frame.n_chirps=32"]))
    except Exception as error:  # any failure is the result of this check
        return {}, f"{type(error).__name__}: {error}"
    kernels: dict[str, str] = {}
    for module in [m for name, m in sys.modules.items() if name.startswith("dechirp.")]:
        for name, kernel in vars(module).items():
            dispatcher = kernel.used_dispatcher if isinstance(kernel, Kernel) else None
            if dispatcher is not None and dispatcher.signatures:
                file = dispatcher.py_func.__module__.rpartition(".")[2]
                stats = dispatcher.stats
                cache_state = "kept for later" if stats.cache_path else "not kept: no cache"
                origin = "from the cache" if stats.cache_hits else f"compiled, {cache_state}"
                kernels[f"{file}.{name.lstrip('_')}"] = origin
    return kernels, None


def _print_installation_check(document: dict[str, Any]) -> None:
    from dechirp.cli.console import new_table, open_stdout_console

    screen = open_stdout_console()
    rows = new_table(f"dechirp {document['version']}", text_columns=["", ""])
    rows.show_header = False
    rows.add_row("Python", document["python"])
    for name, version in document["dependencies"].items():
        rows.add_row(name, version or "missing")
    for name, group in document["extras"].items():
        missing = [part for part, version in group.items() if version is None]
        rows.add_row(f"extra {name}", f"without {', '.join(missing)}" if missing else "complete")
    rows.add_row("machine", document["machine"])
    rows.add_row("cores, threads", f"{document['cores']}, {document['threads']}")
    rows.add_row("free memory", f"{document['free_memory_bytes'] / 2**30:.1f} GiB")
    for name, state in document["kernels"].items():
        rows.add_row(f"kernel {name}", state)
    screen.print(rows)
    if not document["dependencies"]:
        screen.print("The package is not installed, so its requirements are unknown.")
    if document["problem"]:
        screen.print(f"A small run failed: {document['problem']}")
