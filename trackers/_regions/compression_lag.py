"""How late a compressed clip shows what fades: measured at its key frames, and taken out.

A predicted frame repeats the frame before it until the change is worth coding, so that a fading lamp is seen some
tenths of a grey level too bright, in all pixels alike. A key frame is coded afresh: there the brightness jumps by what
it was late. Between key frames the lag grows with the change since the last of them, up to a level that depends on the
bit rate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array, Mask

HALF_WINDOW = 6  # frames on either side of a key frame by which its jump is measured
MIN_FRAMES = 4  # of them that are needed on each side
FIRST_GUESS = 1.0  # grey levels: a change by as much brings the full lag
MIN_FULL_CHANGE = 0.2  # grey levels, the least change that does
MIN_SHARE = 0.3  # of the full lag must be there at a key frame that counts
TYPICAL = 0.7  # grey levels: lag of the rendered lamps at a phone's bit rate, where no key frame shows it
KEY_ERROR = 0.15  # of the usual jump: error of a region's mean in a key frame; 0.1 grey levels in the rendered lamps
ROUNDS = 3


@dataclass(frozen=True, eq=False, slots=True)
class Lag:
    """Lag (n,) of each frame and its errors (r, n), one standard error each; grey levels, positive where too bright."""

    grey: Array
    patterns: Array


def lag_of(grey: Array, key: Mask) -> Lag:
    """The lag of a brightness (n,), in grey levels, whose frames are key frames or predicted (n,)."""
    if key.all() or grey.size < 2 * HALF_WINDOW:
        return Lag(np.zeros(grey.size), np.zeros((0, grey.size)))
    found = {int(at): measured for at in np.flatnonzero(key) if (measured := _jump(grey, key, int(at))) is not None}
    at, full = np.array(list(found), dtype=int), FIRST_GUESS
    jump, stderr = np.array(list(found.values())).reshape(-1, 2).T
    for _ in range(ROUNDS):
        reached = _reached(grey, key, full)
        share = reached[at - 1]  # of the full lag, just before the key frame
        counted = np.abs(share) >= MIN_SHARE
        if not counted.any():
            return Lag(np.zeros(grey.size), TYPICAL * np.stack([reached, reached * np.linspace(-1, 1, grey.size)]))
        size = jump[counted] / share[counted]
        full = max(MIN_FULL_CHANGE, float(np.median(size)))
    frames, places = np.arange(grey.size), at[counted]
    error = np.hypot(stderr[counted], KEY_ERROR * np.median(np.abs(jump[counted]))) / np.abs(share[counted])
    hats = np.stack([np.interp(frames, places, row) for row in np.diag(error)])
    return Lag(np.interp(frames, places, size) * reached, hats * np.abs(reached))


def _reached(grey: Array, key: Mask, full: float) -> Array:
    """Share (n,) of the full lag, with its sign, by the change since the last key frame."""
    last = np.maximum.accumulate(np.where(key, np.arange(grey.size), 0))
    change = grey[last] - grey
    return np.asarray(np.sign(change) * -np.expm1(-np.abs(change) / full))


def _jump(grey: Array, key: Mask, at: int) -> tuple[float, float] | None:
    """How far the predicted frames before a key frame lie above it, and its standard error.

    It is that of a parabola through both sides with a step between them.
    """
    near = np.arange(max(0, at - HALF_WINDOW), min(grey.size, at + HALF_WINDOW + 1))
    near = near[~key[near]]
    after = near > at
    if min(np.count_nonzero(after), np.count_nonzero(~after)) < MIN_FRAMES:
        return None
    u = (near - at) / HALF_WINDOW
    terms = np.stack([np.ones(u.size), u, u**2, after.astype(float)], axis=1)
    inverse = np.linalg.pinv(terms)
    fitted = inverse @ grey[near]
    scatter = np.sqrt(((grey[near] - terms @ fitted) ** 2).sum() / (u.size - terms.shape[1]))
    return float(fitted[0] - grey[at]), float(scatter * np.linalg.norm(inverse[0]))
