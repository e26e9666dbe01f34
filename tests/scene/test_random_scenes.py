"""Whatever a scene says: a named error, or finite steps; nothing else, and soon.

Scenes are drawn from the schema, which follows the models, so that a new field is covered by being
declared.
"""

import json
import math
import random
import re
import time
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest

from mm_gym import (
    CompileError,
    MovingMassEnv,
    Scene,
    SceneError,
    SimulationError,
    compile_scene,
    files,
    load_scene,
    simulate,
)
from mm_gym.scene.schema import scene_schema

SCENES = Path(__file__).parents[2] / "configs" / "scenes"
MOTION = Path(__file__).parents[1] / "data" / "motion.csv"
"""The only words that a scene leaves free are names of records."""

STEPS = 200
PATIENCE = 120.0
"""Processor time [s] of a scene: the first of its kind compiles kernels, others take a tenth."""

SCHEMA = json.loads(scene_schema())
EXTREMES = [0.0, 5e-324, 1e-300, 1e-80, 1e-12, 1e12, 1e80, 1e300, 1.7e308]


def run(scene, seed):
    """Make steps of an env, or of a simulation where nothing is actuated."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"solver\.\w+ has no effect", UserWarning)
        warnings.filterwarnings("ignore", r"excitation\.\d+: the record lasts", UserWarning)
        if not any(dict(scene.actuation).values()):
            return check_simulation(scene, seed)
        env = MovingMassEnv(scene)
    env.reset(seed=seed)
    shape = env.action_space.shape
    rng = np.random.default_rng(seed)
    for n in range(STEPS):
        action = rng.uniform(-1.0, 1.0, shape).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        assert np.isfinite(info["state"]).all(), (n, info)
        assert np.isfinite(info["applied"]).all(), (n, info)
        assert np.isfinite(observation).all(), (n, observation)
        assert math.isfinite(reward), (n, reward, info)
        if terminated or truncated:
            env.reset()
    return True


def check_simulation(scene, seed):
    plant = compile_scene(scene)
    trajectory = simulate(plant, duration=min(STEPS * plant.time_step, 1e308), seed=seed)
    assert np.isfinite(trajectory.state).all()
    return True


def attempt(make, argument, seed, wrong):
    """Run a scene; note what is neither motion nor a named error, and what takes too long."""
    start, moved = time.process_time(), False
    try:
        moved = run(make(argument), seed)
    except (SceneError, CompileError, SimulationError) as error:
        if not str(error):
            wrong.append((seed, "says nothing"))
    except Exception as error:  # noqa: BLE001 - the point of the test
        wrong.append((seed, repr(error)[:200]))
    if time.process_time() - start > PATIENCE:
        wrong.append((seed, "takes too long"))
    return moved


# Random valid scenes


def number(chance, node):
    low = node.get("minimum", node.get("exclusiveMinimum", -math.inf))
    high = node.get("maximum", node.get("exclusiveMaximum", math.inf))
    while True:
        size = node.get("default", 1.0) if chance.random() < 0.7 else 1.0
        value = (size or 1.0) * 10.0 ** chance.uniform(-2.0, 2.0)
        if chance.random() < 0.03:
            value = chance.choice(EXTREMES)
        if chance.random() < 0.1:
            value = low if math.isfinite(low) else 0.0
        if low < 0.0 and chance.random() < 0.5:
            value = -value
        if low == 1.0 and value < low:
            value = low + abs(value)
        if low <= value <= high and value not in {
            node.get("exclusiveMinimum"),
            node.get("exclusiveMaximum"),
        }:
            return value


def drawn(chance, node):
    """Anything that a node of the schema describes."""
    if "$ref" in node:
        return drawn(chance, SCHEMA["$defs"][node["$ref"].rpartition("/")[2]])
    options = node.get("oneOf", node.get("anyOf"))
    if options:
        return drawn(chance, chance.choice(options))
    if "const" in node or "enum" in node:
        return chance.choice(node.get("enum", [node.get("const")]))
    return BY_TYPE[node["type"]](chance, node)


def integer(chance, node):
    return chance.randint(node.get("minimum", 0), min(node.get("maximum", 50), 50))


def array(chance, node):
    least = node.get("minItems", 0)
    count = chance.randint(least, min(node.get("maxItems", least + 3), least + 3))
    entries = [drawn(chance, node["items"]) for _ in range(count)]
    return sorted(entries) if node["items"].get("type") == "number" else entries


def table(chance, node):
    required = node.get("required", [])
    data = {
        name: drawn(chance, field)
        for name, field in node.get("properties", {}).items()
        if name in required or chance.random() < 0.5
    }
    if "patternProperties" in node:  # of a hundred names, a few
        data = dict(chance.sample(sorted(data.items()), min(len(data), chance.choice([0, 0, 3]))))
    return data


BY_TYPE = {
    "number": number,
    "integer": integer,
    "boolean": lambda chance, _: chance.random() < 0.5,
    "string": lambda *_: str(MOTION),
    "array": array,
    "object": table,
}


def without(data, finding):
    """Take out what a finding names; what is missing, with all that it is missing from."""
    name, _, text = finding.partition(": ")
    if name.startswith("randomization."):
        del data["randomization"][name.removeprefix("randomization.")]
        return
    words = name.split(".")
    if "missing" in text and len(words) > 1:
        words = words[:-1]
    while True:
        holder = data
        *above, last = words
        try:
            for word in above:
                holder = holder[int(word)] if isinstance(holder, list) else holder[word]
            del holder[int(last) if isinstance(holder, list) else last]
        except (KeyError, IndexError):
            words = above  # a default speaks against something: take out the whole
            if not words and (other := re.search(r"within ([a-z_.]+)", text)):
                words, text = other[1].split("."), ""  # or what it speaks against
            assert words, finding
        else:
            return


def valid_scene(seed):
    """A random scene, less what its rules across fields refuse."""
    chance = random.Random(seed)  # noqa: S311 - not cryptography
    data = drawn(chance, SCHEMA)
    for _ in range(100):
        try:
            return Scene(**data)
        except SceneError as error:
            without(data, str(error).splitlines()[0])
    pytest.fail(f"seed {seed}: no end of findings in {data}")


@pytest.mark.filterwarnings("ignore:excitation.*records last up to")  # longer than the episode
@pytest.mark.parametrize("count", [60, 10_000])
def test_random_valid_scene_is_refused_by_name_or_makes_finite_steps(count):
    wrong = []
    moved = sum(attempt(valid_scene, seed, seed, wrong) for seed in range(count))
    assert not wrong, f"{len(wrong)} of {count}: {wrong[:20]}"
    assert moved > 0.5 * count


# Mutated scene files

FRICTION = """\
interface.kind = "dry_friction"
interface.static_coefficient = 0.5
interface.kinetic_coefficient = 0.4
interface.reference_velocity = 0.1
[springs]
kind = "finite_stretch"
rest_length = 0.1
[[excitation]]
kind = "harmonic"
target = "ground"
amplitude = 1.0
frequency = 50.0
[[excitation]]
kind = "harmonic"
amplitude = 0.5
frequency = 30
[randomization]
"carriage.mass" = [0.1, 0.2]
"excitation.1.phase" = [0.0, 6.28]
"""
TEXTS = [FRICTION, *(file.read_text("utf-8") for file in sorted(SCENES.glob("*.toml")))]
VALUES = [
    *["0", "1", "-1", "3", "0.5", "1e-300", "1e-80", "1e-9", "1e9", "1e80", "1e300", "-1e300"],
    *["5e-324", "-0.0", "1e400", "9" * 400, "0xff", "nan", "inf", "-inf", "true", '""', "'x'"],
    *["[]", "[1]", "[1, 2]", "[2, 1]", "[0, nan]", "{}", '{ kind = "none" }', "1979-05-27"],
    *["[[1, 2], [3, 4]]", '"""', "[", "}", "=", "1.0.0", "\x00", "\ud7ff"],
]
NUMBERS = VALUES[:12]
NAMES = [
    f"{part}.{name}"
    for part, node in SCHEMA["properties"].items()
    for option in node.get("oneOf", [node])
    for name in SCHEMA["$defs"]
    .get(option.get("$ref", "").rpartition("/")[2], {})
    .get("properties", {})
]


