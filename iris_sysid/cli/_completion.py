"""What the shell completes after an option: names of the registry, which loads nothing heavy."""

from __future__ import annotations

from collections.abc import Callable, Iterable


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def registered(registry: str, *others: str, ending: str = "") -> Callable[[str], list[str]]:
    """A completion of the names in a registry of :mod:`iris_sysid.registry`, each with an ending, and of others.

    Parameters
    ----------
    registry
        Its name there.
    *others
        Further words.
    ending
        What follows each registered name.
    """

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
