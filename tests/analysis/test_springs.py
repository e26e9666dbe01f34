"""Do stiffness and stretch follow from each other as in the paper?"""

import numpy as np
import pytest

from mm_gym import Scene, SceneError, compile_scene
from mm_gym.analysis import (
    spring_energy,
    spring_force,
    spring_stiffness,
    stretch_for_stiffness,
)

SPRINGS = {"kind": "small_on_large", "stiffness": 35.0}


@pytest.mark.parametrize("stretch", [1.0, 1.7, 3.0, 20.0])
def test_stiffness_is_that_of_the_plant(stretch):
    a, _ = compile_scene(Scene(springs=SPRINGS)).linear(stretch)
    m2 = Scene().sphere.mass
    assert spring_stiffness(stretch, 35.0) == pytest.approx(m2 * a[3, 0], rel=1e-15 * 4)


def test_stretch_is_the_inverse_of_stiffness():
    stretch, k0 = np.linspace(1.0, 5.0, 9), np.array([[35.0], [2.0]])
    back = stretch_for_stiffness(spring_stiffness(stretch, k0), k0)
    # A stiffness keeps eps of itself; of its excess over 2 k0, 0.016 at a stretch of 5, 63 eps.
    np.testing.assert_allclose(back, np.broadcast_to(stretch, back.shape), rtol=1e-14)


def test_no_stretch_softens_the_springs_to_twice_their_stiffness():
    np.testing.assert_array_equal(stretch_for_stiffness([70.0, 10.0], 35.0), np.inf)


@pytest.mark.parametrize("stretch", [0.0, -1.0, [1.5, -0.5]])
def test_no_spring_has_a_stretch_of_0_or_less(stretch):
    with pytest.raises(SceneError, match=r"stretch: got .*greater than 0"):
        spring_stiffness(stretch, 35.0)


@pytest.mark.parametrize("offset", [0.16, -0.2])
def test_collapsed_springs_have_neither_force_nor_energy(offset):
    # With a stretch of 1.5 and a rest length of 0.1 m, one side has length 0 at 0.15 m.
    assert np.isnan(spring_force(offset, 1.5, 35.0, 0.1))
    assert np.isnan(spring_energy(offset, 1.5, 35.0, 0.1))
