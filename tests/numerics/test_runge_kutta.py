"""Does the general method keep its tolerance, event by event, whatever the other lanes do?"""

import itertools

import numpy as np
import pytest

from mm_gym import Scene, compile_scene
from mm_gym.compiler.jit import borrowing_kernel, inlined_kernel, plain
from mm_gym.lanes import layout
from mm_gym.lanes.memory import on_cache_line
from mm_gym.lanes.simd import LANES as WIDTH
from mm_gym.lanes.simd import element, near_root, rough_quotient, rough_root
from mm_gym.lanes.simd_memory import rows_of
from mm_gym.law.carriage_spring import carriage_force
from mm_gym.law.dry_friction import interface_force
from mm_gym.law.motion import coefficients, rates
from mm_gym.law.springs import spring_force, stiffness
from mm_gym.methods.runge_kutta import layout as slots
from mm_gym.methods.runge_kutta.kernel import LONGER, SAFETY, TINY, _between, _powers
from mm_gym.methods.runge_kutta.tableau_kernel import estimated, first_sum, summed, tableaus
from mm_gym.simulation.lanes import Lanes

LANES = 150
CARRIAGES = {"linear": 0.0, "cubic": 2e4}
INTERFACES = {
    "viscous": {"kind": "viscous", "damping": 1.0},
    "friction": {
        "kind": "dry_friction",
        "static_coefficient": 0.5,
        "kinetic_coefficient": 0.25,
        "reference_velocity": 0.1,
        "slip_damping": 0.1,
    },
}
SPRINGS = {
    "free": {"kind": "none"},
    "small": {"kind": "small_on_large", "stretch": 1.5},
    "finite": {"kind": "finite_stretch", "stretch": 1.5, "rest_length": 0.1},
}
EXCITATIONS = {
    "held": [],
    "shaken": [
        {"kind": "harmonic", "amplitude": 1.0, "frequency": 50.0},
        {"kind": "noise", "target": "ground", "rms": 2.0, "high_frequency": 60.0},
    ],
}
COMBINATIONS = [
    parts
    for parts in itertools.product(CARRIAGES, INTERFACES, SPRINGS)
    if parts[:2] != ("linear", "viscous") or parts[2] == "finite"
]


def _scene(parts, tolerance, method="runge_kutta", excitation="held"):
    carriage, interface, springs = parts
    return Scene(
        carriage={"cubic_coefficient": CARRIAGES[carriage]},
        interface=INTERFACES[interface],
        springs=SPRINGS[springs],
        excitation=EXCITATIONS[excitation],
        initial={"carriage_displacement": [-0.01, 0.01], "sphere_offset": [-0.01, 0.01]},
        actuation={"force": {"limit": 4.0}},
        randomization={"carriage.mass": [0.08, 0.12]},
        control={"time_step": 0.005, "steps": 1000},
        solver={"method": method, "tolerance": tolerance},
    )


def _lanes(scene, count=LANES):
    lanes = Lanes(compile_scene(scene), count)
    lanes.seed(1)
    lanes.restart()
    return lanes


def _move(lanes, method=None):
    """Advance all lanes by a sample interval without a new command; return the status."""
    plant = method or lanes.plant
    return plant.entries.propagate(plant.model, lanes._values, 0, lanes.count)


def _steps(parts, tolerance, *, excitation="held", steps=6):
    """Yield states before and after steps, and those of a series at 1e-13 from the same starts."""
    lanes = _lanes(_scene(parts, tolerance, excitation=excitation))
    exact = compile_scene(_scene(parts, 1e-13, "taylor", excitation))
    rng = np.random.default_rng(2)
    for _ in range(steps):
        lanes.advance(rng.uniform(-1.0, 1.0, LANES))  # the excitation goes on
        values = lanes._values
        before = values[:, :LANES].copy()
        assert _move(lanes) == layout.OK
        after = values[:4, :LANES].copy()
        values[:, :LANES] = before
        assert _move(lanes, exact) == layout.OK
        yield before[:4], after, values[:4, :LANES].copy()


