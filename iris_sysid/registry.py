"""Find every tracker, stage, model, effect and phenomenon by name: one file each, an entry point, or a user's own file.

A plugin file defines one module-level instance of the type that its folder holds. Files whose name
starts with ``_`` are helpers. Nothing else has to be edited to add one.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import os
import pkgutil
import re
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import TYPE_CHECKING, Generic, TypeVar

from iris_sysid.errors import DataError, PluginError, UnknownNameError
from iris_sysid.types import OWN_FILE, Detector, Effect, Linker, Measurer, OdeModel, Phenomenon, Tracker

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Item = TypeVar("Item", Tracker, Detector, Linker, Measurer, OdeModel, Effect, Phenomenon)

DISTRIBUTION = "iris-sysid"
# CPython 3.11 counts the depth of all threads together (gh-106905): two that parse at once may raise SystemError
_PARSING = RLock()


@dataclass(eq=False)
class Registry(Mapping[str, Item], Generic[Item]):
    """The items of one type by name: those of the plugin files in ``package``, then those of entry points.

    A look-up by name loads the one file that has the name; iterating loads every file. ``group`` names the entry
    points in which other distributions declare items. ``unusable`` says of each entry point that was passed over
    which distribution declares it and why it was passed over.
    """

    kind: str
    package: str
    item_type: type[Item]
    group: str = ""
    unusable: dict[str, str] = field(default_factory=dict)
    _items: dict[str, Item] | None = None
    _loaded: dict[str, Item] = field(default_factory=dict)

    def __getitem__(self, name: str) -> Item:
        if self._items is None and (item := self._item_of_file(name)) is not None:
            return item
        items = self._all_items()
        if name in items:
            return items[name]
        if name in self.unusable:
            raise PluginError(self.unusable[name])
        close = get_close_matches(name, items, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        raise UnknownNameError(f"no {self.kind} is named {name!r}; {hint}there are: {', '.join(items)}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._all_items())

    def __len__(self) -> int:
        return len(self._all_items())

    def __contains__(self, name: object) -> bool:
        return name in self._all_items()

    def named(self, text: str) -> Item:
        """The item that a user names: a registered name, or ``FILE.py:NAME``, which runs the file as Python would.

        Pass only text that the user typed or a plugin states; names out of data files are looked up with ``[]``, which
        runs no file but those of the installation. DataError when the file is not there, fails, or holds no such item,
        UnknownNameError when no item is registered under the name.
        """
        path, separator, name = text.rpartition(":")
        if not separator or not path.endswith(".py"):
            return self[text]
        file = Path(path)
        if not os.path.isfile(file):  # noqa: PTH113  Path.is_file raises where the name is too long
            raise DataError(f"there is no file {path:.200}; give FILE.py:NAME")
        namespace = _run(file.resolve(), file.stat().st_mtime_ns)
        item = namespace.get(name)
        if isinstance(item, self.item_type):
            return item
        names = sorted(key for key, value in namespace.items() if isinstance(value, self.item_type))
        wanted = self.item_type.__name__
        reason = "is not there" if name not in namespace else f"is of type {type(namespace[name]).__name__}"
        raise DataError(f"{name!r} {reason} in {file}; items of type {wanted} in it: {', '.join(names) or 'none'}")

    def resolved(self, item: str | Item) -> Item:
        """The item itself, or the one that a name stands for as of :meth:`named`; DataError for anything else."""
        if isinstance(item, str):
            return self.named(item)
        if isinstance(item, self.item_type):
            return item
        raise DataError(
            f"an object of type {type(item).__name__} is no {self.kind}; "
            f"give the name of one, or an object of type {self.item_type.__name__}"
        )

    def all_resolved(self, items: str | Item | Iterable[str | Item]) -> list[Item]:
        """The items of a list of names or items, or the only one where a single name or item is given."""
        if isinstance(items, str) or not isinstance(items, Iterable):
            return [self.resolved(items)]
        return [self.resolved(item) for item in items]

    def __repr__(self) -> str:
        names = list(self.summaries())
        text = f"{len(names)} of {self.item_type.__name__}: {', '.join(names)}"
        return textwrap.fill(text, 160, max_lines=3, placeholder=" ...", break_on_hyphens=False)

    def summaries(self) -> dict[str, str]:
        """The one-line summary of every item by name, read from the source where it stands there literally.

        Running every plugin takes a second or more, since many import numba or OpenCV. A file whose source does not
        show name and summary as literals is imported instead.
        """
        if self._items is not None:
            return {name: item.summary for name, item in self._items.items()}
        package = importlib.import_module(self.package)
        check_ours(package)
        lines: dict[str, str] = {}
        for module in plugin_modules(package):
            stated = _literal_summary(module, self.item_type.__name__) or self._imported_summary(module)
            lines.update(stated)
        others = self._entry_items(set(lines))
        return dict(sorted((lines | {name: item.summary for name, item in others.items()}).items()))

    def _imported_summary(self, module: str) -> dict[str, str]:
        item = self._item_in(importlib.import_module(module))
        return {} if item is None else {item.name: item.summary}

    def _item_of_file(self, name: str) -> Item | None:
        """The item that the file of that name defines; None where there is no such file, or it defines another."""
        if name not in self._loaded and re.fullmatch(r"[a-z][a-z0-9-]*", name):
            check_ours(importlib.import_module(self.package))
            module = f"{self.package}.{name.replace('-', '_')}"
            item = self._item_in(importlib.import_module(module)) if importlib.util.find_spec(module) else None
            if item is not None and item.name == name:
                self._loaded[name] = item
        return self._loaded.get(name)

    def _all_items(self) -> dict[str, Item]:
        if self._items is None:
            package = importlib.import_module(self.package)
            check_ours(package)
            items = self._package_items(package)
            self._items = dict(sorted((items | self._entry_items(items)).items()))
        return self._items

    def _package_items(self, package: ModuleType) -> dict[str, Item]:
        items: dict[str, Item] = {}
        for module in plugin_modules(package):
            item = self._item_in(importlib.import_module(module))
            if item is None:
                continue
            if item.name in items:
                raise PluginError(f"two files of {self.package} define the {self.kind} {item.name!r}; rename one")
            file = module.rpartition(".")[2]
            if item.name != file.replace("_", "-"):
                raise PluginError(
                    f"{self.package}/{file}.py defines {item.name!r}; "
                    f"the name must be {file.replace('_', '-')!r}, as the file is called"
                )
            items[item.name] = item
        return items

    def _item_in(self, module: ModuleType) -> Item | None:
        """The one item the module defines; None for a module of the package that is not a plugin."""
        items = [value for value in vars(module).values() if isinstance(value, self.item_type)]
        if len(items) > 1:
            raise PluginError(f"{module.__name__} defines {len(items)} items of {self.kind}; one file holds one")
        return items[0] if items else None

    def _entry_items(self, taken: Iterable[str]) -> dict[str, Item]:
        """The items that entry points of other distributions declare; what cannot be used goes to ``unusable``."""
        from importlib import metadata

        items: dict[str, Item] = {}
        for point in metadata.entry_points(group=self.group) if self.group else ():
            reason = f"another {self.kind} has that name" if point.name in {*taken, *items} else ""
            if not reason:
                item, reason = self._load(point)
            if reason:
                owner = point.dist.name if point.dist else "an unknown distribution"
                self.unusable[point.name] = (
                    f"{owner} declares the {self.kind} {point.name!r} ({point.value}), which cannot be used: {reason}; "
                    f"update {owner} or uninstall it"
                )
            elif item is not None:
                items[point.name] = item
        return items

    def _load(self, point: EntryPoint) -> tuple[Item | None, str]:
        """The item of an entry point, or the reason why there is none."""
        try:
            item = point.load()
        except SystemExit:
            return None, "it calls sys.exit while it is imported"
        except Exception as error:
            return None, f"{type(error).__name__}: {error}"
        if not isinstance(item, self.item_type):
            return None, f"it is of type {type(item).__name__}, not {self.item_type.__name__}"
        return item, "" if item.name == point.name else f"its name is {item.name!r}"


def plugin_modules(package: ModuleType) -> list[str]:
    """The full names of the plugin files of a package: every module that is neither private nor a package."""
    modules = pkgutil.iter_modules(package.__path__)
    return [f"{package.__name__}.{info.name}" for info in modules if not (info.name.startswith("_") or info.ispkg)]


def parsed(source: str | bytes) -> ast.Module:
    """The syntax tree of Python ``source``; several threads may ask for one, as a review's page and its fit do."""
    with _PARSING:
        return ast.parse(source)


