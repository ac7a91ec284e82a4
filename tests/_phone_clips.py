"""Ordinary phone clips drawn with OpenCV: shadow, rest, passers-by, flicker, exposure steps, noise, blur, shake.

Each function returns a clip and where its bodies are, (bodies, n, 2) px; NaN where a body cannot be seen.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from tests._drawn import DrawnClip

SHIFT = 6  # bits of a fraction of a pixel in OpenCV's drawing
RED, BLUE, GREEN = (45.0, 40.0, 190.0), (170.0, 90.0, 40.0), (70.0, 150.0, 60.0)  # blue, green, red
WALL = (150.0, 165.0, 172.0)


@dataclass
class PhoneClip:
    """A clip, the true positions (bodies, n, 2) px of its bodies, and their radius in px."""

    clip: DrawnClip
    truth: np.ndarray
    radius: float


def room(shape, colour=WALL, seed=1, grain=6.0):
    """A wall with soft patches, a dark shelf and a picture, (h, w, 3) float."""
    rng = np.random.default_rng(seed)
    height, width = shape
    patches = cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), 9)
    fine = cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), 1.2)
    image = np.ones((height, width, 3)) * np.array(colour)
    image += (grain * patches / patches.std() + 0.4 * grain * fine / fine.std())[..., np.newaxis]
    image *= np.linspace(1.06, 0.9, width)[np.newaxis, :, np.newaxis]
    cv2.rectangle(image, (0, int(0.86 * height)), (width, height), (70, 95, 120), -1)
    cv2.rectangle(
        image, (int(0.08 * width), int(0.1 * height)), (int(0.3 * width), int(0.26 * height)), (60, 80, 70), 3
    )
    return image


def ball(image, centre, radius, colour, blur_px=(0.0, 0.0)):
    """Draw a shaded ball with a highlight, smeared along ``blur_px``, in place."""
    steps = max(1, round(float(np.hypot(*blur_px))))
    cover = np.zeros(image.shape[:2])
    for part in (np.arange(steps) + 0.5) / steps - 0.5:
        disc = np.zeros(image.shape[:2], np.uint8)
        place = tuple(round((c + part * b) * 2**SHIFT) for c, b in zip(centre, blur_px, strict=True))
        cv2.circle(disc, place, int(radius * 2**SHIFT), 255, -1, cv2.LINE_AA, SHIFT)
        cover += disc / (255.0 * steps)
    y, x = np.indices(image.shape[:2])
    shade = 1.0 - 0.3 * ((x - centre[0]) + 1.5 * (y - centre[1])) / (2 * radius)
    painted = np.array(colour) * np.clip(shade, 0.5, 1.4)[..., np.newaxis]
    image[:] = image * (1 - cover[..., np.newaxis]) + painted * cover[..., np.newaxis]


def shadow(image, centre, radius, depth=0.45, soft=2.5):
    """Darken the wall where the soft shadow of a ball lies, in place."""
    cover = np.zeros(image.shape[:2], np.float64)
    cv2.circle(cover, tuple(round(c * 2**SHIFT) for c in centre), int(radius * 2**SHIFT), 1.0, -1, 8, SHIFT)
    image *= 1 - depth * cv2.GaussianBlur(cover, (0, 0), soft)[..., np.newaxis]


def filmed(images, noise=2.0, seed=0, gain=None, quality=None):
    """The images with exposure ``gain`` (n,), noise and JPEG compression, as a clip of 30 frames a second."""
    rng = np.random.default_rng(seed)
    frames = []
    for k, image in enumerate(images):
        lit = image * (1.0 if gain is None else gain[k])
        frame = np.clip(np.rint(lit + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
        if quality is not None:
            frame = cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], cv2.IMREAD_COLOR)
        frames.append(frame)
    return DrawnClip(frames, fps=30.0)


def swing(n, centre, length, amplitude=0.5, period=31.0, decay=0.0):
    """A pendulum's bob (n, 2) px below a pivot at ``centre``."""
    k = np.arange(n)
    theta = amplitude * np.exp(-decay * k) * np.cos(2 * np.pi * k / period)
    return np.column_stack([centre[0] + length * np.sin(theta), centre[1] + length * np.cos(theta)])


def tossed(n, start, velocity, gravity):
    """A parabola (n, 2) px; velocity and gravity in px a frame."""
    k = np.arange(n)[:, np.newaxis]
    return np.array(start) + k * np.array(velocity) + 0.5 * k**2 * np.array([0.0, gravity])


def cord(image, pivot, centre):
    """Draw a cord, in place."""
    ends = [tuple(round(c * 2**SHIFT) for c in end) for end in (pivot, centre)]
    cv2.line(image, *ends, (90.0, 95.0, 100.0), 1, cv2.LINE_AA, SHIFT)


