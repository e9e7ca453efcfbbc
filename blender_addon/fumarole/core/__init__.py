# SPDX-License-Identifier: GPL-3.0-or-later
"""Fumarole from Python, without Blender: smoke made of particles, lit and drawn by the C library.

    import numpy as np
    from fumarole import core                       # PYTHONPATH=blender_addon

    scene = core.Scene()
    position = np.random.default_rng(1).normal(0.0, 1.0, (10_000, 3))
    scene.add_particles(position, radius=0.2, density=2.0, albedo=(0.8, 0.8, 0.9), name="puff")
    scene.add_mesh([(-5, -5, -3), (5, -5, -3), (5, 5, -3), (-5, 5, -3)], [(0, 1, 2), (0, 2, 3)], name="ground")
    above = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 6], [0, 0, 0, 1]]
    lamp = scene.add_light("POINT", matrix=above, power=1000.0, color=(1.0, 0.9, 0.8))

    behind = [[1, 0, 0, 0], [0, 0, -1, -12], [0, 1, 0, 0], [0, 0, 0, 1]]
    camera = core.Camera(matrix=behind, lens=50, width=960, height=540)
    result = core.render(scene, camera, core.Settings(tolerance=0.01), passes=("Combined", "Depth"))
    result["Combined"]                              # (540, 960, 4) float32, premultiplied, first row at the bottom
    result.stats.light_s, result.warnings
    core.write_exr("puff.exr", result)
    core.transmittance(scene, [(0, 0, 0)], light=lamp)   # (1,), share of the lamp's light that arrives there

Names
    Context(threads, progress)   threads, progress, cancel, warnings; scenes without one share one
    Scene(context)               add_particles, add_mesh, add_light, add_world, clear_lights
    Camera(matrix, lens, ...)    also Camera.from_window(...), camera.crop(x0, y0, x1, y1)
    Aperture(radius, focus, ...) of a camera: camera.blurred(shutter, aperture)
    Settings(solver, tolerance, ...)
    render -> Result             result[name], .stats (Stats), .warnings, .deep (Deep: .counts, .samples, .write(path))
    measure_blur -> Blur         how many pictures a shutter and an aperture ask for: .error, .samples
    render_blurred -> Result     motion blur and depth of field as the mean of many renders; average: of your own
    render_reference -> ReferenceResult   the same by brute force in double precision: slow, and the truth
    transmittance, irradiance    the light at points
    write_exr(path, layers)
    PASSES                       mapping of pass names to Pass(name, channels, kind, description, per)
    crypto_hash(name)            the id of a matte_name in the pass CryptoObject
    version(), build_info()
    FumaroleError, Cancelled, ErrorCode

Conventions: metres, radians, linear RGB. Matrices are (4, 4), act on columns, and lead to the world. Pictures have
their first row at the bottom. A particle is a Gaussian: `density` (1/m) is its extinction at the centre, and
sigma = radius / 2. Everything that fails raises FumaroleError with a sentence that names the object and the value.

The library is loaded on first use: from the package, else from the checkout's release build, or the file that the
environment variable FUMAROLE_LIBRARY names. Needs numpy alone.
"""

from __future__ import annotations

from typing import Any

from . import _library
from .blur import MOST_SAMPLES, BlurSample, average, needed_samples, render_blurred, smears_are_lit
from .camera import Aperture, Camera
from .context import Context
from .deep import Deep
from .errors import Cancelled, ErrorCode, FumaroleError
from .image import write_exr
from .passes import Pass, crypto_hash, passes as _passes
from .reference import ReferenceResult, ReferenceStats, render_reference
from .render import Blur, Result, Stats, Wanted, irradiance, measure_blur, render, transmittance
from .scene import LINK_SETS, Scene
from .settings import Settings

__all__ = [
    "LINK_SETS",
    "MOST_SAMPLES",
    "PASSES",
    "Aperture",
    "Blur",
    "BlurSample",
    "Camera",
    "Cancelled",
    "Context",
    "Deep",
    "ErrorCode",
    "FumaroleError",
    "Pass",
    "ReferenceResult",
    "ReferenceStats",
    "Result",
    "Scene",
    "Settings",
    "Stats",
    "average",
    "build_info",
    "crypto_hash",
    "irradiance",
    "measure_blur",
    "needed_samples",
    "render",
    "render_blurred",
    "render_reference",
    "smears_are_lit",
    "transmittance",
    "version",
    "write_exr",
]


def version() -> str:
    """ "major.minor.patch" of the library. Raises FumaroleError when it cannot be loaded."""
    return _library.library().fum_version().decode()


def build_info() -> str:
    """One line for bug reports: version, instruction set, Embree and OpenEXR versions reached."""
    return _library.library().fum_build_info().decode()


def __getattr__(name: str) -> Any:
    # The table comes from the library, which is not loaded by importing this package.
    if name == "PASSES":
        return _passes()
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
