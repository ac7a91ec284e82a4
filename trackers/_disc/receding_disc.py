"""A disc that stays near its place and changes its size: a ball that falls away from the camera, or comes nearer."""

from __future__ import annotations

from collections.abc import Sequence

from iris_sysid.types import Frame
from trackers._disc.circle_detection import MAX_GAP, Search, best_chain, circles
from trackers._disc.model import Disc
from trackers._frames.working_image import WorkingView

# Chosen on rendered falls (640x360, 960x540), where 7 to 40 of 40 samples show it and its radius changes 1.24 to 2.8
# times; in 27 real clips no circle that 6 samples show changes more than 1.18 times where one body is followed
MIN_SAMPLES = 6
MIN_RATIO = 1.2  # largest radius over smallest, the one extreme of each left out: a single circle may be another's


def receding_disc(frames: Sequence[Frame], view: WorkingView) -> dict[int, Disc]:
    """The circle that changes over most of the sampled frames, where it changes its size; empty if there is none.

    Parameters
    ----------
    frames
        The samples, in order; between two of them a disc may change its radius twofold.
    view
        The part of the image that counts.

    Returns
    -------
    dict of Disc
        Centre and radius, px of the frame, by the number of the frame.
    """
    search = Search(view)
    # numbered so that the chain joins circles of one sample and the next, but not beyond: gap MAX_GAP - 2
    nodes = [
        ((MAX_GAP - 2) * sample, circle)
        for sample, frame in enumerate(frames)
        for circle in circles(search.small(view.image(frame)))
    ]
    chain = [nodes[k] for k in best_chain(nodes) or ()]
    radii = sorted(float(circle[2]) for _, circle in chain)
    if len(radii) < MIN_SAMPLES or radii[-2] < MIN_RATIO * radii[1]:
        return {}
    discs: dict[int, Disc] = {}
    for number, circle in chain:
        x, y, radius = (float(value) for value in circle)
        discs[frames[number // (MAX_GAP - 2)].index] = search.enlarged(Disc(x, y, radius))
    return discs