def another_value(chance, lines, at):
    found = list(re.finditer(r"(?<![\w\"])-?\d[\d.e-]*|(?<=[=,\[] )\S+", lines[at]))
    if found:
        old = chance.choice(found)
        new = chance.choice(NUMBERS if chance.random() < 0.6 else VALUES)
        lines[at] = lines[at][: old.start()] + new + lines[at][old.end() :]


def another_field(chance, lines, _):
    value = chance.choice(NUMBERS if chance.random() < 0.6 else VALUES)
    lines.insert(0, f"{chance.choice(NAMES)} = {value}")


def misspelt_word(chance, lines, at):
    i = chance.randrange(len(lines[at]) + 1)
    lines[at] = lines[at][:i] + chance.choice(["x", "", "_", "."]) + lines[at][i + 1 :]


def missing_line(_, lines, at):
    del lines[at]


def doubled_line(chance, lines, at):
    lines.insert(at, chance.choice(lines))


def shuffled_lines(chance, lines, _):
    chance.shuffle(lines)


def strange_letter(chance, lines, at):
    i = chance.randrange(len(lines[at]) + 1)
    letter = chr(chance.choice([*range(256), 0x2028, 0xFEFF, 0xD800]))
    lines[at] = lines[at][:i] + letter + lines[at][i + 1 :]


def end_of_file(chance, lines, at):
    lines[at:] = [lines[at][: chance.randrange(len(lines[at]) + 1)]]


MUTATIONS = [
    *[another_value] * 6,
    *[another_field] * 4,
    *[misspelt_word, missing_line, doubled_line, shuffled_lines, strange_letter, end_of_file],
]


def mutated(chance):
    text = chance.choice(TEXTS)
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        lines = text.split("\n")
        chance.choice(MUTATIONS)(chance, lines, chance.randrange(len(lines)))
        text = "\n".join(lines)
    return text


def is_toml(text):
    try:
        return bool(tomllib.loads(text))
    except ValueError:
        return False


@pytest.mark.parametrize("count", [500, 100_000])
def test_mutated_file_is_refused_by_name_or_makes_finite_steps(monkeypatch, count):
    content = b""
    # In memory, because to write and open a file takes longer than all the rest.
    monkeypatch.setattr(files, "read_bytes", lambda *_, **__: content)
    moved, parsed, wrong = 0, 0, []
    for seed in range(count):
        text = mutated(random.Random(seed))  # noqa: S311 - not cryptography
        parsed += is_toml(text)
        content = text.encode("utf-8", "surrogatepass")
        moved += attempt(load_scene, "scene.toml", seed, wrong)
    assert not wrong, f"{len(wrong)} of {count}: {wrong[:20]}"
    # Otherwise the mutations are too wild to reach what they should test.
    assert parsed > 0.4 * count
    assert moved > 0.1 * count
