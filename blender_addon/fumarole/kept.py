# SPDX-License-Identifier: GPL-3.0-or-later
"""The core scene that Blender's persistent data keeps from one render to the next; knows no bpy."""

from __future__ import annotations

from . import core
from .export.scene import Scene, add_lights, build_matter, fingerprint


class KeptScene:
    """A core scene with its context, what it was made of, and what the library warned of when it was made."""

    def __init__(self, scene: Scene, digest: bytes, threads: int) -> None:
        self.digest = digest
        self.context = core.Context(threads)
        try:
            self.core_scene = build_matter(scene, self.context)
            self.warnings = self.context.warnings
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self.context.close()


class Keeper:
    """Holds at most one scene between renders. A render takes it out, so that two never share it."""

    def __init__(self) -> None:
        self._kept: KeptScene | None = None
        self._is_closed = False

    @property
    def is_empty(self) -> bool:
        return self._kept is None

    def take(self, scene: Scene, threads: int) -> KeptScene:
        """A core scene of the exported one with its lights: the kept one where nothing but lights differs.

        What was kept and is of no use is freed before another is made. The caller owns the result: it hands it to
        keep(), or closes it. Raises core.FumaroleError.
        """
        kept, self._kept = self._kept, None
        digest = fingerprint(scene)
        if kept is not None and kept.digest != digest:
            kept.close()
            kept = None
        result = kept or KeptScene(scene, digest, threads)
        try:
            # Warnings of an earlier render are none of this one's; those of making the scene are kept beside it.
            result.context.clear_warnings()
            result.context.threads = threads
            result.core_scene.clear_lights()
            add_lights(result.core_scene, scene)
        except BaseException:
            result.close()
            raise
        return result

    def keep(self, kept: KeptScene) -> None:
        """Keeps a scene for the next render, and lets go of what it needs during a render alone."""
        kept.context.progress = None
        self.clear()
        if self._is_closed:
            kept.close()
        else:
            self._kept = kept

    def clear(self) -> None:
        """Frees what is kept."""
        kept, self._kept = self._kept, None
        if kept is not None:
            kept.close()

    def close(self) -> None:
        """Frees what is kept; whatever comes later is freed at once."""
        self._is_closed = True
        self.clear()
