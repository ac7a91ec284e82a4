"""Equations discovered by sparse regression on the weak form, refined by trajectory fits."""

from fitters.sindy.discover import discover

__all__ = ["discover"]
