"""What the components of a residual say for or against an effect."""

from __future__ import annotations

from dataclasses import replace

from iris_sysid.types import Component, ComponentKind, Components, Effect

DOMINANT_SHARE = 0.85  # of the residual's squares, of one component or effect that is nearly all of it
EVIDENT_SHARE = 0.2  # of the residual without noise, that a component is which stands for what imitates anything


class ComponentSupport:
    """Whether there is a component of the kind that an effect belongs to.

    Parameters
    ----------
    components
        Of the residual of the model without effects; None where they are not known.
    is_driven
        Whether something drives the motion: it then has pieces of its own at any moment.
    """

    def __init__(self, components: Components | None, is_driven: bool) -> None:
        self._components, self._is_driven = components, is_driven

    @property
    def known(self) -> bool:
        """Whether the residual was split into components."""
        return self._components is not None

    @property
    def parts(self) -> tuple[Component, ...]:
        """The components, the largest first; none where they are not known."""
        return () if self._components is None else self._components.parts

    def is_nearly_all(self, effect: Effect) -> bool:
        """Whether nearly all of the residual of a motion that turns back is of the kind of an effect itself."""
        main = self.parts[:1] if self.turns else ()
        return any(part.kind == effect.component and part.share >= DOMINANT_SHARE for part in main)

    def shows(self, effect: Effect) -> bool:
        """Whether there is a component that an effect can be the cause of, however small."""
        return any(can_cause(effect, part) for part in self.parts)

    def _large(self, of_range: bool) -> list[Component]:
        """The components that are, or by their range can be, a good part of the residual without noise.

        What can take the place of a component counts only where its share itself is large.
        """
        least = EVIDENT_SHARE * sum(part.share for part in self.parts)
        return [
            part if part.share >= least else replace(part, similar=())
            for part in self.parts
            if part.share >= least or (of_range and part.share_range[1] >= least)
        ]

    def evidence(self, effect: Effect) -> frozenset[ComponentKind]:
        """The components that are, or can be, a good part of the residual and that an effect can be the cause of."""
        return frozenset(part.kind for part in self._large(of_range=True) if can_cause(effect, part))

    def is_largest(self, effect: Effect) -> bool:
        """Whether the largest component depends on the state as a law does, and an effect is of its kind."""
        return any(part.is_of_state and part.kind == effect.component for part in self.parts[:1])

    @property
    def never_turns(self) -> bool:
        """Whether the motion is known to run one way only: there the components cannot tell forces from readings."""
        return self._components is not None and not self._components.turns

    @property
    def turns(self) -> bool:
        """Whether the motion is known to turn back."""
        return self._components is not None and self._components.turns

    def agrees(self, effect: Effect, *, of_range: bool = False) -> bool:
        """Whether an effect is of a kind that the components have; on a motion that never turns, they cannot tell.

        What can imitate anything must be a good part of the residual. Where the model explains the data to the noise,
        the shares may lie anywhere in their ranges.
        """
        if effect.absorbs and self._is_driven:
            return False
        if self._components is None:
            return True
        parts = self._large(of_range) if effect.absorbs else self.parts
        return any(can_cause(effect, part) for part in parts) or (bool(parts) and not self._components.turns)


def can_cause(effect: Effect, part: Component) -> bool:
    """Whether an effect can be the cause of a component: it is of its kind, or of one that can take its place.

    A component that depends on the state is not evidence of an effect that can imitate a piece of anything.
    """
    if part.kind == effect.component:
        return True
    return effect.component in part.similar and not (effect.is_flexible and part.is_of_state)
