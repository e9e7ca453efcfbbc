# SPDX-License-Identifier: GPL-3.0-or-later
"""The camera: Blender's lens, sensor and shift turned into a window at unit depth."""

from __future__ import annotations

import ctypes
import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi, _arrays
from ._library import library
from .errors import argument_error

TYPES = {"PERSPECTIVE": _abi.FUM_CAMERA_PERSPECTIVE, "ORTHOGRAPHIC": _abi.FUM_CAMERA_ORTHOGRAPHIC}
SENSOR_FITS = ("AUTO", "HORIZONTAL", "VERTICAL")


@dataclasses.dataclass(frozen=True)
class Aperture:
    """What makes depth of field.

    radius: m, at least 0; 0 is a pinhole. focus: depth along the axis that is sharp, m, above 0.
    blades: its corners, 3..64, or 0: round. rotation: of the corners, radians; the first is along local X.
    ratio: by which it is narrowed along local X, above 0.
    """

    radius: float = 0.0
    focus: float = 10.0
    blades: int = 0
    rotation: float = 0.0
    ratio: float = 1.0


@dataclasses.dataclass(init=False, frozen=True, eq=False)
class Camera:
    """A pinhole or orthographic camera that looks along its -Z. Made by Camera(...), from_window() or crop().

    matrix: (4, 4) float64, world from camera.
    window: (left, right, bottom, top) of the picture at unit depth, in metres for an orthographic camera.
    width, height: pixels. type: "PERSPECTIVE" or "ORTHOGRAPHIC". clip: (start, end), depth along the axis, m.
    motion: the camera one frame before and one frame after, None where it stands still. Set by moving().
    shutter: (open, close) in frames from now, -1..1; (0, 0) is no motion blur. aperture: depth of field. Both are set
        by blurred().
    """

    matrix: NDArray[np.float64]
    window: tuple[float, float, float, float]
    width: int
    height: int
    type: str
    clip: tuple[float, float]
    motion: tuple[Camera, Camera] | None = None
    shutter: tuple[float, float] = (0.0, 0.0)
    aperture: Aperture = Aperture()

    def __init__(
        self,
        matrix: ArrayLike | None = None,
        lens: float = 50.0,
        sensor: float = 36.0,
        sensor_height: float = 24.0,
        sensor_fit: str = "AUTO",
        width: int = 512,
        height: int = 512,
        type: str = "PERSPECTIVE",
        ortho_scale: float = 6.0,
        shift: tuple[float, float] = (0.0, 0.0),
        pixel_aspect: tuple[float, float] = (1.0, 1.0),
        clip: tuple[float, float] = (0.1, 1000.0),
    ) -> None:
        """A camera by Blender's settings.

        matrix: (4, 4) world from camera; its scale is ignored. Default identity.
        lens, sensor, sensor_height: mm, above 0. sensor_fit: "AUTO", "HORIZONTAL" or "VERTICAL"; sensor_height is
            used by "VERTICAL" alone.
        width, height: pixels of the whole picture, 1..65536.
        ortho_scale: m, the larger side of an "ORTHOGRAPHIC" camera's view.
        shift: in units of the fitted side. pixel_aspect: width and height of a pixel, above 0.
        clip: nearest and farthest depth along the axis, m, 0 <= start < end.

        Raises FumaroleError for values out of range (those of clip, width and height when it is used).
        """
        if sensor_fit not in SENSOR_FITS:
            raise argument_error(f"camera: sensor_fit is {sensor_fit!r}, expected one of {', '.join(SENSOR_FITS)}")
        positive = {"lens": lens, "sensor": sensor, "sensor_height": sensor_height, "ortho_scale": ortho_scale}
        positive |= {"width": width, "height": height, "pixel_aspect": min(pixel_aspect)}
        for name, value in positive.items():
            if not _arrays.number(value, f"camera: {name}") > 0:
                raise argument_error(f"camera: {name} is {value}, expected above 0")
        aspect = pixel_aspect[1] / pixel_aspect[0]
        horizontal = sensor_fit == "HORIZONTAL" or (sensor_fit == "AUTO" and width >= height * aspect)
        fitted = width if horizontal else height * aspect
        side = sensor_height if sensor_fit == "VERTICAL" else sensor
        pixel = (ortho_scale if type == "ORTHOGRAPHIC" else side / lens) / fitted
        center_x, center_y = shift[0] * fitted, shift[1] * fitted
        half_x, half_y = width / 2, height * aspect / 2
        window = (center_x - half_x, center_x + half_x, center_y - half_y, center_y + half_y)
        self._set(matrix, tuple(edge * pixel for edge in window), width, height, type, clip)

    @classmethod
    def from_window(
        cls,
        matrix: ArrayLike | None,
        window: tuple[float, float, float, float],
        width: int,
        height: int,
        type: str = "PERSPECTIVE",
        clip: tuple[float, float] = (0.1, 1000.0),
    ) -> Camera:
        """A camera by its window (left, right, bottom, top) at unit depth, or in metres if "ORTHOGRAPHIC"."""
        camera = cls.__new__(cls)
        camera._set(matrix, window, width, height, type, clip)
        return camera

    def crop(self, x0: int, y0: int, x1: int, y1: int) -> Camera:
        """The camera of the part of the picture from pixel (x0, y0) up to, not including, (x1, y1).

        Pixels count from the lower left. The part need not lie within the picture. Raises FumaroleError when empty.
        """
        if not (x0 < x1 and y0 < y1):
            raise argument_error(f"camera: the crop from ({x0}, {y0}) to ({x1}, {y1}) is empty")
        left, right, bottom, top = self.window
        step_x, step_y = (right - left) / self.width, (top - bottom) / self.height
        window = (left + x0 * step_x, left + x1 * step_x, bottom + y0 * step_y, bottom + y1 * step_y)
        motion = None if self.motion is None else tuple(other.crop(x0, y0, x1, y1) for other in self.motion)
        return self._with(window=window, width=x1 - x0, height=y1 - y0, motion=motion)

    def resized(self, width: int, height: int) -> Camera:
        """The same picture in so many pixels."""
        motion = None if self.motion is None else tuple(other.resized(width, height) for other in self.motion)
        return self._with(width=width, height=height, motion=motion)

    def blurred(self, shutter: tuple[float, float] = (0.0, 0.0), aperture: Aperture = Aperture()) -> Camera:
        """The same camera with its shutter open for a while, in frames from now, and with an aperture."""
        return self._with(shutter=tuple(map(float, shutter)), aperture=aperture)

    def _with(self, **changes: object) -> Camera:
        camera = Camera.__new__(Camera)
        for field in dataclasses.fields(self):
            object.__setattr__(camera, field.name, changes.get(field.name, getattr(self, field.name)))
        return camera

    def moving(self, previous: Camera, next: Camera) -> Camera:
        """The same camera, which is at `previous` one frame before and at `next` one frame after.

        For the pass Vector and for motion blur.

        Raises FumaroleError when they differ in type or size.
        """
        for other in (previous, next):
            if (other.type, other.width, other.height) != (self.type, self.width, self.height):
                raise argument_error(
                    f"camera: it moves from {other.type} {other.width} x {other.height} to {self.type} "
                    f"{self.width} x {self.height}"
                )
        return self._with(motion=(previous, next))

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where points (n, 3) of the world are in the picture: (n, 2) pixels from its lower left corner, and their
        depth (n,) along the axis, m. Of a perspective camera, pixels of points behind it are nan."""
        axes = self.matrix[:3, :3] / np.linalg.norm(self.matrix[:3, :3], axis=0)
        local = (np.asarray(points, np.float64) - self.matrix[:3, 3]) @ axes
        depth = -local[:, 2]
        scale = np.where(depth > 0, depth, np.nan)[:, None] if self.type == "PERSPECTIVE" else 1.0
        left, right, bottom, top = self.window
        place = (local[:, :2] / scale - (left, bottom)) / (right - left, top - bottom)
        return place * (self.width, self.height), depth

    def _set(
        self,
        matrix: ArrayLike | None,
        window: tuple[float, ...],
        width: int,
        height: int,
        type: str,
        clip: tuple[float, float],
    ) -> None:
        if type not in TYPES:
            raise argument_error(f"camera: type is {type!r}, expected one of {', '.join(TYPES)}")
        values = (_arrays.matrix(matrix, "camera: matrix"), tuple(map(float, window)), int(width), int(height))
        for field, value in zip(dataclasses.fields(self), (*values, type, tuple(map(float, clip)))):
            object.__setattr__(self, field.name, value)

    def struct(self) -> _abi.fum_camera:
        """The C description."""
        camera = _abi.fum_camera()
        library().fum_camera_init(ctypes.byref(camera))
        camera.type = TYPES[self.type]
        camera.world_from_camera[:] = self.matrix.ravel()
        camera.window[:] = self.window
        camera.clip_start, camera.clip_end = self.clip
        camera.width, camera.height = self.width, self.height
        if self.motion is not None:
            previous, next = self.motion
            camera.moves = 1
            camera.previous_world_from_camera[:] = previous.matrix.ravel()
            camera.previous_window[:] = previous.window
            camera.next_world_from_camera[:] = next.matrix.ravel()
            camera.next_window[:] = next.window
        camera.shutter_open, camera.shutter_close = self.shutter
        camera.aperture_radius, camera.focus_distance = self.aperture.radius, self.aperture.focus
        camera.aperture_blades, camera.aperture_rotation = self.aperture.blades, self.aperture.rotation
        camera.aperture_ratio = self.aperture.ratio
        return camera
