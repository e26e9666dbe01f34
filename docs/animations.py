"""Animations of the site: one for each task, and the moving picture of the first page.

``python docs/animations.py`` draws the latter anew, from a published policy.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mm_gym.tasks import ids, short_name

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Act = Callable[[NDArray[np.float32]], NDArray[np.float32]]

HERE = Path(__file__).parent
STATIC = HERE / "static"
MOVING = STATIC / "moving.gif"

TASK = "PreStretch"
POLICY = HERE / "policies" / f"{TASK}-gradient.safetensors"

STEPS = 60
"""Pictures of a task's animation."""

SEED, FIRST, LAST = 1_000_018, 40, 160
"""Of the moving picture: a held-out episode whose costs are near the means, and its steps."""


def animate_tasks() -> None:
    """Draw each task that has no animation yet, without an agent: every action is zero."""
    STATIC.mkdir(exist_ok=True)
    for task in ids():
        file = STATIC / f"{short_name(task)}.gif"
        if not file.exists():
            env = gymnasium.make(task, render_mode="rgb_array")
            zero = np.zeros(env.action_space.shape, np.float32)
            _write(file, _pictures(env, lambda _, zero=zero: zero, STEPS))


def compare(act: Act) -> None:
    """Draw the best constant stretch, and below it an agent of PreStretch."""
    rows = json.loads((HERE / "task_scores.json").read_text("utf-8"))[f"mm_gym/{TASK}-v0"]["rows"]
    best = next(row["controller"] for row in rows if row["role"] == "constant")
    env = gymnasium.make(f"mm_gym/{TASK}-v0", render_mode="rgb_array")
    low, high = (
        getattr(env.unwrapped.scene.actuation.stretch, one) for one in ("minimum", "maximum")
    )
    constant = np.full(1, 2.0 * (float(best.split()[-1]) - low) / (high - low) - 1.0, np.float32)
    titles = {f"best {best}": lambda _: constant, "learned controller": act}
    sides = [
        [_titled(one, title) for one in _pictures(env, law, LAST)[FIRST::2]]
        for title, law in titles.items()
    ]
    _write(MOVING, [np.vstack(pair) for pair in zip(*sides, strict=True)])


def _titled(picture: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    """Return a picture with a line of text above it."""
    image = Image.new("RGB", (picture.shape[1], picture.shape[0] + 28), "white")
    image.paste(Image.fromarray(picture), (0, 28))
    font = ImageFont.load_default(22)
    ImageDraw.Draw(image).text((image.width // 2, 15), title, "black", font, anchor="mm")
    return np.asarray(image)


def _pictures(env: gymnasium.Env, act: Act, steps: int) -> list[NDArray[np.uint8]]:
    observation, _ = env.reset(seed=SEED)
    found = []
    for _ in range(steps):
        observation = env.step(act(observation))[0]
        found.append(env.render())
    return found


def _write(file: Path, pictures: list[NDArray[np.uint8]]) -> None:
    # With fewer colours, those of small parts, such as springs and arrows, become others.
    first, *rest = [Image.fromarray(one).quantize(128) for one in pictures]
    first.save(file, save_all=True, append_images=rest, duration=80, loop=0, optimize=True)


if __name__ == "__main__":
    from agents.policies import load_policy

    policy = load_policy(POLICY)
    memory = policy.begin(1)
    compare(lambda observation: policy.act(observation[None], memory)[0].astype(np.float32))
