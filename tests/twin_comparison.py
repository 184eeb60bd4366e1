"""Comparison of kernels with their plain twins, as a plugin of pytest.

`pytest -p twin_comparison` calls each kernel twice, compiled and plain, in all tests that it runs,
and writes the largest difference of each kernel to the file of the variable TWIN_DIFFERENCES.
"""

import copy
import json
import os
from collections import Counter
from contextvars import ContextVar
from pathlib import Path

import numpy as np

from dechirp.core import compiled_kernels
from dechirp.core.compiled_kernels import Kernel, plain_twins_for_small_work

# Loops of plain Python take up to 1 us for each number and step.
MAX_NUMBERS, MAX_COMPARISONS = 300_000, 2

_is_inside = ContextVar("_is_inside", default=False)


def relative_difference(first, second):
    """Return the largest difference over the largest size; infinite for other special values."""
    if isinstance(first, tuple):
        return max(map(relative_difference, first, second), default=0.0)
    if first is None:
        return 0.0 if second is None else np.inf
    first, second = np.asarray(first), np.asarray(second)
    if first.shape != second.shape:
        return np.inf
    if first.dtype.kind not in "fc":
        return float(np.any(first != second))
    is_finite = np.isfinite(first)
    if not np.array_equal(first[~is_finite], second[~is_finite], equal_nan=True):
        return np.inf
    first, second = first[is_finite], second[is_finite]
    largest = np.max(abs(first), initial=0.0)
    return float(np.max(abs(first - second), initial=0.0) / largest) if largest else 0.0


def call_both(call, kernel, arguments):
    """Call a kernel in both forms; return the compiled result and the difference."""
    plain_arguments = copy.deepcopy(arguments)
    result = call(kernel, *arguments)
    token = _is_inside.set(True)
    try:
        with plain_twins_for_small_work(0):
            plain_result = call(kernel, *plain_arguments)
    finally:
        _is_inside.reset(token)
    # The last two arguments of the direct kernel are buffers, which the twin does not need.
    n_compared = 19 if kernel.__name__ == "_add_echoes_chirp_by_chirp" else len(arguments)
    compared = ((result, *arguments[:n_compared]), (plain_result, *plain_arguments[:n_compared]))
    return result, relative_difference(*compared)


def kernel_name(kernel):
    return f"{kernel.__module__.removeprefix('dechirp.')}.{kernel.__name__}"


def compare_in_calls(differences, *, max_numbers=np.inf, max_comparisons=np.inf):
    """Return a replacement of `Kernel.__call__` that collects the differences by kernel."""
    call, n_compared = Kernel.__call__, Counter()

    def compare(self, *arguments, **named):
        name = kernel_name(self)
        is_compared = (
            self.plain is not None
            and not (named or _is_inside.get() or n_compared[name] >= max_comparisons)
            and sum(getattr(argument, "size", 1) for argument in arguments) <= max_numbers
            and compiled_kernels.uses_compiled_kernels()
        )
        if not is_compared:
            return call(self, *arguments, **named)
        result, difference = call_both(call, self, arguments)
        n_compared[name] += 1
        differences[name] = max(differences.get(name, 0.0), difference)
        return result

    return compare


def pytest_configure(config):
    config.twin_differences = {}
    Kernel.__call__ = compare_in_calls(
        config.twin_differences, max_numbers=MAX_NUMBERS, max_comparisons=MAX_COMPARISONS
    )
    compiled_kernels.use_compiled_kernels()


def pytest_unconfigure(config):
    Path(os.environ["TWIN_DIFFERENCES"]).write_text(json.dumps(config.twin_differences))
