"""Values beyond what a signal or a field can say are told as the nearest that can be said."""

import warnings
from collections.abc import Mapping

from dechirp.core.findings import Finding, PhysicsWarning


def say_beyond(where: str, beyond: Mapping[str, int]) -> None:
    """Warn of values that were beyond what could be told: how many, by name and range."""
    counts = {name: n for name, n in beyond.items() if n}
    if counts:
        finding = Finding(
            level="warning",
            setting="objects",
            got=f"{sum(counts.values())} values told as the nearest that {where} can say: "
            + ", ".join(f"{n} of {name}" for name, n in counts.items()),
            need="values within those ranges",
            fix="Leave such objects out, or take a wider signal.",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=3)