def _errors(steps):
    for before, after, want in steps:
        scale = np.maximum(abs(before), abs(want)).reshape(2, 2, -1).max(axis=1)
        yield (abs(after - want).reshape(2, 2, -1) / scale[:, None]).max()


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("parts", COMBINATIONS, ids="-".join)
def test_every_combination_keeps_its_tolerance(parts, tolerance):
    assert max(_errors(_steps(parts, tolerance))) < tolerance


@pytest.mark.parametrize("parts", [("cubic", "friction", "finite")], ids="-".join)
def test_excitation_within_a_step_is_followed(parts):
    assert max(_errors(_steps(parts, 1e-7, excitation="shaken"))) < 1e-7


def test_many_lanes_change_their_regime_in_a_step():
    # Else the test of the combinations would say nothing of events.
    changes = 0
    for before, _, want in _steps(("linear", "friction", "free"), 1e-6):
        slips = [np.abs(state[3] - state[2]) > 0.1 for state in (before, want)]
        changes += int((slips[0] != slips[1]).sum())
    assert changes > LANES


@pytest.mark.parametrize("excitation", EXCITATIONS)
@pytest.mark.parametrize("parts", COMBINATIONS, ids="-".join)
def test_lanes_side_by_side_equal_lanes_alone(parts, excitation):
    lanes = _lanes(_scene(parts, 1e-4, excitation=excitation), 41)
    plant, values = lanes.plant, lanes._values
    lanes.advance(np.linspace(-1.0, 1.0, 41))
    before = values.copy()
    _move(lanes)
    together = values[:4].copy()
    for groups in ([(i, i + 1) for i in range(41)], [(0, 5), (5, 23), (23, 41)]):
        values[:] = before
        for first, last in groups:
            plant.entries.propagate(plant.model, values, first, last)
        assert (values[:4] == together).all()


def test_law_of_motion_is_that_of_the_forces():
    rng = np.random.default_rng(3)
    m1, m2, k1, alpha, beta, c, d, k0, l0, stretch = rng.uniform(0.5, 2.0, 10)
    x1, offset, v1, slip, push, shake = rng.uniform(-0.3, 0.3, 6)
    force = plain(carriage_force)(k1, alpha, beta, x1)
    coupling = plain(interface_force)(c, 0.0, 0.0, 0.0, slip)
    for length in (0.0, l0):
        k2 = plain(stiffness)(k0, stretch)
        p = plain(coefficients)(m1, m2, k1, alpha, beta, d, k2, k0, 1.0 / l0, stretch)
        spring = plain(spring_force)(k0, length, stretch, offset)
        got = plain(rates)(p, length > 0.0, x1, offset, v1, coupling, push, shake)
        want = (
            (coupling + spring - force - d * v1 + push) / m1 - shake,
            (-coupling - spring) / m2 - shake,
        )
        assert got == pytest.approx(want, rel=1e-14)  # some ten roundings


@pytest.mark.parametrize("pair", tableaus(), ids=lambda pair: f"{pair.power}")
def test_estimates_fall_with_their_power_of_the_step(pair):
    # The next power adds a tenth at most.
    ratio = pair.estimates(0.2)[0] / pair.estimates(0.1)[0]
    assert np.log2(ratio) == pytest.approx(pair.power, abs=0.15)


