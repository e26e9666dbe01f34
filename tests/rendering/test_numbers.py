"""Round numbers, and the pace at which control steps are shown."""

import pytest

from mm_gym.plant.compile import compile_scene
from mm_gym.rendering.look import FINE_STEPS, reading, round_down, round_up, unit_of
from mm_gym.rendering.subject import frames_per_second, speed_text
from mm_gym.scene import Scene


@pytest.mark.parametrize(
    ("value", "up", "down"),
    [
        (1.0, 1.0, 1.0),
        (0.3, 0.5, 0.2),
        (999.0, 1000.0, 500.0),
        (2e-7, 2e-7, 2e-7),
        (7.0, 10.0, 5.0),
    ],
)
def test_numbers_are_rounded_to_1_2_and_5(value, up, down):
    assert round_up(value) == pytest.approx(up, rel=1e-12)
    assert round_down(value) == pytest.approx(down, rel=1e-12)


def test_finer_steps_are_closer():
    assert round_up(2.2, FINE_STEPS) == 3.0
    assert round_down(2.2, FINE_STEPS) == 2.0


@pytest.mark.parametrize(
    ("length", "name"), [(3.0, "m"), (0.0025, "mm"), (4e-6, "µm"), (1e-12, "nm")]
)
def test_unit_fits_the_length(length, name):
    assert unit_of(length).name == name


@pytest.mark.parametrize(
    ("value", "largest", "text"),
    [
        (-0.5, 4.0, "\N{MINUS SIGN}0.50"),
        (1234.5, 4000.0, "1234"),
        (3e-9, 1e-7, "3.00e\N{MINUS SIGN}09"),
    ],
)
def test_readings_have_three_digits(value, largest, text):
    assert reading(value, largest) == text


@pytest.mark.parametrize(
    ("step", "frames", "speed"),
    [
        (0.002, 25, "slow motion 1 : 20"),
        (0.005, 25, "slow motion 1 : 8"),
        (0.01, 15, "slow motion 1 : 6.67"),
        (1.0, 1, "real time"),
        (5.0, 1, "fast motion 5 : 1"),
    ],
)
def test_one_frame_a_control_step_is_slowed_down_as_stated(step, frames, speed):
    plant = compile_scene(Scene(control={"time_step": step}))
    assert frames_per_second(plant) == frames
    assert speed_text(step, frames) == speed


def test_slow_carriages_are_shown_in_real_time():
    plant = compile_scene(Scene(carriage={"stiffness": 1.0}, control={"time_step": 0.05}))
    assert frames_per_second(plant) == 20
