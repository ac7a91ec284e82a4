"""Drawn clips of what does not move along: a lamp that fades, an arm that turns, a vessel that drains; with truth."""

import numpy as np

from tests._drawn import FPS, DrawnClip, disc, noisy, paint

SHAPE = (120, 160)
GREY = 80.0
LAMP = (71.3, 52.6, 9.0)  # x, y, radius, px
AXIS = (80.2, 59.7)  # px
ARM = (34.0, 11.0)  # px from the axis to the middle of the weight, and its radius
WALLS = (50, 110)  # columns of the vessel


def fading(n=60, rate=1.5, noise=2.0, seed=0):
    """A lamp whose light is exp(-rate t) from 40 to 200 grey levels; the light (n,)."""
    light = np.exp(-rate * np.arange(n) / FPS)
    share = disc(SHAPE, *LAMP)
    images = [paint(np.full(SHAPE, GREY), share, 40.0 + 160.0 * level) for level in light]
    return DrawnClip(noisy(images, noise, seed)), light


def turning(angle_rad, noise=2.0, seed=0):
    """A weight on an arm about an axis, at these angles anticlockwise from the right."""
    return DrawnClip(noisy([_arm(angle) for angle in angle_rad], noise, seed))


def weight_at(angle_rad):
    """Middle (n, 2) px of the weight on the arm."""
    return np.array(AXIS) + ARM[0] * np.column_stack([np.cos(angle_rad), -np.sin(angle_rad)])


def _arm(angle):
    image = np.full(SHAPE, GREY)
    for share, grey, radius in ((0.35, 130.0, 5.0), (0.65, 140.0, 5.0), (1.0, 190.0, ARM[1])):
        x, y = np.array(AXIS) + share * ARM[0] * np.array([np.cos(angle), -np.sin(angle)])
        image = paint(image, disc(SHAPE, x, y, radius), grey)
    return paint(image, disc(SHAPE, *AXIS, 4.0), 30.0)


def draining(level_px, noise=2.0, seed=0, slope=0.0, climb=0.0):
    """A vessel whose surface stands at these rows midway between its walls, px; it may slope, and climb the walls."""
    rows, columns = np.arange(SHAPE[0])[:, np.newaxis], np.arange(SHAPE[1])
    half = (WALLS[1] - WALLS[0]) / 2
    u = (columns - (sum(WALLS) - 1) / 2) / half
    wet = (columns >= WALLS[0]) & (columns < WALLS[1])
    images = []
    for level in level_px:
        surface = level + slope * half * u - climb * np.exp(-(1 - np.abs(u)) * half / 2)
        share = np.clip(rows + 0.5 - surface, 0, 1) * wet
        images.append(paint(np.full(SHAPE, 190.0), share, 90.0))
    return DrawnClip(noisy(images, noise, seed))
