"""Paint a frame: restore what the last frame changed, paint every moving layer over it, integrate the exposure."""

from __future__ import annotations

import math

import numpy as np

from iris_sysid.synthetic.backdrop import Planes, light_field, lit, shifted, wall, ycbcr
from iris_sysid.synthetic.camera import Camera
from iris_sysid.synthetic.coverage import NO_SHADING, Canvas, blend
from iris_sysid.synthetic.glow import Glow
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.scene import Curve, Stage
from iris_sysid.synthetic.shapes import Layer
from iris_sysid.types import Array

MAX_SUBEXPOSURES = 64
NO_SHIFT: Array = np.zeros(2)


class Picture:
    """The scene's image, frame after frame; only moving layers are painted again."""

    def __init__(self, stage: Stage, camera: Camera, look: Look, rng: np.random.Generator) -> None:
        self.stage, self.camera, self.look = stage, camera, look
        width, height = camera.size
        self.full, self.half = Canvas(width, height), Canvas(width // 2, height // 2)
        self.light = light_field(camera.size, look)
        self.shift, self.readout_s = NO_SHIFT, 0.0
        self.changed: list[tuple[int, int, int, int]] = []
        bare = wall(camera.size, stage.wall.colour, stage.wall.glossy, look, rng)
        for prop in stage.props:
            self._paint(bare, prop, np.zeros(1), lit_up=False)
        self.background = lit(bare, self.light)
        self.planes = self.background.copy()
        self.glow = None if stage.light is None else self._glow(stage.light)

    def _glow(self, light: Curve) -> Glow:
        """The layers as light on top of the background's."""
        for layer in self.stage.layers:
            self._paint(self.planes, layer, np.zeros(1), lit_up=True)
        box = np.array(self.changed)
        return Glow(self.background, self.planes, (*box[:, :2].min(axis=0), *box[:, 2:].max(axis=0)), self.look, light)

    def at(self, t_s: float, shift_px: Array = NO_SHIFT) -> Planes:
        """The exact image exposed about time ``t_s``, moved by ``shift_px`` (2,); valid until the next call."""
        if self.glow is not None:
            planes = self.glow.at(t_s)
            return shifted(planes, shift_px) if np.any(shift_px != 0) else planes
        self._restore(shift_px)
        for layer in self.stage.layers:
            if layer.start_s <= t_s <= layer.stop_s:
                self._paint(self.planes, layer, self._instants(layer, t_s), lit_up=True)
        return self.planes

    def _restore(self, shift_px: Array) -> None:
        if np.any(shift_px != self.shift) or np.any(shift_px != 0):
            self.planes, self.shift = shifted(self.background, shift_px), shift_px
        else:
            for left, top, right, bottom in self.changed:
                _copy(self.planes, self.background, left, top, right, bottom)
        self.changed = []

    def _instants(self, layer: Layer, t_s: float) -> Array:
        """Middle times of the sub-exposures: as many as the layer's travel in the exposure asks for."""
        exposure = self.look.exposure_s
        if exposure == 0:
            return np.array([t_s])
        ends = self._polygons(layer, t_s + exposure * np.array([-0.5, 0.0, 0.5]))
        thirds = len(ends) // 3
        first, middle, last = (ends[k : 3 * thirds : 3] for k in range(3))
        travel = np.max(np.linalg.norm(last - middle, axis=-1) + np.linalg.norm(middle - first, axis=-1))
        steps = 2 if callable(layer.opacity) else 1
        count = max(steps, min(MAX_SUBEXPOSURES, 1 + math.ceil(float(travel) / layer.blur_step_px)))
        return t_s + exposure * ((np.arange(count) + 0.5) / count - 0.5)

    def _polygons(self, layer: Layer, t_s: Array) -> Array:
        """The layer's outlines in px, (m, v, 2); m is a multiple of the number of times."""
        exact = self.camera.project(layer.outline(t_s, self.camera.pixels_per_metre))
        if self.readout_s:
            exact = self._rolled(layer, t_s, exact)
        return exact + self.shift

    def _rolled(self, layer: Layer, t_s: Array, middle: Array) -> Array:
        """Outlines under a rolling shutter: each vertex at its own row's time (quadratic in the delay)."""
        delay = self.readout_s / 2
        before, after = (
            self.camera.project(layer.outline(t_s + side * delay, self.camera.pixels_per_metre)) for side in (-1, 1)
        )
        moved = middle
        for _ in range(3):
            fraction = 2 * moved[..., 1:] / (self.camera.size[1] - 1) - 1  # -1 in the first row, 1 in the last
            moved = middle + (after - before) / 2 * fraction + ((after + before) / 2 - middle) * fraction**2
        return moved

    def _paint(self, planes: Planes, layer: Layer, t_s: Array, *, lit_up: bool) -> None:
        polygons = self._polygons(layer, t_s)
        weights = layer.weights(t_s)
        repeats = len(polygons) // t_s.size
        weights = np.tile(weights, repeats) / repeats
        self.full.add(np.ascontiguousarray(polygons), weights)
        (top, bottom), (left, right) = self.full.rows, self.full.columns()
        self.changed.append((left, top, right, bottom))
        luma, blue, red = ycbcr(layer.colour)
        brightness = self._light_at(polygons) if lit_up else 1.0
        blend((planes.luma,), self.full, (luma * brightness,), self._shading(layer, t_s))
        self.half.add(np.ascontiguousarray((polygons + 0.5) / 2 - 0.5), weights)
        tones = (128 + (blue - 128) * brightness, 128 + (red - 128) * brightness)
        blend((planes.blue, planes.red), self.half, tones)

    def _light_at(self, polygons: Array) -> float:
        x, y = np.mean(polygons, axis=(0, 1))
        row = int(np.clip(round(y), 0, self.camera.size[1] - 1))
        return float(self.light[row, int(np.clip(round(x), 0, self.camera.size[0] - 1))])

    def _shading(self, layer: Layer, t_s: Array) -> Array:
        if layer.shading is None or not self.look.shading:
            return NO_SHADING
        middle = layer.shading.centre(np.array([t_s.mean()]))
        x, y = (self.camera.project(middle)[0] + self.shift).tolist()
        along_x, along_z = layer.shading.along
        inverse = 1 / (layer.shading.radius(t_s) * self.camera.pixels_per_metre)
        return np.array([x, y, inverse, along_x, -along_z, layer.shading.limb])


def _copy(planes: Planes, source: Planes, left: int, top: int, right: int, bottom: int) -> None:
    planes.luma[top:bottom, left:right] = source.luma[top:bottom, left:right]
    rows, columns = slice(top // 2, bottom // 2 + 1), slice(left // 2, right // 2 + 1)
    planes.blue[rows, columns] = source.blue[rows, columns]
    planes.red[rows, columns] = source.red[rows, columns]
