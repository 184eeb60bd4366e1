"""Namespaces: modules that offer the public names of others, loaded on first use."""

import importlib
import importlib.util
import inspect
import pkgutil
from collections.abc import Callable, Mapping
from functools import cache
from types import ModuleType

from dechirp.core.families import Family


def lazy_getattr_and_dir(
    namespace: str, source: str | None = None, *, names_by_module: Mapping[str, str] | None = None
) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Create the `__getattr__` and the `__dir__` of a module with the public names of a source.

    The source is a module or a package. A package offers the names in `__all__` of its modules. A
    module without `__all__` offers its final family members, so adding a member needs no list.
    `names_by_module` adds names of other modules, separated by spaces. Without both, the namespace
    is a package and its own source.
    """
    listed = {
        name: module for module, names in (names_by_module or {}).items() for name in names.split()
    }
    searched = source or (None if listed else namespace)

    def modules_by_name() -> dict[str, str]:
        return (modules_by_public_name(searched) if searched else {}) | listed

    def load_name(name: str) -> object:
        # A package that is its own namespace is searched for submodules first.
        is_module = searched == namespace and importlib.util.find_spec(f"{namespace}.{name}")
        if name == "__all__" or not (name.startswith("_") or is_module):
            names = listed if name in listed else modules_by_name()
            if name == "__all__":
                return sorted(names)
            if name in names:
                return getattr(importlib.import_module(names[name]), name)
        raise AttributeError(f"module {namespace!r} has no attribute {name!r}")

    return load_name, lambda: sorted(modules_by_name())


@cache
def modules_by_public_name(source: str) -> dict[str, str]:
    """Map each public name of a module or a package to the module that defines it."""
    module = importlib.import_module(source)
    if not hasattr(module, "__path__"):
        return {name: getattr(module, name).__module__ for name in module.__all__}
    modules = [
        importlib.import_module(module.name)
        for module in pkgutil.iter_modules(module.__path__, f"{source}.")
    ]
    return {
        name: module.__name__
        for module in modules
        for name in _public_names_of_module(module, source)
    }


def _public_names_of_module(module: ModuleType, package: str) -> list[str]:
    if hasattr(module, "__path__"):
        return []
    listed: list[str] | None = vars(module).get("__all__")
    if listed is not None:
        return listed
    return [
        name
        for name, member in vars(module).items()
        if inspect.isclass(member)
        and member.__module__ == module.__name__
        and issubclass(member, Family)
        and not inspect.isabstract(member)
        and not any(sub.__module__.startswith(f"{package}.") for sub in member.__subclasses__())
    ]