def red_ball_that_strikes_a_wall(n=150, scale=0.5, shake_px=1.5, seed=3):
    """Portrait, hand-held: a red ball on a cord strikes a wall, then hangs at rest, its shadow beside it."""
    shape = (round(640 * scale), round(360 * scale))
    radius, length = 22 * scale, 330 * scale
    pivot = (215 * scale, 60 * scale)
    k = np.arange(n)
    theta = 0.3 * np.exp(-k / (0.16 * n)) * np.abs(np.cos(2 * np.pi * k / 33.0))
    theta[k > 0.5 * n] *= np.exp(-(k[k > 0.5 * n] - 0.5 * n) / 3.0)
    rng = np.random.default_rng(seed)
    shake = cv2.GaussianBlur(rng.normal(0, 1, (n, 2)), (1, 25), 1.0, None, 4.0)
    shake *= shake_px / max(shake.std(), 1e-9)
    wall = room((shape[0] + 40, shape[1] + 40), seed=seed)
    cv2.rectangle(wall, (0, 0), (int(pivot[0] + 20 - radius - 2), shape[0] + 40), (120.0, 130.0, 140.0), -1)
    images, truth = [], []
    for angle, (dx, dy) in zip(theta, shake, strict=True):
        centre = (pivot[0] + length * np.sin(angle), pivot[1] + length * np.cos(angle))
        image = wall.copy()
        anchor, place = (pivot[0] + 20, pivot[1] + 20), (centre[0] + 20, centre[1] + 20)
        shadow(image, (place[0] + 1.5 * radius, place[1] + 1.6 * radius), 1.15 * radius)
        cord(image, anchor, place)
        ball(image, place, radius, RED)
        moved = cv2.warpAffine(image, np.array([[1, 0, dx - 20], [0, 1, dy - 20]]), shape[::-1], flags=cv2.INTER_LINEAR)
        images.append(moved)
        truth.append((centre[0] + dx, centre[1] + dy))
    return PhoneClip(filmed(images, 2.0, seed, quality=80), np.array([truth]), radius)


def with_shadow(n=70):
    """A blue ball swings before a wall, and its strong shadow swings beside it."""
    path, wall, images = swing(n, (150, -40), 130), room((200, 300)), []
    for place in path:
        image = wall.copy()
        shadow(image, (place[0] + 30, place[1] + 22), 14, depth=0.6)
        ball(image, place, 9, BLUE)
        images.append(image)
    return PhoneClip(filmed(images, quality=85), path[np.newaxis], 9.0)


def mostly_at_rest(n=120):
    """A red ball rolls in and rests for 65 % of the clip."""
    moving = int(0.35 * n)
    x = np.concatenate([40 + 180 * (1 - (1 - np.arange(moving) / moving) ** 2), np.full(n - moving, 220.0)])
    path, wall = np.column_stack([x, np.full(n, 150.0)]), room((200, 300))
    images = []
    for place in path:
        image = wall.copy()
        shadow(image, (place[0] + 8, place[1] + 14), 13)
        ball(image, place, 11, RED)
        images.append(image)
    return PhoneClip(filmed(images, quality=85), path[np.newaxis], 11.0)


def like_the_wall(n=70):
    """A ball of nearly the wall's colour swings; its shadow is plainer than the ball."""
    path, wall, images = swing(n, (150, -40), 150, 0.55), room((200, 300), (120, 150, 185), grain=3.0), []
    for place in path:
        image = wall.copy()
        shadow(image, (place[0] + 26, place[1] + 14), 13, depth=0.35)
        ball(image, place, 11, (95.0, 135.0, 190.0))
        images.append(image)
    return PhoneClip(filmed(images, quality=90), path[np.newaxis], 11.0)


def somebody_walks_behind(n=90):
    """A green ball swings while a person in grey walks through the picture behind it."""
    path, wall, images = swing(n, (160, -30), 140, 0.5, 33.0), room((220, 320)), []
    for k, place in enumerate(path):
        image, x = wall.copy(), -30 + 4.2 * k
        lean = 5 * np.sin(k / 2.5)
        cv2.ellipse(image, (int(x), 130), (24, 75), lean, 0, 360, (75.0, 70.0, 80.0), -1, cv2.LINE_AA)
        cv2.circle(image, (int(x + lean), 42), 16, (120.0, 150.0, 200.0), -1, cv2.LINE_AA)
        cv2.ellipse(image, (int(x + 3 * lean), 195), (11, 40), -2 * lean, 0, 360, (60.0, 50.0, 45.0), -1, cv2.LINE_AA)
        ball(image, place, 9, GREEN)
        images.append(image)
    return PhoneClip(filmed(images, quality=85), path[np.newaxis], 9.0)