def check_ours(package: ModuleType) -> None:
    """Stop if ``trackers`` or ``fitters`` is, or is mixed with, another distribution's package.

    ``trackers`` is also the import name of a package on PyPI, and pip lays both over one another.
    """
    top = importlib.import_module(package.__name__.partition(".")[0])
    owners = {owner for folder in list(top.__path__) for owner in _owners(folder, top.__name__)} - {DISTRIBUTION}
    if getattr(top, "DISTRIBUTION", None) == DISTRIBUTION and not owners:
        return
    other = ", ".join(sorted(owners)) or f"the package at {list(top.__path__)}"
    raise PluginError(
        f"the import name {top.__name__!r} belongs to {other}, not to {DISTRIBUTION} alone; "
        f"install {DISTRIBUTION} in an environment without it, e.g. pip uninstall {other} {DISTRIBUTION} "
        f"and install {DISTRIBUTION} again"
    )


@cache
def _owners(folder: str, package: str) -> frozenset[str]:
    """The distributions that installed files into a package, from the lists of files beside it.

    ``importlib.metadata.packages_distributions`` parses every list of every distribution, ten times as long.
    """
    prefix = f"\n{package}/".encode()
    records = Path(folder).parent.glob("*.dist-info/RECORD")
    listing = [record for record in records if prefix in b"\n" + record.read_bytes()]
    return frozenset(re.sub(r"[-_.]+", "-", record.parent.name.split("-")[0]).lower() for record in listing)


