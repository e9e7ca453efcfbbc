# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene: sets of particles, meshes and lights."""

from __future__ import annotations

import ctypes
import math
import weakref
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _abi, _arrays, units
from ._library import library
from .context import Context, default_context
from .errors import ErrorCode, FumaroleError, argument_error

LINK_SETS = _abi.FUM_LINK_SETS
LIGHT_TYPES = _abi.choices("FUM_LIGHT_")
AREA_SHAPES = {
    "SQUARE": _abi.FUM_AREA_RECTANGLE,
    "RECTANGLE": _abi.FUM_AREA_RECTANGLE,
    "DISK": _abi.FUM_AREA_ELLIPSE,
    "ELLIPSE": _abi.FUM_AREA_ELLIPSE,
}


def described(struct: type[ctypes.Structure], name: str) -> Any:
    """A description struct with the library's defaults and the object's name."""
    description = struct()
    getattr(library(), f"{struct.__name__}_init")(ctypes.byref(description))
    description.name = name.encode(errors="replace")
    return description


class Scene:
    """What is lit and drawn. Kept from render to render, so that only what changed is built again.

    `context` None uses one shared by all such scenes. It ends with close(), at the end of a `with` block, with its
    context, or with its last reference.
    """

    def __init__(self, context: Context | None = None) -> None:
        self.context = context or default_context()
        handle = ctypes.POINTER(_abi.fum_scene)()
        self.context.call("fum_scene_create", self.context.handle, ctypes.byref(handle))
        self._handle = handle
        self._light_count = 0
        # The context is among the arguments so that it lives at least as long as its scenes.
        self._finalizer = weakref.finalize(self, _destroy, handle, self.context)
        self.context._children.add(self)

    @property
    def handle(self) -> Any:
        """Pointer to the C scene. Raises FumaroleError once closed."""
        if not self._finalizer.alive:
            raise FumaroleError(ErrorCode.ARGUMENT, "the scene is closed")
        return self._handle

    def add_particles(
        self,
        position: ArrayLike,
        radius: ArrayLike | None = None,
        density: ArrayLike | None = None,
        albedo: ArrayLike | None = None,
        emission: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        ident: ArrayLike | None = None,
        anisotropy: float = 0.0,
        name: str = "particles",
        light_set: int = 0,
        shadow_set: int = 0,
        visible_to_camera: bool = True,
        extinction_color: ArrayLike | None = None,
        matte_name: str | None = None,
        map: ArrayLike | None = None,
    ) -> None:
        """Adds n particles, Gaussians of sigma = radius / 2. Arrays are copied; float32 ones without another copy.

        position: (n, 3) world space, m.
        radius: a number or (n,), m, at least 0; default 0.1.
        density: a number or (n,), extinction at the centre, 1/m, at least 0; default 1.
        albedo: a number, an RGB triple or (n, 3), single-scattering albedo 0..1; default 0.8.
        emission: the same shapes, radiance emitted per metre at the centre, W/(m^3 sr); default 0.
        velocity: (3,) or (n, 3), m a frame, for the pass Vector; default 0.
        ident: (n,) integers from 0 on, a stable identity of each particle; default 0, 1, 2...
        anisotropy: g of the Henyey-Greenstein phase function, above -1 and below 1.
        name: for errors and warnings.
        light_set: 0..63; lights whose `light_sets` hold it shine on the particles.
        shadow_set: 0..63; lights whose `shadow_sets` hold it are blocked by the particles. -1: no light is.
        visible_to_camera: False: the particles aren't drawn, but block light all the same.
        extinction_color: an RGB triple or (n, 3), factors on the density for red, green and blue light, at least 0;
            default 1. Light that passes is tinted by what is left: an artistic colour of shadows as well.
        matte_name: what Cryptomatte calls them; sets of one name are one. Default: name.
        map: (height, width, 4) linear RGB, not premultiplied, and opacity, each 0..1, first row at the bottom: an image on a
            square that faces the camera, as wide as the particle, turned by an angle that follows from its ident. Its
            opacity shapes the particle and doesn't change how much smoke it is, its colour multiplies albedo and
            emission. Lights don't see it.

        Single particles with a value that is not finite or out of range are dropped, with a warning that counts them.
        Raises FumaroleError for wrong shapes and for numbers out of range.
        """
        positions = _arrays.rows(position, 3, f"position of {name!r}")
        count = len(positions)
        description = described(_abi.fum_particles_desc, name)
        description.count = count
        _arrays.point(description, "positions", positions)
        description.anisotropy = _arrays.number(anisotropy, f"anisotropy of {name!r}")
        _set_links(description, light_set, shadow_set, name)
        description.visible_to_camera = bool(visible_to_camera)
        _set_numbers(description, "radius", "radii", radius, count, name)
        _set_numbers(description, "density", "densities", density, count, name)
        _set_colors(description, "albedo", "albedos", albedo, count, name)
        _set_colors(description, "emission", "emissions", emission, count, name)
        _set_colors(description, "extinction_color", "extinction_colors", extinction_color, count, name)
        if velocity is not None:
            velocities = _arrays.floats(velocity, f"velocity of {name!r}")
            if velocities.shape == (3,):
                velocities = np.tile(velocities, (count, 1))
            _arrays.point(description, "velocities", _arrays.rows(velocities, 3, f"velocity of {name!r}", count))
        if ident is not None:
            idents = _arrays.integers(ident, np.uint64, f"ident of {name!r}")
            if idents.shape != (count,):
                raise argument_error(f"ident of {name!r} has shape {idents.shape}, expected ({count},)")
            _arrays.point(description, "ids", idents)
        if matte_name is not None:
            description.matte_name = matte_name.encode()
        if map is not None:
            pixels = _arrays.image(map, 4, f"map of {name!r}")
            _arrays.point(description, "map", pixels)
            description.map_height, description.map_width = pixels.shape[:2]
        self.context.call("fum_scene_add_particles", self.handle, ctypes.byref(description))

    def add_mesh(
        self,
        vertices: ArrayLike,
        triangles: ArrayLike,
        matrix: ArrayLike | None = None,
        name: str = "mesh",
        visible_to_shadow: bool = True,
        visible_to_camera: bool = True,
        light_set: int = 0,
        shadow_set: int = 0,
        albedo: ArrayLike = 0.8,
        emission: ArrayLike = 0.0,
        holdout: bool = False,
        normals: ArrayLike | None = None,
    ) -> None:
        """Adds triangles that cast shadows on the smoke and hide it.

        vertices: (n, 3) local space, m, finite. triangles: (m, 3) integers below n.
        matrix: (4, 4) world from local, acting on columns; default identity.
        visible_to_shadow: casts shadows on smoke. visible_to_camera: hides the smoke behind it.
        light_set, shadow_set: 0..63, as of add_particles(); the first where light on solids is asked for, as by the pass Shadow.
        albedo, emission: a number or an RGB triple: share of the light that it reflects where solids are shaded, 0..1,
            and radiance that it shows there, W/(m^2 sr), at least 0, which lights nothing else.
        holdout: transparent also where solids are shaded.
        normals: (m, 3, 3) of the triangles' corners, local space: light between them is that of a smooth surface.
        name: for errors. Raises FumaroleError.
        """
        corners = _arrays.rows(vertices, 3, f"vertices of {name!r}")
        faces = _arrays.integers(triangles, np.uint32, f"triangles of {name!r}")
        if faces.size == 0:
            faces = faces.reshape(0, 3)
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise argument_error(f"triangles of {name!r} has shape {faces.shape}, expected (m, 3)")
        description = described(_abi.fum_mesh_desc, name)
        description.vertex_count, description.triangle_count = len(corners), len(faces)
        _arrays.point(description, "vertices", corners)
        _arrays.point(description, "triangles", faces)
        _set_links(description, light_set, shadow_set, name)
        description.world_from_local[:] = _arrays.matrix(matrix, f"matrix of {name!r}").ravel()
        description.visibility = _abi.FUM_VISIBLE_TO_SHADOW * bool(visible_to_shadow)
        description.visibility |= _abi.FUM_VISIBLE_TO_CAMERA * bool(visible_to_camera)
        if normals is not None:
            given = _arrays.floats(normals, f"normals of {name!r}")
            if given.shape != (len(faces), 3, 3):
                raise argument_error(f"normals of {name!r} has shape {given.shape}, expected ({len(faces)}, 3, 3)")
            _arrays.point(description, "normals", given)
        description.albedo[:] = _arrays.triple(albedo, f"albedo of {name!r}")
        description.emission[:] = _arrays.triple(emission, f"emission of {name!r}")
        description.is_holdout = bool(holdout)
        self.context.call("fum_scene_add_mesh", self.handle, ctypes.byref(description))

    def add_light(
        self,
        type: str,
        matrix: ArrayLike | None = None,
        power: float = 1.0,
        color: ArrayLike = (1.0, 1.0, 1.0),
        name: str = "light",
        radius: float = 0.0,
        angle: float = 0.0,
        spot_angle: float = math.pi / 4,
        spot_blend: float = 0.15,
        shape: str = "SQUARE",
        size: float = 1.0,
        size_y: float = 1.0,
        spread: float = math.pi,
        normalize: bool = True,
        casts_shadows: bool = True,
        cycles: tuple[int, ...] = (5, 0),
        light_sets: Iterable[int] | None = None,
        shadow_sets: Iterable[int] | None = None,
    ) -> int:
        """Adds a light in Blender's units, as bright as Cycles of Blender version `cycles` makes it. Gives its index.

        type: "POINT", "SPOT", "SUN" or "AREA"; light from all around is added by add_world.
        matrix: (4, 4) world from light; the light shines along its -Z. Default identity.
        power: W; of a sun its strength, W/m^2. At least 0. color: linear RGB, multiplies the power.
        radius: POINT, SPOT: m. angle: SUN: full angle of its disc, radians, 0..pi.
        spot_angle: SPOT: full angle of the cone, radians, above 0 and at most pi. spot_blend: its soft share, 0..1.
        shape: AREA: "SQUARE", "RECTANGLE", "DISK" or "ELLIPSE". size: its width or diameter, m; size_y: the height of
            "RECTANGLE" and "ELLIPSE". The matrix's scale multiplies both. At least 0; where one is 0 nothing shines.
        spread: AREA: full angle that it shines over, radians, above 0 and at most pi.
        casts_shadows: False: neither solids nor smoke block it.
        normalize: False keeps the radiance when the light's size changes (Blender 4.5 on).
        light_sets: sets of particles and meshes, each 0..63, that it shines on; None: all.
        shadow_sets: sets of particles and meshes, each 0..63, that block it; None: all.
        name: for errors.

        Raises FumaroleError for values out of range.
        """
        lamps = [known for known in LIGHT_TYPES if known != "ENVIRONMENT"]
        if type not in lamps:
            raise argument_error(f"type of {name!r} is {type!r}, expected one of {', '.join(lamps)}")
        description = described(_abi.fum_light_desc, name)
        description.type = LIGHT_TYPES[type]
        description.casts_shadows = bool(casts_shadows)
        description.light_sets = _mask(light_sets, f"light_sets of {name!r}")
        description.shadow_sets = _mask(shadow_sets, f"shadow_sets of {name!r}")
        world = _arrays.matrix(matrix, f"matrix of {name!r}")
        watts = _arrays.number(power, f"power of {name!r}") * _arrays.triple(color, f"color of {name!r}")
        if type in ("POINT", "SPOT"):
            description.radius = _arrays.number(radius, f"radius of {name!r}")
            intensity = units.point_intensity(watts, radius, normalize)
        if type == "SPOT":
            description.spot_angle = _arrays.number(spot_angle, f"spot_angle of {name!r}")
            description.spot_blend = _arrays.number(spot_blend, f"spot_blend of {name!r}")
            description.spot_cosine = units.spot_has_cosine(cycles)
            if not units.spot_uses_scale(cycles):
                world[:3, :3] /= _spot_scale(world, name)
        elif type == "SUN":
            description.sun_angle = _arrays.number(angle, f"angle of {name!r}")
            intensity = units.sun_irradiance(watts, angle, normalize, cycles)
        elif type == "AREA":
            lengths = _area_size(world, shape, size, size_y, name)
            if not lengths.all():  # emits nothing, as in Cycles
                world, lengths, watts = np.eye(4), np.ones(2), np.zeros(3)
            description.area_shape = AREA_SHAPES[shape]
            description.area_size[:] = lengths
            description.area_spread = _arrays.number(spread, f"spread of {name!r}")
            full = math.pi / 4 if AREA_SHAPES[shape] == _abi.FUM_AREA_ELLIPSE else 1.0
            intensity = units.area_radiance(watts, full * lengths[0] * lengths[1], normalize, cycles)
        description.world_from_light[:] = world.ravel()
        description.intensity[:] = intensity
        self.context.call("fum_scene_add_light", self.handle, ctypes.byref(description))
        self._light_count += 1
        return self._light_count - 1

    def add_world(
        self,
        color: ArrayLike = (1.0, 1.0, 1.0),
        pixels: ArrayLike | None = None,
        matrix: ArrayLike | None = None,
        name: str = "world",
        casts_shadows: bool = True,
        light_sets: Iterable[int] | None = None,
        shadow_sets: Iterable[int] | None = None,
    ) -> int:
        """Adds light from all around, through smoke and past solids. Gives its index among the lights.

        color: linear RGB, radiance, W/(m^2 sr), at least 0; with pixels a factor on them.
        pixels: (height, width, 3) linear RGB, finite and at least 0, first row at the bottom: an equirectangular picture
            mapped as Blender's Environment Texture. Its middle is seen along X, the middle of its left half along Y.
        matrix: (4, 4) world from picture; its rotation turns the picture. Default identity.
        casts_shadows: False: neither solids nor smoke block it.
        light_sets, shadow_sets: as of add_light().
        name: for errors. Raises FumaroleError for values out of range.
        """
        description = described(_abi.fum_light_desc, name)
        description.type = LIGHT_TYPES["ENVIRONMENT"]
        description.casts_shadows = bool(casts_shadows)
        description.light_sets = _mask(light_sets, f"light_sets of {name!r}")
        description.shadow_sets = _mask(shadow_sets, f"shadow_sets of {name!r}")
        description.intensity[:] = _arrays.triple(color, f"color of {name!r}")
        description.world_from_light[:] = _arrays.matrix(matrix, f"matrix of {name!r}").ravel()
        if pixels is not None:
            picture = _arrays.image(pixels, 3, f"pixels of {name!r}")
            _arrays.point(description, "environment_pixels", picture)
            description.environment_height, description.environment_width = picture.shape[:2]
        self.context.call("fum_scene_add_light", self.handle, ctypes.byref(description))
        self._light_count += 1
        return self._light_count - 1

    def clear_lights(self) -> None:
        """Removes all lights. Particles, meshes and what was built from them are kept."""
        library().fum_scene_clear_lights(self.handle)
        self._light_count = 0

    def close(self) -> None:
        """Frees the scene. Later use raises FumaroleError."""
        self._finalizer()

    def __enter__(self) -> Scene:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()


