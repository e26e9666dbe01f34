"""Structures of a user's own: scenes that no setting was chosen for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from agents.controllers.constant import uncontrolled
from agents.controllers.lqg import LQG, design_lqg
from agents.scoring import evaluate
from mm_gym import Scene, compile_scene, load_scene

FOLDER = Path(__file__).parents[2] / "configs" / "structures"
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def structure(name: str) -> Scene:
    return load_scene(FOLDER / f"{name}.toml")


def frequency(scene: Scene) -> float:
    """Return the frequency of the carriage alone [Hz]."""
    return np.sqrt(scene.carriage.stiffness / scene.carriage.mass) / (2.0 * np.pi)


def test_twelve_structures_cover_four_decades_of_frequency_and_nine_of_mass():
    scenes = [structure(name) for name in NAMES]
    assert len(scenes) == 12
    assert len({scene.digest for scene in scenes}) == 12
    frequencies = np.array([frequency(scene) for scene in scenes])
    masses = [scene.carriage.mass for scene in scenes]
    assert frequencies.min() == pytest.approx(0.1, rel=0.01)
    assert frequencies.max() == pytest.approx(1e3, rel=0.01)
    assert min(masses) <= 1e-3
    assert max(masses) >= 1e6
    steps = 1.0 / (frequencies * [scene.control.time_step for scene in scenes])
    assert steps.min() == pytest.approx(5.0, rel=0.01)
    assert steps.max() == pytest.approx(200.0, rel=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_each_names_its_source_and_compiles(name: str):
    text = (FOLDER / f"{name}.toml").read_text()
    assert "# Source: " in text
    compile_scene(structure(name))


@pytest.mark.parametrize("name", ["frame", "stage", "hardening_mount"])
def test_an_lqg_needs_no_sphere(name: str):
    # Interface and springs are "none": the sphere drifts, is not shown, and matters to nothing.
    scene = structure(name)
    without = evaluate(scene, uncontrolled(scene), episodes=20).cost
    assert evaluate(scene, LQG(scene), episodes=20).cost < 0.8 * without


def test_a_harmonic_is_fed_forward_by_an_lqg_whose_phases_wander():
    scene = structure("footbridge")
    design = design_lqg(scene, wandering=True)
    names = [signal.name for signal in design.system.states]
    assert design.gain[names.index("excitation.0.cosine")] != 0.0
    assert np.isfinite(design.cost)