@pytest.mark.parametrize(("pair", "degree"), [*zip(tableaus(), (3, 3, 5), strict=True)])
def test_velocities_between_the_ends_of_a_step_are_polynomials_and_so_is_what_they_add_up_to(
    pair, degree
):
    # Where this fails, steps that change their regime are repeated, and nothing else tells.
    rng, h = np.random.default_rng(5), 0.4
    model, b = np.zeros(slots.TIMES), np.zeros(slots.SIZE)
    model[slots.STAGES], model[slots.IS_COMBINED] = pair.stages, pair.is_combined
    b[slots.LENGTH] = h
    for k in range(2):
        velocity = np.polynomial.Polynomial(rng.uniform(-1.0, 1.0, degree + 1))
        b[slots.STATE + k], b[slots.END + k] = 0.3, 0.3 + h * velocity.integ()(1.0)
        b[slots.STATE + 2 + k], b[slots.END + 2 + k] = velocity(0.0), velocity(1.0)
        kicks = slots.KICKS + k + 2 * np.arange(len(pair.times))
        b[kicks] = velocity.deriv()(pair.times)
        powers, _ = plain(_powers)(model, b, k, 1.0 / h)
        for t in (0.3, 1.0):
            got = plain(_between)(model, powers, t)
            # Ten roundings; those of the way count sixty times.
            exact = 1e-14 if degree == 3 else 60e-14
            assert got == pytest.approx((velocity(t), velocity.integ()(t)), abs=exact)


@pytest.mark.parametrize("pair", tableaus()[1:], ids=lambda pair: f"{pair.power}")
def test_velocities_within_a_step_of_an_oscillation_are_as_exact_as_is_said(pair):
    model, b = np.zeros(slots.TIMES), np.zeros(slots.SIZE)
    model[slots.STAGES], model[slots.IS_COMBINED] = pair.stages, pair.is_combined
    b[slots.LENGTH] = 1.0
    for phase in (0.2, 0.5, 1.0, 1.5):
        model[slots.BEND] = 0.125 * phase**2
        turn = 1j * phase
        values = np.linalg.solve(np.eye(len(pair.times)) - turn * pair.weights, 1 + 0 * pair.times)
        worst, said = np.zeros(3), 0.0
        for start in (1.0, 1j):  # the real part is that of a cosine, then of a sine
            b[slots.STATE], b[slots.END] = (start / turn).real, (start * values[-1] / turn).real
            b[slots.STATE + 2], b[slots.END + 2] = start.real, (start * values[-1]).real
            b[slots.KICKS + 2 * np.arange(len(pair.times))] = (turn * start * values).real
            powers, error = plain(_powers)(model, b, 0, 1.0)
            said = max(said, error)
            for k, t in enumerate((0.25, 0.5, 0.75)):
                exact = (start * np.exp(turn * t)).real
                worst[k] = max(worst[k], abs(plain(_between)(model, powers, t)[0] - exact))
        assert worst.max() < said
        # An estimate that is much too large would repeat steps for nothing.
        assert said < 20.0 * worst.max()


@borrowing_kernel
def _sum(numbers, number, found):
    rows = rows_of(numbers)
    found[0], found[1], found[2], found[3] = _first(summed(rows, number, rows[0], rows[1]))


@borrowing_kernel
def _estimate(numbers, number, found):
    rows = rows_of(numbers)
    found[0], found[1], found[2], found[3] = _first(estimated(rows, number, rows[0]))


@inlined_kernel
def _first(vectors):
    first, second, third, fourth = vectors
    return element(first, 2), element(second, 2), element(third, 2), element(fourth, 2)


@pytest.mark.parametrize("pair", tableaus(), ids=lambda pair: f"{pair.power}")
def test_sums_are_those_of_the_pair(pair):
    numbers, found = on_cache_line(slots.SIZE * WIDTH), np.zeros(4)
    rows = numbers.reshape(-1, WIDTH)
    rows[:] = np.random.default_rng(4).uniform(-1.0, 1.0, rows.shape)
    kicks = rows[slots.KICKS : slots.END, 2].reshape(-1, 2)[: len(pair.times)]
    start = rows[:2, 2]
    for i in range(1, len(pair.times)):
        weights = pair.weights[i]
        way = pair.times[i] * start + weights @ pair.weights @ kicks
        _sum(numbers, first_sum(pair) + i - 1, found)
        assert found == pytest.approx([*(start + weights @ kicks), *way], rel=1e-12)
    for k, weights in enumerate(pair.errors):
        _estimate(numbers, first_sum(pair) + pair.stages + k, found)
        way = weights @ pair.weights @ kicks if k == 0 or pair.is_combined else (0.0, 0.0)
        assert found == pytest.approx([*(weights @ kicks), *way], rel=1e-12, abs=1e-14)