def lights_that_flicker(n=80):
    """A red ball swings under lamps whose brightness beats with the shutter."""
    path, wall = swing(n, (150, -40), 150), room((200, 300))
    gain = 1 + 0.1 * np.sin(2 * np.pi * np.arange(n) / 4.3)
    return PhoneClip(filmed(_each(path, wall, 9, RED), 2.0, 0, gain, 85), path[np.newaxis], 9.0)


def exposure_that_steps(n=80):
    """A blue ball swings while the phone changes its exposure in steps of a tenth."""
    path, wall = swing(n, (150, -40), 150), room((200, 300))
    gain = np.select([np.arange(n) < 25, np.arange(n) < 45, np.arange(n) < 60], [1.0, 0.85, 1.12], 0.95)
    return PhoneClip(filmed(_each(path, wall, 9, BLUE), 2.0, 0, gain, 85), path[np.newaxis], 9.0)


def two_of_the_same_kind(n=80):
    """Two red balls swing beside each other with different periods."""
    paths = np.array([swing(n, (90, -40), 150, 0.25, 31), swing(n, (230, -40), 150, 0.3, 27)])
    wall, images = room((200, 320)), []
    for places in paths.swapaxes(0, 1):
        image = wall.copy()
        for place in places:
            ball(image, place, 9, RED)
        images.append(image)
    return PhoneClip(filmed(images, quality=85), paths, 9.0)


def behind_a_bar(n=90):
    """A red ball swings behind a post that hides it for some frames of each swing."""
    path, wall, images = swing(n, (150, -40), 150, 0.6, 37.0), room((200, 300)), []
    for place in path:
        image = wall.copy()
        ball(image, place, 9, RED)
        cv2.rectangle(image, (170, 0), (198, 200), (80.0, 85.0, 90.0), -1)
        images.append(image)
    truth = path.copy()
    truth[(path[:, 0] > 170 - 5) & (path[:, 0] < 198 + 5)] = np.nan
    return PhoneClip(filmed(images, quality=85), truth[np.newaxis], 9.0)


def in_low_light(n=80):
    """A red ball swings in the dark: a fifth of the light, much noise, heavy compression."""
    path, wall = swing(n, (150, -40), 150), room((200, 300))
    return PhoneClip(
        filmed([0.22 * image for image in _each(path, wall, 9, RED)], 6.0, 0, None, 50), path[np.newaxis], 9.0
    )


def fast_and_blurred(n=36):
    """A blue ball is thrown: it is smeared over several of its diameters."""
    path = tossed(n, (-20, 120), (11.0, -9.5), 0.6)
    velocity = np.gradient(path, axis=0)
    wall, images = room((240, 400)), []
    for place, step in zip(path, velocity, strict=True):
        image = wall.copy()
        ball(image, place, 6, BLUE, 0.9 * step)
        images.append(image)
    truth = path.copy()
    truth[(path[:, 0] < 14) | (path[:, 0] > 386) | (path[:, 1] > 226) | (path[:, 1] < 14)] = np.nan
    return PhoneClip(filmed(images, quality=85), truth[np.newaxis], 8.0)


def _each(path, wall, radius, colour):
    """The wall with a ball at each position."""
    images = []
    for place in path:
        image = wall.copy()
        ball(image, place, radius, colour)
        images.append(image)
    return images


CLIPS = (
    red_ball_that_strikes_a_wall,
    with_shadow,
    mostly_at_rest,
    like_the_wall,
    somebody_walks_behind,
    lights_that_flicker,
    exposure_that_steps,
    two_of_the_same_kind,
    behind_a_bar,
    in_low_light,
    fast_and_blurred,
)


def on_body(phone_clip, tracks):
    """Share of the frames in which a body is to be seen with the track on it: found, and on something else.

    Returns (on body, on something else), of all visible frames; within the larger of the radius and 4 px of the truth.
    Bodies are assigned to tracks as it fits best over the clip.
    """
    from scipy.optimize import linear_sum_assignment

    truth = phone_clip.truth
    limit = max(phone_clip.radius, 4.0)
    visible = np.isfinite(truth[..., 0])
    near = np.array(
        [[np.nansum(np.hypot(*(track.xy_px - path).T) < limit) for path in truth] for track in tracks], dtype=float
    )
    rows, columns = linear_sum_assignment(-near)
    hit = sum(near[r, c] for r, c in zip(rows, columns, strict=True))
    wrong = sum(int((tracks[r].valid & visible[c]).sum()) - near[r, c] for r, c in zip(rows, columns, strict=True))
    return float(hit / visible.sum()), float(wrong / visible.sum())
