"""What did not come through on a bus or a network is told, and its lists left out."""

import warnings
from collections.abc import Mapping

from dechirp.core.findings import Finding, PhysicsWarning


def say_lost(counts: Mapping[str, int], *, left: str, need: str, fix: str) -> None:
    """Warn of what did not come through: how many of what, and which lists are left."""
    said = [f"{n} {what}" for what, n in counts.items() if n]
    if said:
        finding = Finding(
            level="warning",
            setting="objects",
            got=f"{', '.join(said)}; {left}",
            need=need,
            fix=f"Lists that are not whole are left out. {fix}",
        )
        warnings.warn(PhysicsWarning(finding), stacklevel=4)
