"""Types of the inputs and timed calls of benchmark jobs."""

from collections.abc import Callable
from typing import Any

import numpy as np

Inputs = dict[str, np.ndarray]
Timed = Callable[[], Any]
"""Timed call; its return value is used to measure the accuracy."""