@borrowing_kernel
def _write_near_root(numbers, k):
    rows = rows_of(numbers)
    rows[0] = near_root(rows[0], rows[1], k)


@borrowing_kernel
def _write_rough(numbers):
    rows = rows_of(numbers)
    rows[0], rows[1] = rough_quotient(rows[0], rows[1]), rough_root(rows[1])


@pytest.mark.parametrize("k", [1, 2, 3])
def test_roots_of_quotients_are_near(k):
    numbers = on_cache_line(2 * WIDTH)
    for start in np.geomspace(1e-9, 1e9, 50 * WIDTH).reshape(-1, WIDTH):
        for below in (np.ones(WIDTH), start[::-1], 1e3 / start):
            numbers[:WIDTH], numbers[WIDTH:] = start, below
            _write_near_root(numbers, k)
            excess = numbers[:WIDTH] * (below / start) ** (0.5**k)
            # 1 + m is at most 2^0.0861 times 2^m: of both numbers, and of the root.
            assert excess.min() > 2.0 ** (-0.0861 * 0.5**k)
            assert excess.max() < 2.0 ** (0.0861 * (1.0 + 0.5**k))


def test_the_root_of_nothing_over_something_is_small_and_that_of_something_over_nothing_large():
    numbers = on_cache_line(2 * WIDTH)
    for above, below, low, high in ((0.0, 1.0, 0.0, 1e-30), (TINY, 0.0, LONGER / SAFETY, np.inf)):
        numbers[:WIDTH], numbers[WIDTH:] = above, below
        _write_near_root(numbers, 3)
        assert (numbers[:WIDTH] >= low).all()
        assert (numbers[:WIDTH] <= high).all()


def test_rough_quotients_and_roots_are_exact_to_single_precision():
    numbers = on_cache_line(2 * WIDTH)
    above, below = np.random.default_rng(6).uniform(0.1, 10.0, (2, WIDTH))
    numbers[:WIDTH], numbers[WIDTH:] = above, below
    _write_rough(numbers)
    single = float(np.finfo(np.float32).eps)  # half of it for each of the three roundings
    assert numbers[:WIDTH] == pytest.approx(above / below, rel=1.5 * single)
    assert numbers[WIDTH:] == pytest.approx(np.sqrt(below), rel=single)


def test_intervals_longer_than_the_scenes_are_left_to_the_series():
    plant = compile_scene(_scene(("cubic", "friction", "free"), 1e-6))
    longer = plant.at_interval(2.0)
    assert plant.model[slots.STEPS] > 0.0
    assert longer.model[slots.STEPS] == 0.0


@pytest.mark.parametrize(
    ("parts", "tolerance", "name"),
    [
        (("linear", "viscous", "finite"), 1e-6, "runge_kutta"),
        (("cubic", "viscous", "finite"), 1e-9, "runge_kutta"),
        (("cubic", "viscous", "free"), 1e-9, "taylor"),
        (("cubic", "viscous", "finite"), 1e-10, "taylor"),
        (("cubic", "friction", "finite"), 1e-9, "runge_kutta"),
    ],
)
def test_auto_takes_it_where_parameters_are_drawn(parts, tolerance, name):
    plant = compile_scene(_scene(parts, tolerance, "auto"))
    assert plant.method.name == name
    assert name == "runge_kutta" or "Runge-Kutta method: solver.tolerance is" in plant.explain()
