# SPDX-License-Identifier: GPL-3.0-or-later
"""What flickers: animations with the figures of animations.py, each with a bound.

The default tolerance promises 1 % in each picture. Errors that stay do no harm in a film; those that change are bound
here: grain and brightness by a quarter of that, jumps by half. OpenGL, which lights particles at their centres, is compared with the truth as well:
what it is wrong by must not change either.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import animations as a
import numpy as np
from animations import SIDE_LIGHT, Frames, Steadiness, Truth
from cases import Case
from scenes import aimed, ball, lamp, sun, wall

CASES: list[Case] = []

# Shares of the truth, at the default tolerance of 1 %.
GRAIN, JUMP, BRIGHTNESS = 0.0025, 0.005, 0.0025


def animation(
    name: str,
    frames: Callable[[], Frames],
    truth: Truth = a.fine,
    grain: float = GRAIN,
    jump: float = JUMP,
    brightness: float = BRIGHTNESS,
    finer: dict[str, Any] | None = None,
    **settings: Any,
) -> None:
    """Adds an animation's figures to the table; `finer` are settings of the truth that differ."""

    @functools.cache
    def measure() -> Steadiness:
        shown = frames()
        return a.steadiness(a.pictures(shown, **settings), truth(shown, **_physical(settings) | (finer or {})))

    for figure, bound in (("grain", grain), ("jump", jump), ("brightness", brightness)):
        CASES.append(Case(f"{name}: {figure}", bound, lambda figure=figure: getattr(measure(), figure)))


def _physical(settings: dict[str, Any]) -> dict[str, Any]:
    """Those that change what is true."""
    return {name: value for name, value in settings.items() if name not in ("solver", "device", "tolerance")}


def case(name: str, bound: float, measure: Callable[[], float]) -> None:
    CASES.append(Case(name, bound, measure))


MANY = ball(12_000, 5)
AREA = {"type": "AREA", "matrix": aimed((0, 0, 4)), "power": 500.0, "size": 0.6}

# ---- The processor

animation("camera moves around smoke", lambda: a.moving_camera(ball(150, 5), count=5, width=20, height=20), a.brute)
animation("camera moves around smoke of 12,000, exact", lambda: a.moving_camera(MANY), solver="EXACT")
animation("camera moves around smoke of 12,000, sweep", lambda: a.moving_camera(MANY), solver="SWEEP")
animation("camera moves around smoke cut by a wall", lambda: a.moving_camera(ball(300, 5), meshes=[wall(0.2)]))
animation("camera flies into smoke", a.flying_in)
animation("smoke comes into the frame and leaves it", a.through_the_frame)
animation("particles move", lambda: a.moving_smoke(ball(300, 5)))
animation("particles move, 12,000, exact", lambda: a.moving_smoke(MANY), solver="EXACT")
animation("particles move, 12,000, sweep", lambda: a.moving_smoke(MANY), solver="SWEEP")
animation("particles move, thin, under a sun", lambda: a.moving_smoke(ball(2000, 0.05), [sun((1, 1, -1))]))
animation("particles are born and die", lambda: a.born_and_dying(2000, 5))
animation("a speck flies off behind the smoke", lambda: a.stray(ball(300, 5), axis=1))
animation("a speck flies out of the frame, sweep", lambda: a.stray(MANY, axis=0), solver="SWEEP")
animation(
    "smoke rises to a large lamp", lambda: a.rising(ball(300, 5), [lamp(0, -1, 4, radius=0.3)], 0.1), finer={"light_samples": 100}
)
animation("smoke rises to an area light", lambda: a.rising(ball(300, 5), [AREA], 0.1), finer={"light_samples": 100})
animation(
    "smoke rises under a sky to a lamp",
    lambda: a.rising(ball(100, 5), [lamp(0, -1, 4, power=300)], 0.2, world=0.3, count=6),
    finer={"light_samples": 48, "tolerance": 3e-3},
)
animation("two particles change places", lambda: a.changing_places(1.0))

# ---- Where one method takes over from another

animation("10,000 particles are exceeded: sweep", lambda: a.born(14_000, range(9000, 11_200, 200), 5))
animation("smoke becomes too thick for the sweep", lambda: a.thickening(ball(12_000, 20), SIDE_LIGHT, 1.2), jump=0.01, brightness=0.01)
animation("smoke becomes too thick for light at its centres", lambda: a.thickening(ball(2000, 0.05), [sun((1, 1, -1))], 1.15))

# ---- Random choices

animation("subsampling 10 %, camera moves", lambda: a.moving_camera(ball(2000, 5)), subsampling=0.1)
animation("subsampling 10 %, particles move", lambda: a.moving_smoke(ball(2000, 5)), subsampling=0.1)
animation("subsampling 10 %, particles are born and die", lambda: a.born_and_dying(2000, 5), subsampling=0.1)
animation("subsampling 10 %, other smoke comes and goes", a.coming_and_going, a.at_rest, subsampling=0.1)


def reordered() -> float:
    """Largest difference between an animation and the same whose particles come in another order in each frame."""
    kept, shuffled = (a.pictures(a.born_and_dying(2000, 5, 4, order), subsampling=0.1) for order in (False, True))
    return float(np.abs(kept - shuffled).max())


case("subsampling 10 %, particles in another order each frame: difference", 0.0, reordered)

# ---- OpenGL

animation("camera moves, OpenGL", lambda: a.moving_camera(ball(2000, 0.5)), device="GL")
animation("particles move, OpenGL", lambda: a.moving_smoke(ball(2000, 0.5)), jump=0.01, device="GL")
animation("particles are born and die, OpenGL", lambda: a.born_and_dying(2000, 0.5), device="GL")
animation(
    "particles are born and die, OpenGL, subsampling 10 %", lambda: a.born_and_dying(2000, 0.5), jump=0.01, subsampling=0.1, device="GL"
)
# Drawn one after the other, two billboards of optical depth t differ in the two orders by (1 - exp(-t))^2 of what their
# colours differ by: thick ones jump as they change places.
animation(
    "two particles of optical depth 0.1 change places, OpenGL",
    lambda: a.changing_places(0.1), grain=0.02, jump=0.06, brightness=0.02, device="GL",
)
animation(
    "two particles of optical depth 1 change places, OpenGL",
    lambda: a.changing_places(1.0), grain=0.06, jump=0.2, brightness=0.1, device="GL",
)

# ---- Particles thinner than a pixel. A dense one that is alone flickers on the processor when light comes from its side:
# light is sampled a pixel apart, and a sample that its shadow meets darkens it. Among others that evens out.

case("a thin particle of a tenth of a pixel crosses one: sum", 0.01, lambda: a.across_a_pixel(0.02))
case("a dense particle of a tenth of a pixel crosses one, OpenGL: sum", 0.01, lambda: a.across_a_pixel(3.0, device="GL"))
case("a dense particle of a tenth of a pixel crosses one, light from above: sum", 0.3, lambda: a.across_a_pixel(3.0))
case("camera moves around 2,000 dense particles thinner than a pixel: sum", 0.005, a.around_dust)
