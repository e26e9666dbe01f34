"""Whatever is written: a named error, or a finite motion."""

import copy
import math
import random
import warnings

import numpy as np
import pytest
from tasks import TASKS

from mm_gym import CompileError, Scene, SceneError, SimulationError, compile_scene, simulate

VALUES = [
    *[0, 1, -1, 3, 0.5, 1e-300, 1e-80, 1e-9, 1e9, 1e80, 1e300, -1e300, 5e-324, 10**400, -0.0],
    *[math.nan, math.inf, -math.inf, True, None, "", "viscous", "1.0", b"x", [], {}, [1], [1, 2]],
    *[[2, 1], [0, math.nan], (0.1, 0.2), {1: 2}, {"kind": "none"}, object(), 1j, {0.1, 0.2}],
]
NAMES = ["", "mass", "mas", "kind", "stretch", "0", "sphere.mass", "phase", "__class__", "é"]

BASES = [
    *[scene.model_dump() for scene in TASKS.values()],
    Scene(springs={"kind": "small_on_large"}, randomization={"sphere.mass": (0.1, 2)}).model_dump(),
    Scene(
        excitation=[
            {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0, "target": "ground"},
            {"kind": "harmonic", "amplitude": 1.0, "frequency": 30.0},
        ]
    ).model_dump(),
]


def holders(data):
    """Every dictionary and list in the data, itself included."""
    yield data
    for child in data.values() if isinstance(data, dict) else data:
        if isinstance(child, dict | list) and child:
            yield from holders(child)


def as_lists(data):
    if isinstance(data, dict):
        return {key: as_lists(value) for key, value in data.items()}
    return [as_lists(value) for value in data] if isinstance(data, list | tuple) else data


def mutated(chance):
    data = as_lists(copy.deepcopy(chance.choice(BASES)))
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        holder = chance.choice(list(holders(data)))
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        if isinstance(holder, dict) and (not keys or chance.random() < 0.1):
            holder[chance.choice(NAMES)] = chance.choice(VALUES)
        elif chance.random() < 0.1:
            del holder[chance.choice(keys)]
        else:
            # Mostly numbers, which get further than what has the wrong type.
            numbers = VALUES[:15] if chance.random() < 0.7 else VALUES
            holder[chance.choice(keys)] = chance.choice(numbers)
    return data


@pytest.mark.parametrize("block", range(10))
def test_mutated_scene_is_refused_by_name_or_moves_finitely(block):
    moved, messages = 0, []
    for i in range(60):
        data = mutated(random.Random(1000 * block + i))  # noqa: S311 - not cryptography
        try:
            scene = Scene(**data)
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", r"solver\.\w+ has no effect", UserWarning)
                plant = compile_scene(scene)
            trajectory = simulate(plant, duration=min(3.0 * plant.time_step, 1e308))
        except (SceneError, CompileError, SimulationError) as error:
            messages.append(str(error))
            continue
        assert np.isfinite(trajectory.state).all(), data
        moved += 1
    # Otherwise the mutations are too wild to reach what they should test.
    assert moved >= 5
    assert all(messages)
