"""A block of trials on a worker, which has the versions that the others have."""

import pickle
import platform
from functools import lru_cache
from typing import Any

from dechirp.core.errors import DechirpError, Mistake
from dechirp.experiment.study.block import Block
from dechirp.experiment.study.environment import differences, versions


def worked(packed: bytes, made_with: dict[str, str], point: int, number: int) -> Block:
    """Make one block, on a worker."""
    _must_be_alike(tuple(made_with.items()))
    work, plan = _unpacked(packed)
    return work(plan, point, number)


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Any:
    """Work and plan, kept: a plan is some hundred times larger than what changes."""
    return pickle.loads(packed)


@lru_cache(maxsize=4)
def _must_be_alike(made_with: tuple[tuple[str, str], ...]) -> None:
    """Refuse to work with other versions: workers may join while a study runs."""
    there = dict(made_with)
    names = differences(there, versions())
    if names:
        raise DechirpError(
            Mistake(
                setting=f"worker on {platform.node()}",
                got=", ".join(f"{name} {versions().get(name, 'absent')}" for name in names),
                need=", ".join(f"{name} {there.get(name, 'absent')}" for name in names),
                fix="Install the same versions there, and call again to go on.",
            )
        )
