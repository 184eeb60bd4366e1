"""Package namespaces: public names of the modules in a folder, loaded on first use."""

import importlib
import importlib.util
import inspect
import pkgutil
from collections.abc import Callable
from functools import cache
from types import ModuleType

from dechirp.core.families import Family


def lazy_getattr_and_dir(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]]]:
    """Create the `__getattr__` and the `__dir__` of a package.

    The package offers the names in `__all__` of its modules. A module without `__all__` offers
    its final family members, so adding a member needs no list.
    """

    def load_name(name: str) -> object:
        is_module = not name.startswith("_") and importlib.util.find_spec(f"{package}.{name}")
        if not is_module and (name == "__all__" or not name.startswith("_")):
            names = modules_by_public_name(package)
            if name == "__all__":
                return sorted(names)
            if name in names:
                return getattr(importlib.import_module(names[name]), name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}")

    return load_name, lambda: sorted(modules_by_public_name(package))


@cache
def modules_by_public_name(package: str) -> dict[str, str]:
    """Map each public name of a package to the module that defines it."""
    folder = importlib.import_module(package)
    modules = [
        importlib.import_module(module.name)
        for module in pkgutil.iter_modules(folder.__path__, f"{package}.")
    ]
    return {
        name: module.__name__
        for module in modules
        for name in _public_names_of_module(module, package)
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
