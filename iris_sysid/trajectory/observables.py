"""The quantity that a phenomenon measures of a track, with segments: position, height, radius, angle, intensity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.calibration.pixel_scale import to_world
from iris_sysid.errors import DataError
from iris_sysid.trajectory.consistency.path_shape import phenomenon_doubt
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.types import RADIUS_ERRORS, Array, Calibration, Doubt, Estimate, Phenomenon, Quantity, Track, Trajectory

# what a track may measure besides positions -> the quantity, its column, and that of its standard error
OF_TRACK = {
    "radius": (Quantity("r", "px", "r"), "radius_px", "sigma_radius_px"),
    "angle": (Quantity("phi", "rad", r"\varphi"), "angle_rad", "sigma_angle_rad"),
    "intensity": (Quantity("intensity", "1", "I"), "intensity", "sigma_intensity"),
}


def measured(track: Track, calibration: Calibration, phenomenon: Phenomenon) -> Trajectory:
    """What the phenomenon measures of one body: x and z, z alone, or the radius, angle or intensity of the track.

    The calibration does not act on radius, angle and intensity. The trajectory has no segments. DataError when the
    track lacks the requested quantity: another kind of tracker made it.
    """
    world = to_world(track, calibration)
    if phenomenon.measures == "position":
        return world
    if phenomenon.measures == "height":
        return world.with_(
            quantities=world.quantities[1:2],
            position=world.position[:, 1:2],
            sigma=world.sigma[:, 1:2],
            systematic={source: change[..., 1:2] for source, change in world.systematic.items()},
        )
    quantity, column, sigma_column = OF_TRACK[phenomenon.measures]
    values, sigma = getattr(track, column), getattr(track, sigma_column)
    if values is None:
        raise DataError(
            f"{phenomenon.name} needs the {phenomenon.measures} of the body, which this track does not hold; "
            f"use the tracker {phenomenon.tracker}"
        )
    valid = track.valid & np.isfinite(values)
    return world.with_(
        quantities=(quantity,),
        position=np.where(valid, values, np.nan)[:, None],
        sigma=(np.full(values.size, np.nan) if sigma is None else sigma)[:, None],
        valid=valid,
        geometry={},
        systematic={},
        # that of the track is of positions
        error_autocorrelation=RADIUS_ERRORS if phenomenon.measures == "radius" else None,
    )


def segmented(track: Track, calibration: Calibration, phenomenon: Phenomenon) -> Trajectory:
    """What the phenomenon measures, labelled by what happens when.

    A body that falls away from the camera moves evenly accelerated in -1/r, by which its radius r is segmented.
    """
    world = measured(track, calibration, phenomenon)
    if phenomenon.measures != "radius":
        return segment(world, hand=track.hand, kind=phenomenon.motion)
    radius, sigma = world.position, world.sigma
    away = segment(
        world.with_(position=_inverse(radius), sigma=sigma / radius**2), hand=track.hand, kind=phenomenon.motion
    )
    return world.with_(segments=away.segments, valid=away.valid)


def world_in_motion(track: Track, calibration: Calibration) -> Trajectory:
    """X and z of one body, labelled by where a hand holds it, it rests and it moves; not labelled where none moves."""
    world = to_world(track, calibration)
    try:
        return segment(world, hand=track.hand, kind="whole")
    except DataError:
        return world


def observed(phenomenon: Phenomenon, world: Sequence[Trajectory], known: Mapping[str, Estimate]) -> Trajectory:
    """What a phenomenon observes of the bodies, x and z in m or px with segments, and of ``known`` values by name.

    DataError when the motion does not show it; the text names the phenomenon that the path looks like.
    """
    try:
        return phenomenon.observe(world, known)
    except DataError as error:
        another = _another(world[0], phenomenon)
        if another is None:
            raise
        raise DataError(f"{another.text} ({error})") from error


def _another(body: Trajectory, phenomenon: Phenomenon) -> Doubt | None:
    """The phenomenon that a path looks like, also when it is segmented as a flight."""
    found = phenomenon_doubt(body, phenomenon)
    if found is not None or phenomenon.measures != "position":
        return found
    try:
        return phenomenon_doubt(segment(body.with_(segments=()), kind="flight"), phenomenon)
    except DataError:
        return None


def _inverse(radius: Array) -> Array:
    """-1/r (n, 1) of radii in px."""
    return np.asarray(-1.0 / radius)
