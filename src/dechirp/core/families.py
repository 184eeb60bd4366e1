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
from importlib.metadata import entry_points
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
        folder = importlib.import_module(cls.__module__.rpartition(".")[0])
        for module in pkgutil.iter_modules(folder.__path__, folder.__name__ + "."):
            importlib.import_module(module.name)
        for guest in entry_points(group=cls.group):
            guest.load()
        return {member.kind(): member for member in sorted(_final(cls), key=lambda m: m.kind())}


def _final(cls: type[Family]) -> Iterator[type[Family]]:
    for sub in cls.__subclasses__():
        if inspect.isabstract(sub) or sub.__subclasses__():
            yield from _final(sub)
        else:
            yield sub
