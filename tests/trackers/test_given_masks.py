"""Given masks instead of the detector: bodies by the values of the masks, or distinguished by assignment."""

import cv2
import numpy as np
import pytest

from iris_sysid import open_video
from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, noisy, paint
from trackers.median_background import track

SHAPE = (80, 140)


def two_that_cross(n=40):
    """Two equal discs that pass one below the other, and their labels, 1 and 7."""
    x = np.linspace(20, 120, n)
    paths = np.stack([np.column_stack([x, np.full(n, 28.0)]), np.column_stack([x[::-1], np.full(n, 52.0)])])
    images, masks = [], []
    for k in range(n):
        covered = [disc(SHAPE, *path[k], 9, lines=8) for path in paths]
        images.append(paint(paint(np.full(SHAPE, 90.0), covered[0], 200.0), covered[1], 200.0))
        masks.append(np.where(covered[0] > 0.5, 1, np.where(covered[1] > 0.5, 7, 0)).astype(np.uint8))
    return DrawnClip(noisy(images, 2.0)), masks, paths


def errors_of(tracks, paths):
    return [np.sqrt(np.mean((track.xy_px - path) ** 2)) for track, path in zip(tracks, paths, strict=True)]


def test_values_of_the_masks_name_the_bodies_and_brightness_gives_the_centres():
    clip, masks, paths = two_that_cross()
    tracks = track(clip, TrackOptions(bodies=2, mask=DrawnClip(masks)))
    assert [track.n_valid for track in tracks] == [40, 40]
    assert max(errors_of(tracks, paths)) < 0.1
    assert all(np.isfinite(track.sigma_px).all() for track in tracks)


def test_bodies_of_masks_with_one_value_are_distinguished_by_assignment():
    clip, masks, paths = two_that_cross()
    tracks = track(clip, TrackOptions(bodies=2, mask=DrawnClip([(mask > 0).astype(np.uint8) * 255 for mask in masks])))
    order = np.argsort([np.linalg.norm(track.xy_px[0] - paths[0][0]) for track in tracks])
    assert max(errors_of([tracks[k] for k in order], paths)) < 0.1


def test_folder_of_label_images_is_read_with_its_values(tmp_path):
    clip, masks, paths = two_that_cross()
    for k, mask in enumerate(masks):
        cv2.imwrite(str(tmp_path / f"{k:04d}.png"), mask)
    tracks = track(clip, TrackOptions(bodies=2, mask=open_video(tmp_path, fps=60.0)))
    assert max(errors_of(tracks, paths)) < 0.1


BAD = [
    (lambda masks: masks[:-3], {"bodies": 2}, DataError, "37 masks, but the clip has 40 frames"),
    (lambda masks: [*masks, masks[0]], {"bodies": 2}, DataError, "41 masks, but the clip has 40 frames"),
    (lambda masks: [mask[:-2] for mask in masks], {"bodies": 2}, DataError, "140x78 px, but the clip is 140x80"),
    (lambda masks: masks, {"bodies": 3}, DataError, "3 bodies were requested, but the masks hold 2"),
    (lambda masks: [0 * mask for mask in masks], {"bodies": 1}, TrackingError, "masks are empty"),
]


@pytest.mark.parametrize(("change", "options", "error", "text"), BAD)
def test_masks_that_do_not_fit_the_clip_are_refused_with_what_is_wrong(change, options, error, text):
    clip, masks, _ = two_that_cross()
    with pytest.raises(error, match=text):
        track(clip, TrackOptions(mask=DrawnClip(change(masks)), **options))