TRACKERS: Registry[Tracker] = Registry("tracker", "trackers", Tracker, "iris_sysid.trackers")
DETECTORS: Registry[Detector] = Registry("detector", "trackers.detectors", Detector, "iris_sysid.detectors")
LINKERS: Registry[Linker] = Registry("linker", "trackers.linkers", Linker, "iris_sysid.linkers")
MEASURERS: Registry[Measurer] = Registry("measurer", "trackers.measurers", Measurer, "iris_sysid.measurers")
MODELS: Registry[OdeModel] = Registry("model", "fitters.models", OdeModel, "iris_sysid.models")
EFFECTS: Registry[Effect] = Registry("effect", "fitters.effects", Effect, "iris_sysid.effects")
PHENOMENA: Registry[Phenomenon] = Registry("phenomenon", "iris_sysid.phenomena", Phenomenon, "iris_sysid.phenomena")


def _literal_summary(module: str, item_type: str) -> dict[str, str]:
    """Name and summary of the item that a plugin file builds, from its source; empty where they are not literals."""
    spec = importlib.util.find_spec(module)
    if spec is None or spec.origin is None:
        return {}
    for node in parsed(Path(spec.origin).read_bytes()).body:
        call = node.value if isinstance(node, ast.Assign | ast.AnnAssign) else None
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == item_type:
            stated = {word.arg: word.value.value for word in call.keywords if isinstance(word.value, ast.Constant)}
            name, summary = stated.get("name"), stated.get("summary")
            if isinstance(name, str) and isinstance(summary, str):
                return {name: summary}
    return {}


@cache
def _run(path: Path, changed_ns: int) -> dict[str, object]:
    """The names that a user's file defines; run once, and again after the file has changed."""
    del changed_ns
    spec = importlib.util.spec_from_file_location(f"{OWN_FILE}{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    except SystemExit as error:
        raise DataError(f"{path} calls sys.exit when it is run; put that under if __name__ == '__main__'") from error
    except Exception as error:
        raise DataError(f"{path} fails with {type(error).__name__}: {error}") from error
    return vars(module)
