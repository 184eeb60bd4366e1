"""What a side's function for a kind of job takes, and what it returns."""

from collections.abc import Callable
from typing import Any

import numpy as np

Inputs = dict[str, np.ndarray]
Timed = Callable[[], Any]
"""What is timed; what it returns is judged."""
