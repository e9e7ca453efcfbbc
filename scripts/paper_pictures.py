# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures side by side in one PNG file, under the same exposure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

BACKGROUND = 0.01  # radiance behind the smoke
TITLE = 26  # pixels
GAP = 6
DPI = 100


def encode(picture: np.ndarray, white: float) -> np.ndarray:
    """sRGB of a premultiplied picture (height, width, 4) over the background."""
    over = picture[..., :3] / white + (1.0 - picture[..., 3:]) * BACKGROUND
    linear = np.clip(over, 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def write_sheet(path: Path, pictures: Mapping[str, np.ndarray], white: float | None = None) -> None:
    """Pictures of one size, (height, width, 4) with the first row on top, each under its title.

    white: the radiance that is drawn as white. Default: only half a percent of all the smoke is brighter.
    """
    first = next(iter(pictures.values()))
    height, width = first.shape[:2]
    if white is None:
        lit = np.concatenate([view[..., :3].max(axis=2)[view[..., 3] > 0.01] for view in pictures.values()])
        white = float(np.quantile(lit, 0.995)) if lit.size and lit.max() > 0 else 1.0
    top = TITLE if any(pictures) else 0
    size = (len(pictures) * (width + GAP) - GAP, height + top)
    figure = pyplot.figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI, facecolor="white")
    for index, (title, picture) in enumerate(pictures.items()):
        left = index * (width + GAP) / size[0]
        axes = figure.add_axes((left, 0.0, width / size[0], height / size[1]))
        axes.imshow(encode(picture, white), interpolation="nearest", aspect="auto")
        axes.axis("off")
        if title:
            axes.set_title(title, fontsize=9, pad=6, color="#333333")
    figure.savefig(path, dpi=DPI, facecolor="white", metadata={"Software": None})
    pyplot.close(figure)