def _set_links(description: Any, light_set: int, shadow_set: int, name: str) -> None:
    description.light_set = _arrays.whole(light_set, f"light_set of {name!r}")
    description.shadow_set = _arrays.whole(shadow_set, f"shadow_set of {name!r}")


def _mask(sets: Iterable[int] | None, what: str) -> int:
    """A bit for each set."""
    if sets is None:
        return (1 << _abi.FUM_LINK_SETS) - 1
    result = 0
    for value in sets:
        number = _arrays.whole(value, what)
        if not 0 <= number < _abi.FUM_LINK_SETS:
            raise argument_error(f"{what} holds {number}, expected 0 to {_abi.FUM_LINK_SETS - 1}")
        result |= 1 << number
    return result


def _destroy(handle: Any, _context: Context) -> None:
    library().fum_scene_destroy(handle)


def _set_numbers(description: Any, one: str, many: str, value: ArrayLike | None, count: int, name: str) -> None:
    """Sets the field `one` to a number, or the field `many` to an array of `count`."""
    if value is None:
        return
    what = f"{one} of {name!r}"
    array = _arrays.floats(value, what) if np.ndim(value) else None
    if array is None:
        setattr(description, one, _arrays.number(value, what))
    elif array.shape == (count,):
        _arrays.point(description, many, array)
    else:
        raise argument_error(f"{what} has shape {array.shape}, expected a number or ({count},)")


