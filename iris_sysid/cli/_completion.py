"""What the shell completes after an option: names of the registry, which loads nothing heavy."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Iterable
from contextlib import suppress

BASH = "complete_bash"


def drop_equals() -> None:
    """Complete ``--model=li`` as ``--model li``: bash hands over the equals sign as a separate word."""
    if os.environ.get("_IRIS_SYSID_COMPLETE") == BASH:
        with suppress(ValueError):  # a quote is still open
            words, current = shlex.split(os.environ["COMP_WORDS"]), int(os.environ["COMP_CWORD"])
            os.environ["COMP_WORDS"] = shlex.join([word for k, word in enumerate(words) if word != "=" or k >= current])
            os.environ["COMP_CWORD"] = str(current - words[:current].count("="))


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def registered(registry: str, *others: str, ending: str = "") -> Callable[[str], list[str]]:
    """A completion of the names in a registry of :mod:`iris_sysid.registry`, each with an ending, and other words."""

    def complete(incomplete: str) -> list[str]:
        from iris_sysid import registry as registries

        return _beginning([*(f"{name}{ending}" for name in getattr(registries, registry)), *others], incomplete)

    return complete


phenomena = registered("PHENOMENA")
models = registered("MODELS", "auto")
trackers = registered("TRACKERS")
effects = registered("EFFECTS", ending="=")


def scenes(incomplete: str) -> list[str]:
    """The scenes that can be rendered, by the beginning of their names."""
    from iris_sysid.synthetic.scene import SCENES

    return _beginning(SCENES, incomplete)


def values(*names: str) -> Callable[[str], list[str]]:
    """A completion of a few fixed words."""
    return lambda incomplete: _beginning(names, incomplete)
