"""Laws of physics that every motion obeys."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle import error, scale_of

from mm_gym import Scene, simulate

STEPS = 60


def numbers(low, high):
    """Return numbers of a range; subnormal ones would measure the format, not the method."""
    return st.floats(low, high, allow_subnormal=False)


def log_numbers(low, high):
    return numbers(np.log(low), np.log(high)).map(lambda x: float(np.exp(x)))


def forces(steps=STEPS):
    # A square wave of random period and size has enough variety, and shrinks well.
    return st.builds(
        lambda size, period: size * np.sign(np.sin(np.arange(steps) / period)),
        numbers(-3.9, 3.9),
        numbers(0.5, 20.0),
    )


systems = st.fixed_dictionaries(
    {
        "carriage": st.fixed_dictionaries(
            {
                "mass": log_numbers(0.01, 1.0),
                "stiffness": log_numbers(10.0, 1e4),
                "damping": log_numbers(0.01, 10.0),
            }
        ),
        "sphere": st.fixed_dictionaries({"mass": log_numbers(0.01, 1.0)}),
        "interface": st.fixed_dictionaries(
            {"kind": st.just("viscous"), "damping": log_numbers(0.01, 10.0)}
        ),
    }
)
sprung = st.builds(
    lambda system, stiffness, stretch: (
        system | {"springs": {"kind": "small_on_large", "stiffness": stiffness, "stretch": stretch}}
    ),
    systems,
    log_numbers(1.0, 100.0),
    numbers(1.0, 3.0),
)
starts = st.tuples(*[numbers(-0.02, 0.02)] * 2, *[numbers(-0.5, 0.5)] * 2)


def scene_of(system, start=(0.01, 0.02, 0.0, 0.0), *, time_step=0.01, limit=1e3, **more):
    x1, offset, v1, v2 = start
    return Scene(
        **system,
        initial={
            "carriage_displacement": x1,
            "sphere_offset": offset,
            "carriage_velocity": v1,
            "sphere_velocity": v2,
        },
        actuation={"force": {"limit": limit}},
        control={"time_step": time_step, "steps": STEPS},
        **more,
    )


@given(systems, starts, forces())
def test_first_integral_is_constant_under_any_force_on_the_carriage(system, start, force):
    state = simulate(scene_of(system, start), action=force).state
    m2, c = system["sphere"]["mass"], system["interface"]["damping"]
    momentum, memory = m2 * state[:, 3], c * (state[:, 1] - state[:, 0])
    # Each step rounds four products in each component: 1e-15 of the largest.
    scale = m2 * np.abs(state[:, 2:]).max() + c * np.abs(state[:, :2]).max()
    integral = momentum + memory
    assert np.abs(integral - integral[0]).max() <= STEPS * 1e-15 * scale


@given(sprung, starts, starts, forces(), forces())
def test_motions_superpose(system, one, other, force, another):
    both = tuple(a + b for a, b in zip(one, other, strict=True))
    together = simulate(scene_of(system, both), action=force + another).state
    apart = [
        simulate(scene_of(system, one), action=force).state,
        simulate(scene_of(system, other), action=another).state,
    ]
    # Round-off of either part, which may cancel in the sum.
    scale = sum(np.abs(part).max(axis=0) for part in apart)
    scale[:2], scale[2:] = scale[:2].max(), scale[2:].max()
    assert (np.abs(together - apart[0] - apart[1]) <= 1e-13 * scale + 1e-300).all()


@given(sprung, starts, forces())
def test_mirrored_scene_moves_mirrored_to_the_last_bit(system, start, force):
    # Negation is exact, and so rounding is symmetric.
    mirrored = tuple(-value for value in start)
    state = simulate(scene_of(system, start), action=force).state
    mirror = simulate(scene_of(system, mirrored), action=-force).state
    assert np.array_equal(state, -mirror)


@given(sprung, starts, forces(STEPS // 2))
def test_one_step_of_twice_the_length_equals_two(system, start, force):
    coarse = simulate(scene_of(system, start, time_step=0.02), action=force, duration=0.6)
    fine = simulate(scene_of(system, start), action=np.repeat(force, 2), duration=0.6)
    # Round-off only: 60 steps of 1e-15.
    assert error(fine.state[::2], coarse.state) <= 1e-13


@given(sprung, starts, numbers(5.0, 100.0), numbers(0.0, 6.0), st.integers(1, STEPS - 1))
def test_motion_continues_from_any_instant_with_the_phase_reached(
    system, start, frequency, phase, split
):
    def run(start, phase, steps):
        harmonic = {"kind": "harmonic", "amplitude": 2.0, "frequency": frequency, "phase": phase}
        return simulate(scene_of(system, start, excitation=[harmonic]), duration=0.01 * steps).state

    whole = run(start, phase, STEPS)
    x1, x2, v1, v2 = whole[split]
    rest = run((x1, x2 - x1, v1, v2), phase + frequency * 0.01 * split, STEPS - split)
    # The phase at the split, up to 66 rad, is rounded by up to 1.4e-14 rad.
    assert error(rest, whole[split:], scale_of(whole)) <= 1e-12


@given(sprung, starts, forces(), st.sampled_from([1e-6, 0.3, 7.0, 1e9]))
def test_unit_of_mass_does_not_matter(system, start, force, unit):
    scaled = {
        part: {
            name: value * unit if name in {"mass", "stiffness", "damping"} else value
            for name, value in fields.items()
        }
        for part, fields in system.items()
    }
    state = simulate(scene_of(system, start), action=force).state
    other = simulate(scene_of(scaled, start, limit=1e3 * unit), action=force * unit).state
    # The scaled parameters are rounded by 1e-16 each; 60 steps span less than 600 rad.
    assert error(other, state) <= 600 * 1e-15


@given(sprung, starts, st.sampled_from([1e-3, 0.3, 60.0]))
def test_unit_of_time_does_not_matter(system, start, unit):
    exponent = {"stiffness": -2, "damping": -1}
    scaled = {
        part: {
            name: value * unit ** exponent[name] if name in exponent else value
            for name, value in fields.items()
        }
        for part, fields in system.items()
    }
    x1, offset, v1, v2 = start
    state = simulate(scene_of(system, start)).state
    other = simulate(
        scene_of(scaled, (x1, offset, v1 / unit, v2 / unit), time_step=0.01 * unit)
    ).state
    # As for the unit of mass.
    assert error(other * [1.0, 1.0, unit, unit], state) <= 600 * 1e-15


@given(sprung, starts)
def test_energy_never_grows_without_input(system, start):
    energy = simulate(scene_of(system, start)).energy
    assert np.diff(energy).max() <= 1e-14 * energy[0]


def test_energy_decays_to_nothing():
    # The slower of the two modes of this system decays at 1.0 1/s or faster: exp(-40) in 20 s.
    system = {"springs": {"kind": "small_on_large"}, "interface": {"damping": 0.1}}
    system["interface"]["kind"] = "viscous"
    energy = simulate(scene_of(system), duration=20.0).energy
    assert energy[0] > 1e-3
    assert energy[-1] <= 1e-15 * energy[0]


@given(sprung, starts, numbers(1.0, 3.0))
def test_series_equals_the_transition_matrix_where_both_apply(system, start, stretch):
    fixed = scene_of(system, start).replace(**{"springs.stretch": stretch})
    actuated = fixed.replace(
        **{"actuation.stretch": {"minimum": 1.0, "maximum": 3.0}, "initial.stretch": stretch}
    )
    expected = simulate(fixed).state
    state = simulate(actuated).state
    # Round-off of 60 steps, each a series whose terms grow up to exp(2).
    assert error(state, expected) <= 60 * 8 * 4e-16


@pytest.mark.parametrize("spring", [{}, {"actuation": {"force": {"limit": 5.0}}}])
def test_uncoupled_sphere_flies_freely(spring):
    scene = Scene(
        interface={"kind": "none"},
        initial={"sphere_offset": 0.25, "sphere_velocity": 0.5, "carriage_displacement": 0.01},
        control={"time_step": 0.0625, "steps": 1000},
        **spring,
    )
    trajectory = simulate(scene, action=2.0 if spring else None)
    assert (trajectory.state[:, 3] == 0.5).all()
    # All values but the start are short binary fractions: one rounding per step.
    flown = 0.26 + 0.5 * trajectory.time
    assert np.abs(trajectory.state[:, 1] - flown).max() <= 1000 * np.spacing(flown[-1])


def test_raising_the_stiffness_at_an_offset_injects_energy():
    # k2 = 2 k0 (1 + 2/stretch^3): from 3 to 1 it rises from 2.148 k0 to 6 k0 at constant offset.
    scene = Scene(
        springs={"kind": "small_on_large", "stiffness": 35.0, "stretch": 3.0},
        initial={"sphere_offset": 0.01},
        actuation={"stretch": {}},
    )
    released = simulate(scene, action=1.0, duration=1e-9).energy[0]
    held = simulate(scene, action=3.0, duration=1e-9).energy[0]
    injected = 0.5 * 2 * 35.0 * (2.0 - 2.0 / 27.0) * 0.01**2
    assert released - held == pytest.approx(injected, rel=1e-12)
