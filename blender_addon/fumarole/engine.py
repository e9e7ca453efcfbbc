# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine: export, render, hand over, and what the user is told meanwhile."""

from __future__ import annotations

import contextlib
import traceback
from collections.abc import Iterator

import bpy
import numpy as np

from . import compat, core, deep
from .export.camera import border, export_camera, resolution
from .export.scene import Scene, build, export_scene
from .kept import Keeper
from .passes import crypto_fields, enabled, warnings as pass_warnings

# Where each stage of a render begins and how much of it it is, for the progress bar.
_STAGES = {
    "octree": (0.0, 0.05),
    "lighting": (0.05, 0.7),
    "sorting": (0.75, 0.05),
    "drawing": (0.8, 0.15),
    "passes": (0.95, 0.05),
}

# Warnings the user has seen in this render or animation.
_reported: set[str] = set()

_last_stats: core.Stats | None = None


# What Blender's persistent data keeps; there is none while the add-on is disabled.
_keeper: Keeper | None = None


def last_stats() -> core.Stats | None:
    """What the last render did, None before the first one."""
    return _last_stats


def accuracy_text(stats: core.Stats) -> str:
    """The measured errors of the light in a few words; T is the transmittance to a light."""
    rms, p95, worst, bias = stats.accuracy_rms, stats.accuracy_p95, stats.accuracy_worst, stats.accuracy_bias
    return f"T within {rms:.1g} rms, 95 % within {p95:.1g}, {worst:.1g} worst, bias {bias:+.1g}"


@bpy.app.handlers.persistent
def _forget_warnings(*_arguments: object) -> None:
    _reported.clear()


@bpy.app.handlers.persistent
def _forget_scene(*_arguments: object) -> None:
    if _keeper is not None:
        _keeper.clear()


