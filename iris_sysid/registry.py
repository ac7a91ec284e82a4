"""Find every tracker, model, effect and phenomenon: one file each, looked up by name.

A plugin file defines one module-level instance of the type that its folder holds. Files whose name
starts with ``_`` are helpers. Nothing else has to be edited to add one.
"""

from __future__ import annotations

import importlib
import importlib.util
import pkgutil
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from importlib.metadata import packages_distributions
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from iris_sysid.errors import DataError, PluginError, UnknownNameError
from iris_sysid.types import Effect, OdeModel, Phenomenon, Tracker

Item = TypeVar("Item", Tracker, OdeModel, Effect, Phenomenon)

DISTRIBUTION = "iris-sysid"


@dataclass(eq=False)
class Registry(Mapping[str, Item], Generic[Item]):
    """The items of one type that the modules of one package define, by name; found on first look-up.

    Of one item that is asked for by its name only the file is loaded that is called so.
    """

    kind: str
    package: str
    item_type: type[Item]
    _items: dict[str, Item] | None = None
    _asked: dict[str, Item] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Item:
        if self._items is None and (alone := self._alone(name)) is not None:
            return alone
        items = self._found()
        if name not in items:
            close = get_close_matches(name, items, n=1)
            hint = f"did you mean {close[0]!r}? " if close else ""
            raise UnknownNameError(f"no {self.kind} is named {name!r}; {hint}there are: {', '.join(items)}")
        return items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._found())

    def __len__(self) -> int:
        return len(self._found())

    def __contains__(self, name: object) -> bool:
        return name in self._found()

    def forget(self) -> None:
        """Look again at the next look-up, e.g. after a plugin file was added."""
        self._items = None
        self._asked.clear()

    def _alone(self, name: str) -> Item | None:
        """The item that the file of that name defines; None where there is no such file, or it defines another."""
        if name not in self._asked and re.fullmatch(r"[a-z][a-z0-9-]*", name):
            check_ours(importlib.import_module(self.package))
            file = f"{self.package}.{name.replace('-', '_')}"
            item = self._item_of(importlib.import_module(file)) if importlib.util.find_spec(file) else None
            if item is not None and item.name == name:
                self._asked[name] = item
        return self._asked.get(name)

    def _found(self) -> dict[str, Item]:
        if self._items is None:
            package = importlib.import_module(self.package)
            check_ours(package)
            self._items = dict(sorted(self._read(package).items()))
        return self._items

    def _read(self, package: ModuleType) -> dict[str, Item]:
        items: dict[str, Item] = {}
        for info in pkgutil.iter_modules(package.__path__):
            if info.name.startswith("_") or info.ispkg:
                continue
            item = self._item_of(importlib.import_module(f"{self.package}.{info.name}"))
            if item is None:
                continue
            if item.name in items:
                raise PluginError(f"two files of {self.package} define the {self.kind} {item.name!r}; rename one")
            if item.name != info.name.replace("_", "-"):
                raise PluginError(
                    f"{self.package}/{info.name}.py defines {item.name!r}; "
                    f"the name must be {info.name.replace('_', '-')!r}, as the file is called"
                )
            items[item.name] = item
        return items

    def _item_of(self, module: ModuleType) -> Item | None:
        """The one item the module defines; None for a module of the package that is no plugin."""
        found = [value for value in vars(module).values() if isinstance(value, self.item_type)]
        if len(found) > 1:
            raise PluginError(f"{module.__name__} defines {len(found)} items of {self.kind}; one file holds one")
        return found[0] if found else None


def check_ours(package: ModuleType) -> None:
    """Stop if ``trackers`` or ``fitters`` is, or is mixed with, another distribution's package.

    ``trackers`` is also the import name of a package on PyPI, and pip lays both over one another.
    """
    top = importlib.import_module(package.__name__.partition(".")[0])
    owners = set(packages_distributions().get(top.__name__, ())) - {DISTRIBUTION}
    if getattr(top, "DISTRIBUTION", None) == DISTRIBUTION and not owners:
        return
    other = ", ".join(sorted(owners)) or f"the package at {list(top.__path__)}"
    raise PluginError(
        f"the import name {top.__name__!r} belongs to {other}, not to {DISTRIBUTION} alone; "
        f"install {DISTRIBUTION} in an environment without it, e.g. pip uninstall {other} {DISTRIBUTION} "
        f"and install {DISTRIBUTION} again"
    )


TRACKERS: Registry[Tracker] = Registry("tracker", "trackers", Tracker)
MODELS: Registry[OdeModel] = Registry("model", "fitters.models", OdeModel)
EFFECTS: Registry[Effect] = Registry("effect", "fitters.effects", Effect)
PHENOMENA: Registry[Phenomenon] = Registry("phenomenon", "iris_sysid.phenomena", Phenomenon)


def model_named(text: str) -> OdeModel:
    """The model of that name.

    ``FILE.py:NAME`` runs the file, as Python would, and takes the :class:`iris_sysid.types.OdeModel` that it calls
    NAME; anything else is looked up among the registered models.

    Raises
    ------
    DataError
        When the file is not there, fails, or holds no such model.
    UnknownNameError
        When no model of the bank has that name.
    """
    path, separator, name = text.rpartition(":")
    if not separator or not path.endswith(".py"):
        return MODELS[text]
    namespace = _run(Path(path))
    found = namespace.get(name)
    if isinstance(found, OdeModel):
        return found
    models = sorted(key for key, value in namespace.items() if isinstance(value, OdeModel))
    what = "is not there" if name not in namespace else f"is {type(namespace[name]).__name__}, not an OdeModel"
    raise DataError(f"{name!r} {what} in {path}; models in it: {', '.join(models) or 'none'}")


def _run(path: Path) -> dict[str, object]:
    if not path.is_file():
        raise DataError(f"there is no file {path}; give FILE.py:NAME")
    spec = importlib.util.spec_from_file_location(f"_user_models_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise DataError(f"{path} fails with {type(error).__name__}: {error}") from error
    return vars(module)
