"""The colour of each part of a residual, the same in figures, on pages and in a review."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.types import ComponentSide

# Okabe and Ito (2008), on light and on dark paper
SIDE_COLOURS: Mapping[ComponentSide, tuple[str, str]] = {
    "force": ("#0072b2", "#4ba6e8"),
    "reading": ("#d55e00", "#ff8a3d"),
    "clock": ("#cc79a7", "#cc79a7"),
    "input": ("#e69f00", "#e69f00"),
}
NOISE_COLOUR = "#8a929c"
SHADES = {"": 1.0, "second": 0.6, "third": 0.35}  # opacity of further parts of a side, by the class on a page


def shades_of(sides: Sequence[ComponentSide]) -> list[str]:
    """A name in ``SHADES`` for each part, by its side: the first of a side is plain, further ones are lighter."""
    names = list(SHADES)
    return [names[min(sides[:k].count(side), len(names) - 1)] for k, side in enumerate(sides)]


def colour_style() -> str:
    """The colours as CSS: ``var(--force)`` and the like, ``var(--grey)`` for noise, and the classes of the shades."""
    light, dark = (" ".join(f"--{side}: {both[k]};" for side, both in SIDE_COLOURS.items()) for k in (0, 1))
    shades = " ".join(f".part.{name} {{ fill-opacity: {opacity}; }}" for name, opacity in SHADES.items() if name)
    return (
        f":root {{ {light} --grey: {NOISE_COLOUR}; }}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n{shades}\n"
    )