class FumaroleEngine(bpy.types.RenderEngine):
    """Renders the smoke of a view layer. A failure is an ERROR report, which is all that makes Blender fail."""

    bl_idname = "FUMAROLE"
    bl_label = "Fumarole"
    bl_use_eevee_viewport = True

    def __init__(self, *arguments: object, **keywords: object) -> None:
        super().__init__(*arguments, **keywords)
        self._scene: Scene | None = None

    def update(self, data: bpy.types.BlendData | None = None, depsgraph: bpy.types.Depsgraph | None = None) -> None:
        """Exports the depsgraph, while Blender keeps it from changing."""
        self._scene = None
        with self._reporting():
            self.update_stats("", "Reading the scene")
            self._scene = export_scene(depsgraph)
            self._warn(self._scene.warnings)

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Renders what update() exported, all views of the depsgraph's view layer."""
        scene, self._scene = self._scene, None
        if scene is None:
            return
        with self._reporting():
            render = depsgraph.scene.render
            threads = render.threads if render.threads_mode == "FIXED" else 0
            with _core_scene(scene, threads, render.use_persistent_data) as (core_scene, warnings):
                self._warn(warnings)
                views = _views(render)
                for index, view in enumerate(views):
                    core_scene.context.progress = self._progress(index, len(views))
                    self._render_view(depsgraph, core_scene, scene, view)

    def update_render_passes(
        self, scene: bpy.types.Scene | None = None, renderlayer: bpy.types.ViewLayer | None = None
    ) -> None:
        """Tells the compositor which passes there will be."""
        for layer_pass in enabled(renderlayer, scene.world):
            item = layer_pass.item
            self.register_pass(scene, renderlayer, layer_pass.name, len(item.channels), item.channels, item.kind)

    def _render_view(
        self, depsgraph: bpy.types.Depsgraph, core_scene: core.Scene, scene: Scene, view: str
    ) -> None:
        layer = depsgraph.view_layer_eval
        pixels: dict[str, np.ndarray] = {}
        size = _size(depsgraph.scene.render)
        try:
            self.active_view_set(view)
            passes = enabled(layer, depsgraph.scene.world)
            camera = self._camera(depsgraph, scene)
            if any(item.name == "Vector" for item in passes):
                camera = camera.moving(*self._cameras_beside(depsgraph, scene))
            wanted = [name for item in passes for name in item.wanted(scene.lights)]
            is_opaque = not depsgraph.scene.render.film_transparent
            has_holdouts = is_opaque and scene.has_holdouts
            wanted += ["Holdout"] if has_holdouts else []
            deep_path = None if self.is_preview else deep.wanted_path(depsgraph, view, self.is_animation)
            settings = depsgraph.scene.fumarole.to_core()
            result = core.render(core_scene, camera, settings, wanted, deep=deep_path is not None)
            self._warn([*scene.warnings, *result.warnings, *pass_warnings(passes, scene.lights)])
            self._tell_statistics(result.stats)
            global _last_stats
            _last_stats = result.stats
            pixels = {item.name: item.pixels(result, scene.lights) for item in passes}
            if is_opaque:
                behind = scene.world.seen_by(camera) if scene.world else np.zeros(3)
                _put_over(pixels["Combined"], behind, result["Holdout"] if has_holdouts else None)
            if deep_path is not None:
                with result.deep as samples:
                    deep.write(samples, deep_path, depsgraph.scene.render)
        finally:
            self._hand_over(layer.name, view, size, pixels)
        self._stamp(".".join(filter(None, ("fumarole", layer.name, view))), result.stats, crypto_fields(layer, scene))

    def _camera(self, depsgraph: bpy.types.Depsgraph, scene: Scene) -> core.Camera:
        owner = self.camera_override or depsgraph.scene.camera
        if owner is None:
            raise core.FumaroleError(core.ErrorCode.ARGUMENT, f"Scene '{depsgraph.scene.name}' has no camera")
        owner = owner.evaluated_get(depsgraph)
        matrix = np.array(self.camera_model_matrix(owner), dtype=np.float64)
        return export_camera(owner, depsgraph.scene.render, matrix, self.camera_shift_x(owner), scene.warn)

    def _cameras_beside(self, depsgraph: bpy.types.Depsgraph, scene: Scene) -> list[core.Camera]:
        """The camera one frame before and one frame after."""
        frame, subframe = depsgraph.scene.frame_current, depsgraph.scene.frame_subframe
        cameras = []
        try:
            for step in (-1, 1):
                self.frame_set(frame + step, subframe)
                cameras.append(self._camera(depsgraph, scene))
        finally:
            self.frame_set(frame, subframe)
        return cameras

    def _hand_over(self, layer: str, view: str, size: tuple[int, int], pixels: dict[str, np.ndarray]) -> None:
        """Gives Blender the passes. It needs a result even if there are none: without one some of its writers crash."""
        result = self.begin_result(0, 0, *size, layer=layer, view=view)
        try:
            for name, values in pixels.items():
                compat.set_pass_pixels(result.layers[0].passes.find_by_name(name, view), values)
        finally:
            self.end_result(result, cancel=not pixels)

    def _stamp(self, prefix: str, stats: core.Stats, fields: dict[str, str]) -> None:
        """Writes metadata of the picture: `fields`, and the measured accuracy as `prefix`.transmittance_rms and so on."""
        rendered = self.get_result()
        if rendered is None:
            return
        for name, value in fields.items():
            rendered.stamp_data_add_field(name, value)
        if stats.accuracy_count == 0:
            return
        rendered.stamp_data_add_field(f"{prefix}.transmittance_points", str(stats.accuracy_count))
        for name in ("rms", "p95", "worst", "bias"):
            value = getattr(stats, f"accuracy_{name}")
            rendered.stamp_data_add_field(f"{prefix}.transmittance_{name}", f"{value:.3g}")

    @contextlib.contextmanager
    def _reporting(self) -> Iterator[None]:
        """Turns exceptions into reports. Of cancelling Blender knows, unless an interrupt came as an exception."""
        try:
            yield
        except core.Cancelled:
            pass
        except core.FumaroleError as error:
            self.report({"ERROR"}, f"Fumarole: {error}")
        except KeyboardInterrupt:
            self.report({"ERROR"}, "Fumarole: the render was interrupted")
        except Exception as error:
            traceback.print_exc()
            self.report({"ERROR"}, f"Fumarole: internal error, please report it: {type(error).__name__}: {error}")

    def _progress(self, view: int, view_count: int) -> core.context.Progress:
        told = ""

        def report(stage: str, fraction: float, message: str) -> bool:
            nonlocal told
            start, share = _STAGES[stage]
            self.update_progress((view + start + share * fraction) / view_count)
            # In the background each text is a line of its own: ten a stage are enough.
            text = f"{message}, {int(10 * fraction) * 10} %"
            if text != told:
                self.update_stats("", text)
                told = text
            return self.test_break()

        return report

    def _tell_statistics(self, stats: core.Stats) -> None:
        mebibytes = stats.memory_bytes / 2**20
        self.update_memory_stats(memory_used=mebibytes, memory_peak=mebibytes)
        self.update_stats(
            "",
            f"{stats.particle_count:,} particles, {stats.light_count} lights, {mebibytes:,.0f} MiB, "
            f"lighting {stats.light_s:.2f} s, drawing {stats.draw_s:.2f} s on {stats.device or 'nothing'}"
            + (f", {accuracy_text(stats)}" if stats.accuracy_count else ""),
        )

    def _warn(self, warnings: list[str]) -> None:
        for text in warnings:
            if text not in _reported:
                _reported.add(text)
                self.report({"WARNING"}, f"Fumarole: {text}")


