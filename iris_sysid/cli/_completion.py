"""What the shell completes after an option: names of the registry, which loads nothing heavy."""

from __future__ import annotations

from collections.abc import Callable, Iterable


def _beginning(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


def phenomena(incomplete: str) -> list[str]:
    """The phenomena whose names begin so."""
    from iris_sysid.registry import PHENOMENA

    return _beginning(PHENOMENA, incomplete)


def models(incomplete: str) -> list[str]:
    """The models whose names begin so, and auto."""
    from iris_sysid.registry import MODELS

    return _beginning([*MODELS, "auto"], incomplete)


def trackers(incomplete: str) -> list[str]:
    """The trackers whose names begin so."""
    from iris_sysid.registry import TRACKERS

    return _beginning(TRACKERS, incomplete)


def effects(incomplete: str) -> list[str]:
    """The effects whose names begin so, with the sign before their size."""
    from iris_sysid.registry import EFFECTS

    return _beginning((f"{name}=" for name in EFFECTS), incomplete)


def scenes(incomplete: str) -> list[str]:
    """The scenes that can be rendered, by the beginning of their names."""
    from iris_sysid.synthetic.scene import SCENES

    return _beginning(SCENES, incomplete)


def values(*names: str) -> Callable[[str], list[str]]:
    """A completion of a few fixed words."""

    def complete(incomplete: str) -> list[str]:
        return _beginning(names, incomplete)

    return complete
