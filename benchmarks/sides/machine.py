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
    """Read the sizes of the data and unified caches of the first core, by level."""
    sizes = {}
    for folder in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        kind = (folder / "type").read_text().strip()
        if kind != "Instruction":
            level = (folder / "level").read_text().strip()
            sizes[f"L{level}"] = (folder / "size").read_text().strip()
    return sizes


def fastest(work: Callable[[], object], repeats: int = 7) -> float:
    work()
    times = []
    for _ in range(repeats):
        start = perf_counter()
        work()
        times.append(perf_counter() - start)
    return min(times)


def measure_copy_rate(n: int) -> float:
    """Measure the bytes per second, read plus written, of a copy of n float32 values."""
    source, destination = np.ones(n, np.float32), np.empty(n, np.float32)
    repeats = max(1, 2**24 // n)

    def work() -> None:
        for _ in range(repeats):
            np.copyto(destination, source)

    return 8.0 * n * repeats / fastest(work)


def measure_product_rate() -> float:
    """Measure the operations per second of a matrix product in single precision."""
    n = 768
    a = np.ones((n, n), np.float32)
    return 2.0 * n**3 / fastest(lambda: a @ a)


def measure_transform_rate() -> float:
    """Measure the operations per second of FFTs of length 2,048 in single precision: 5 n log2 n."""
    x = np.ones((64, 2048), np.complex64)
    return 64 * 5 * 2048 * 11 / fastest(lambda: scipy.fft.fft(x, axis=1))


def limit_s(work: MinimumWork, machine: Machine) -> tuple[float, str]:
    """Return the minimum time of a job at the measured rates, and the limiting quantity."""
    # Data may already be in the caches, so the cache rate gives the minimum.
    transfer_s = work.n_bytes / machine["cache_bytes_per_s"]
    rate = (
        machine["transform_operations_per_s"]
        if work.operation == "transforms"
        else machine["product_operations_per_s"]
    )
    arithmetic_s = work.n_operations / rate
    if transfer_s >= arithmetic_s:
        return transfer_s, f"{work.n_bytes / 1e6:.3g} MB moved in cache"
    return arithmetic_s, f"{work.n_operations / 1e6:.3g} M operations of {work.operation}"