@contextlib.contextmanager
def _core_scene(scene: Scene, threads: int, is_persistent: bool) -> Iterator[tuple[core.Scene, list[str]]]:
    """The core scene to render and the warnings of making it, if those are not its context's. Raises FumaroleError.

    Persistent: it is kept for the next render, which has it as it is if its particles and meshes are the same. After
    a failure nothing is kept.
    """
    keeper = _keeper
    if keeper is None or not is_persistent:
        _forget_scene()
        with core.Context(threads) as context:
            yield build(scene, context), []
        return
    kept = keeper.take(scene, threads)
    try:
        yield kept.core_scene, kept.warnings
    except BaseException:
        kept.close()
        raise
    keeper.keep(kept)


def _views(render: bpy.types.RenderSettings) -> list[str]:
    """Names of the views to render, "" where there is one only."""
    if not render.use_multiview:
        return [""]
    views = render.stereo_views if render.views_format == "STEREO_3D" else render.views
    return [view.name for view in views if view.use]


def _size(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of the rendered part of the picture in pixels."""
    width, height = resolution(render)
    if not render.use_border:
        return width, height
    x0, y0, x1, y1 = border(render, width, height)
    return x1 - x0, y1 - y0


def _put_over(combined: np.ndarray, background: np.ndarray, holdout: np.ndarray | None) -> None:
    """Puts premultiplied pixels (height, width, 4) over opaque colours, (3,) or (height, width, 3), in place.

    `holdout` (height, width, 3): share of it that holdouts keep out, and leave transparent, as Cycles does.
    """
    left = 1 - combined[..., 3:] if holdout is None else 1 - combined[..., 3:] - holdout
    combined[..., :3] += np.maximum(left, 0) * background.astype(np.float32)
    combined[..., 3] = 1 if holdout is None else 1 - holdout.mean(-1)


def register() -> None:
    global _keeper
    bpy.utils.register_class(FumaroleEngine)
    _keeper = Keeper()
    bpy.app.handlers.render_init.append(_forget_warnings)
    bpy.app.handlers.load_pre.append(_forget_scene)


def unregister() -> None:
    global _keeper
    bpy.app.handlers.load_pre.remove(_forget_scene)
    bpy.app.handlers.render_init.remove(_forget_warnings)
    if _keeper is not None:
        _keeper.close()
    _keeper = None
    bpy.utils.unregister_class(FumaroleEngine)
