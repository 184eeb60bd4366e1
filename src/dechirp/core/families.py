"""Families: a folder holds the base class, every other file in it is a member.

A member is a final class; its `kind`, by which settings files choose it, is its file's
name with hyphens. Adding the file is the whole of adding a member. Another package joins
with an entry point in the family's group, such as `dechirp.cfar`.
"""

import importlib
import inspect
import pkgutil
from abc import ABC
from collections.abc import Iterator
from functools import cache
from importlib.metadata import EntryPoints, entry_points
from typing import ClassVar


class Family(ABC):
    """Base of the classes that a settings file chooses by `kind`."""

    group: ClassVar[str]
    """Entry-point group through which other packages add members."""

    @classmethod
    def kind(cls) -> str:
        """Name of the member in settings files."""
        return cls.__module__.rpartition(".")[2].replace("_", "-")

    @classmethod
    def members(cls) -> dict[str, type]:
        """Final classes by kind: from the files in the folder, and from guests."""
        members, _ = cls._gathered()
        return dict(sorted(members.items()))

    @classmethod
    def missing_guests(cls) -> dict[str, str]:
        """Why entry points give no member, by their names.

        A guest that is broken takes nothing from what does without it, and one that goes by the
        kind of another member does not take its place.
        """
        _, reasons = cls._gathered()
        return reasons

    @classmethod
    def _gathered(cls) -> tuple[dict[str, type], dict[str, str]]:
        """Members by kind, and why guests are none."""
        folder = importlib.import_module(cls.__module__.rpartition(".")[0])
        for module in pkgutil.iter_modules(folder.__path__, folder.__name__ + "."):
            importlib.import_module(module.name)
        inside = f"{folder.__name__}."  # a guest that inherits from a member leaves it one
        own = (one for one in _final(cls, inside) if one.__module__.startswith(inside))
        members: dict[str, type] = {one.kind(): one for one in own}
        reasons = {}
        for guest in _guests(cls.group):
            try:
                loaded = guest.load()
            except Exception as error:  # of another package, at import: it may be any
                reasons[guest.name] = f"{guest.value} raises {type(error).__name__}: {error}"
                continue
            if not (inspect.isclass(loaded) and issubclass(loaded, cls)):
                reasons[guest.name] = f"{guest.value} is no {cls.__name__}"
            elif inspect.isabstract(loaded):
                lacks = ", ".join(sorted(loaded.__abstractmethods__))
                reasons[guest.name] = f"{guest.value} does not give {lacks}"
            elif (first := members.setdefault(loaded.kind(), loaded)) is not loaded:
                other = f"{first.__module__}:{first.__qualname__}"
                reasons[guest.name] = f"{guest.value} goes by {loaded.kind()}, as {other} does"
        for one in _final(cls):  # those that a notebook defines have no entry point
            members.setdefault(one.kind(), one)
        return members, reasons


@cache
def _guests(group: str) -> EntryPoints:
    return entry_points(group=group)  # 10 ms, and a file of settings asks several times


def _final(cls: type[Family], inside: str = "") -> Iterator[type[Family]]:
    """Classes that no other is made of, of those whose module begins so."""
    for sub in cls.__subclasses__():
        below = any(one.__module__.startswith(inside) for one in sub.__subclasses__())
        if inspect.isabstract(sub) or below:
            yield from _final(sub, inside)
        else:
            yield sub