def _set_colors(description: Any, one: str, many: str, value: ArrayLike | None, count: int, name: str) -> None:
    """Sets the field `one` to an RGB triple, or the field `many` to an array of (count, 3)."""
    if value is None:
        return
    what = f"{one} of {name!r}"
    if np.ndim(value) == 2:
        _arrays.point(description, many, _arrays.rows(value, 3, what, count))
    else:
        getattr(description, one)[:] = _arrays.triple(value, what)


def _spot_scale(world: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    """Lengths of the matrix's three axes, all above 0."""
    lengths = np.linalg.norm(world[:3, :3], axis=0)
    if not lengths.all():
        raise argument_error(f"matrix of {name!r} has the scale {tuple(lengths.tolist())}, expected none of them 0")
    return lengths


def _area_size(world: NDArray[np.float64], shape: str, size: float, size_y: float, name: str) -> NDArray[np.float64]:
    """Full width and height of an area light in the world, m."""
    if shape not in AREA_SHAPES:
        raise argument_error(f"shape of {name!r} is {shape!r}, expected one of {', '.join(AREA_SHAPES)}")
    width = _arrays.number(size, f"size of {name!r}")
    height = width if shape in ("SQUARE", "DISK") else _arrays.number(size_y, f"size_y of {name!r}")
    if not (0 <= width < math.inf and 0 <= height < math.inf):
        raise argument_error(f"the size of area light {name!r} is {width} x {height} m, expected finite and at least 0")
    return np.array([width, height]) * np.linalg.norm(world[:3, :2], axis=0)
