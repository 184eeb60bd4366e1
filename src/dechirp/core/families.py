"""Families: interchangeable classes, one folder a family, which settings files select by `kind`.

The folder contains the base class in `base.py`, and members in the other files. A member is a
final class; its `kind` is its name in lower case with hyphens: `OrderedStatistic` has the kind
`ordered-statistic`. A new file is all that a new member needs. Other packages add members by entry
points in the group of the family, such as `dechirp.cfar`.
"""

import importlib
import inspect
import pkgutil
import re
from abc import ABC
from collections.abc import Iterator
from functools import cache
from importlib.metadata import entry_points
from typing import Any, ClassVar


class Family(ABC):
    """Base class of the classes that a settings file selects by `kind`."""

    group: ClassVar[str]
    """Entry-point group through which other packages add members."""
    experimental: ClassVar[bool] = False
    """True for a member never tried on real data; `dechirp list` marks it."""

    @classmethod
    def kind(cls) -> str:
        """Return the name of the member in settings files."""
        return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "-", cls.__name__).lower()

    @classmethod
    def members(cls) -> dict[str, type]:
        """Return the final classes by kind: from the folder, plug-ins and notebooks."""
        members, _ = cls._collect_members_and_failures()
        return dict(sorted(members.items()))

    @classmethod
    def failed_plugins(cls) -> dict[str, str]:
        """Return the reasons why entry points supply no member, by their names.

        A broken plug-in affects no other member, and one with the kind of another member does
        not replace it.
        """
        _, reasons = cls._collect_members_and_failures()
        return reasons

    @classmethod
    def _collect_members_and_failures(cls) -> tuple[dict[str, type], dict[str, str]]:
        """Return the members by kind, and the reasons of failed plug-ins."""
        folder = importlib.import_module(cls.__module__.rpartition(".")[0])
        for module in pkgutil.iter_modules(folder.__path__, folder.__name__ + "."):
            importlib.import_module(module.name)
        prefix = f"{folder.__name__}."  # a member that a plug-in inherits from remains a member
        members: dict[str, type] = {
            member.kind(): member
            for member in _iter_concrete_leaf_classes(cls, prefix)
            if member.__module__.startswith(prefix)
        }
        reasons = {}
        for plugin in _entry_points().select(group=cls.group):
            try:
                loaded = plugin.load()
            except Exception as error:  # importing another package may raise anything
                reasons[plugin.name] = f"{plugin.value} raises {type(error).__name__}: {error}"
                continue
            if not (inspect.isclass(loaded) and issubclass(loaded, cls)):
                reasons[plugin.name] = f"{plugin.value} is not a {cls.__name__}"
            elif inspect.isabstract(loaded):
                missing_methods = ", ".join(sorted(loaded.__abstractmethods__))
                reasons[plugin.name] = f"{plugin.value} does not define {missing_methods}"
            elif (registered := members.setdefault(loaded.kind(), loaded)) is not loaded:
                other = f"{registered.__module__}:{registered.__qualname__}"
                reasons[plugin.name] = f"{plugin.value} has the kind {loaded.kind()} of {other}"
        # Classes of a notebook have no entry point.
        for member in _iter_concrete_leaf_classes(cls):
            members.setdefault(member.kind(), member)
        return members, reasons


@cache
def _entry_points() -> Any:  # EntryPoints, in Python 3.11 SelectableGroups
    return entry_points()  # takes 10 ms, and so does each group alone; `dechirp list` has 15


def _iter_concrete_leaf_classes(
    cls: type[Family], module_prefix: str = ""
) -> Iterator[type[Family]]:
    """Yield the classes that have no subclass in a module with the prefix."""
    for subclass in cls.__subclasses__():
        below = any(
            descendant.__module__.startswith(module_prefix)
            for descendant in subclass.__subclasses__()
        )
        if inspect.isabstract(subclass) or below:
            yield from _iter_concrete_leaf_classes(subclass, module_prefix)
        else:
            yield subclass
