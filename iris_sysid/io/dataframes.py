"""Every box as a pandas table, with units in the column names; the CSV files are these tables.

pandas is imported by the functions that make a table: reading a CSV file needs none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.io.csv_columns import column_of, covariance_columns, state_columns
from iris_sysid.types import (
    TRACK_MASKS,
    TRACK_MEASURES,
    TRACK_SIGMAS,
    Array,
    FitResult,
    Segment,
    Smoothed,
    Track,
    Trajectory,
)

if TYPE_CHECKING:
    import pandas as pd


def to_frame(box: Track | Sequence[Track] | Trajectory | FitResult) -> pd.DataFrame:
    """Turn a track, several tracks, a trajectory or a fit into a table with one row a sample.

    Parameters
    ----------
    box
        Tracks give ``frame, t_s, body, x_px, ...``, one row per frame and body; a trajectory ``t_s``, then
        ``<quantity>_<unit>``, its ``sigma_`` where known, inputs, the smoothed state and the segment; a fit ``t_s``,
        ``used``, and ``observed_``, ``predicted_`` and ``residual_`` of each quantity.

    Returns
    -------
    pandas.DataFrame
        NaN stands for a gap, or for what is not known.

    Raises
    ------
    DataError
        When two tracks are of the same body, or a quantity's name or unit cannot be told from its column's name.
    """
    if isinstance(box, Trajectory):
        return _trajectory_frame(box)
    if isinstance(box, FitResult):
        return _fit_frame(box)
    return _track_frame([box] if isinstance(box, Track) else list(box))


def estimates_frame(result: FitResult) -> pd.DataFrame:
    """The estimates of a fit: one row a name, with value, stderr, 95 % interval, unit, type and whether it was free.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, estimates_frame, fit, simulate
    >>> pendulum, t_s = MODELS["pendulum"], np.arange(300) / 60
    >>> truth = {"length": 0.5, "damping": 0.1, "theta_0": 0.8, "omega_0": 0.0}
    >>> theta = simulate(pendulum, t_s, truth).observed
    >>> theta += 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    >>> clip = Trajectory(t_s, pendulum.observed, theta, np.full_like(theta, np.nan), np.ones(300, bool))
    >>> frame = estimates_frame(fit(clip, pendulum))
    >>> frame.loc[["length", "damping"], "unit"].to_list()
    ['m', '1/s']
    """
    import pandas as pd

    rows = {
        name: {
            "value": estimate.value,
            "stderr": estimate.stderr,
            "ci95_low": estimate.interval[0],
            "ci95_high": estimate.interval[1],
            "unit": estimate.unit,
            "measurement_type": estimate.measurement_type,
            "free": name in result.free,
        }
        for name, estimate in result.estimates.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("name")


# --------------------------------------------------------------------------- tracks


def track_columns(tracks: Sequence[Track]) -> dict[str, NDArray[Any]]:
    """The columns of a table of tracks by name, each (n,), in the order of time; NaN is a gap, also in a mask.

    DataError as of :func:`to_frame`.
    """
    names = [track.body for track in tracks]
    if len(set(names)) < len(names):
        raise DataError(f"two tracks are of the same body: {', '.join(map(repr, names))}; name each differently")
    if not tracks:
        raise DataError("there is no track to make a table of")
    columns = {
        "frame": np.concatenate([track.frame for track in tracks]),
        "t_s": np.concatenate([track.t_s for track in tracks]),
        "body": np.repeat(np.array(names, dtype=object), [track.t_s.size for track in tracks]),
        **{name: np.concatenate([part[name] for part in map(_positions, tracks)]) for name in _positions(tracks[0])},
        **{name: _joined(tracks, name) for name in TRACK_MEASURES[:3]},
        "valid": np.concatenate([track.valid for track in tracks]),
        "area_px": _joined(tracks, "area_px"),
        "hand": _joined(tracks, "hand"),
        **({"edited": _joined(tracks, "edited")} if any(track.edited is not None for track in tracks) else {}),
        **{
            name: _joined(tracks, name)
            for name in TRACK_SIGMAS
            if any(getattr(track, name) is not None for track in tracks)
        },
    }
    order = np.argsort(columns["t_s"], kind="stable")
    return {name: column[order] for name, column in columns.items()}


def _track_frame(tracks: Sequence[Track]) -> pd.DataFrame:
    import pandas as pd

    columns = track_columns(tracks)
    masks = {
        name: pd.arrays.BooleanArray(columns[name] == 1, np.isnan(columns[name]))
        for name in TRACK_MASKS
        if name in columns
    }
    return pd.DataFrame({**columns, **masks})


def _positions(track: Track) -> dict[str, Array]:
    x_px, y_px = track.xy_px.T
    sigma_x_px, sigma_y_px = track.sigma_px.T
    return {"x_px": x_px, "y_px": y_px, "sigma_x_px": sigma_x_px, "sigma_y_px": sigma_y_px}


def _joined(tracks: Sequence[Track], name: str) -> Array:
    """An optional column of every track (n,), NaN where a track does not have it."""
    parts = [
        np.full(track.t_s.size, np.nan) if getattr(track, name) is None else getattr(track, name) for track in tracks
    ]
    return np.concatenate(parts).astype(np.float64)


# --------------------------------------------------------------------------- trajectories


def _trajectory_frame(trajectory: Trajectory) -> pd.DataFrame:
    import pandas as pd

    headers = [column_of(quantity) for quantity in trajectory.quantities]
    columns: dict[str, Any] = {"t_s": trajectory.t_s, **dict(zip(headers, trajectory.position.T, strict=True))}
    for header, sigma in zip(headers, trajectory.sigma.T, strict=True):
        if not np.isnan(sigma).all():
            columns[f"sigma_{header}"] = sigma
    for k, quantity in enumerate(trajectory.input_quantities):
        columns[column_of(quantity, is_input=True)] = trajectory.inputs[:, k]  # type: ignore[index]  # there are inputs
    if trajectory.smoothed is not None:
        columns |= _smoothed_columns(trajectory, trajectory.smoothed)
    if not np.array_equal(trajectory.valid, np.isfinite(trajectory.position).all(axis=1)):
        columns["valid"] = trajectory.valid
    if trajectory.segments:
        text = pd.StringDtype(na_value=np.nan)  # "str" of pandas 3; pandas 2 would spell a missing one "None"
        columns["segment"] = pd.array(segment_labels(trajectory.segments, trajectory.n), dtype=text)
    names = [quantity.name for quantity in (*trajectory.quantities, *trajectory.input_quantities)]
    if len(set(names)) < len(names):
        raise DataError(f"a table cannot hold two quantities of the same name: {', '.join(names)}")
    return pd.DataFrame(columns)


def _smoothed_columns(trajectory: Trajectory, smoothed: Smoothed) -> dict[str, Array]:
    headers = state_columns(trajectory.quantities)
    states = np.concatenate([smoothed.position, smoothed.velocity], axis=1)
    sigmas = np.sqrt(np.diagonal(smoothed.covariance, axis1=1, axis2=2))
    columns = dict(zip(headers, states.T, strict=True))
    columns |= {f"sigma_{header}": sigma for header, sigma in zip(headers, sigmas.T, strict=True)}
    for header, (first, second) in covariance_columns(trajectory.quantities).items():
        if smoothed.covariance[:, first, second].any():
            columns[header] = smoothed.covariance[:, first, second]
    return columns


def segment_labels(segments: Sequence[Segment], n: int) -> list[str | None]:
    """The label of each of the ``n`` samples, None where no segment is; of overlapping ``segments`` the last counts."""
    labels: list[str | None] = [None] * n
    for segment in segments:
        labels[segment.start : segment.stop] = [segment.label] * (segment.stop - segment.start)
    return labels


# --------------------------------------------------------------------------- fits


def _fit_frame(result: FitResult) -> pd.DataFrame:
    import pandas as pd

    columns: dict[str, Any] = {"t_s": result.t_s, "used": result.used}
    parts = {
        "observed": result.predicted + result.residual,
        "predicted": result.predicted,
        "residual": result.residual,
    }
    for k, quantity in enumerate(result.model.observed):
        columns |= {f"{part}_{quantity.column}": values[:, k] for part, values in parts.items()}
    return pd.DataFrame(columns)
