"""Machine description with measured memory and arithmetic rates of one core."""

import os
import platform
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import scipy.fft

from sides.jobs import MinimumWork

Machine = dict[str, Any]


def measure_machine() -> Machine:
    """Measure the rates of one core (fastest of several runs); add names and sizes."""
    return {
        "cpu": read_cpu_name(),
        "cores": os.cpu_count(),
        "caches": read_cache_sizes(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "load": os.getloadavg()[0],
        "memory_bytes_per_s": measure_copy_rate(2**25),
        "cache_bytes_per_s": measure_copy_rate(2**15),
        "product_operations_per_s": measure_product_rate(),
        "transform_operations_per_s": measure_transform_rate(),
    }


def read_cpu_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()


def read_cache_sizes() -> dict[str, str]:
    """Data and shared caches of the first core, by level."""
    sizes = {}
    for place in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        kind = (place / "type").read_text().strip()
        if kind != "Instruction":
            level = (place / "level").read_text().strip()
            sizes[f"L{level}"] = (place / "size").read_text().strip()
    return sizes


def fastest(work: Callable[[], object], goes: int = 7) -> float:
    work()
    times = []
    for _ in range(goes):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure_copy_rate(n: int) -> float:
    """Bytes read and written in a second, copying n float32."""
    source, to = np.ones(n, np.float32), np.empty(n, np.float32)
    repeats = max(1, 2**24 // n)

    def work() -> None:
        for _ in range(repeats):
            np.copyto(to, source)

    return 8.0 * n * repeats / fastest(work)


def measure_product_rate() -> float:
    """Operations a second of a matrix product in single precision."""
    n = 768
    a = np.ones((n, n), np.float32)
    return 2.0 * n**3 / fastest(lambda: a @ a)


def measure_transform_rate() -> float:
    """Operations a second of transforms of 2,048 in single precision, 5 n log2 n of each."""
    x = np.ones((64, 2048), np.complex64)
    return 64 * 5 * 2048 * 11 / fastest(lambda: scipy.fft.fft(x, axis=1))


def limit_s(needs: MinimumWork, machine: Machine) -> tuple[float, str]:
    """Return the minimum time at the measured rates and the limiting quantity."""
    # What fits into the caches twice over need not come from memory.
    of_bytes = needs.n_bytes / machine["cache_bytes_per_s"]
    rate = (
        machine["transform_operations_per_s"]
        if needs.operation == "transforms"
        else machine["product_operations_per_s"]
    )
    of_operations = needs.n_operations / rate
    if of_bytes >= of_operations:
        return of_bytes, f"{needs.n_bytes / 1e6:.3g} MB moved in cache"
    return of_operations, f"{needs.n_operations / 1e6:.3g} M operations of {needs.operation}"
