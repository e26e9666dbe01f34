"""Where the sphere comes to rest, and from which reference velocity on it never slips."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from mm_gym.analysis.asymptotes_kernel import final_offsets, sticks_throughout
from mm_gym.arrays import Array
from mm_gym.compiler.jit import plain
from mm_gym.errors import SceneError, SimulationError, finite_numbers, refuse
from mm_gym.extras import optional
from mm_gym.lanes import layout
from mm_gym.law import dry_friction, springs
from mm_gym.law.carriage_spring import carriage_energy, carriage_force
from mm_gym.plant.compile import compile_scene
from mm_gym.plant.support_of import lane_of, support_of
from mm_gym.scene.mechanics import GRAVITY
from mm_gym.scene.scene import Scene, require_scene
from mm_gym.simulation.energy import piecewise_linear_kernel as piecewise
from mm_gym.simulation.energy.work import mechanical_energy
from mm_gym.simulation.simulate import simulate


class Spring(NamedTuple):
    """The carriage's spring, of force k1 (alpha + beta x1^2) x1: k1 [N/m], alpha [-], beta [1/m^2].

    Energies [J] are those of (9) of docs/model.md: 0 in the middle.
    """

    k1: float
    alpha: float
    beta: float

    @classmethod
    def of(cls, p: Array) -> Spring:
        """Return the spring of a lane (rows,)."""
        return cls(float(p[layout.K1]), float(p[layout.ALPHA]), float(p[layout.BETA]))

    @property
    def place(self) -> float:
        """|x1| [m] where the force vanishes off the middle: wells, or a barrier; NaN if not."""
        if self.alpha * self.beta >= 0.0:
            return math.nan
        return math.sqrt(-self.alpha / self.beta)

    @property
    def is_bistable(self) -> bool:
        """Whether there are two wells, at `place`, about an unstable middle."""
        return self.alpha < 0.0 < self.beta

    @property
    def has_well(self) -> bool:
        """Whether any place holds the carriage: the middle, or one of two wells."""
        return self.alpha > 0.0 or self.beta > 0.0

    @property
    def least_energy(self) -> float:
        """Energy in the wells [J], 0 or less."""
        return -0.25 * self.k1 * self.alpha**2 / self.beta if self.is_bistable else 0.0

    def holds(self, x1: float, energy: float) -> bool:
        """Tell whether a carriage at x1 [m] stays in a well for ever with an energy [J] at most."""
        if self.beta >= 0.0:
            return self.beta > 0.0 or self.alpha >= 0.0
        barrier = -0.25 * self.k1 * self.alpha**2 / self.beta
        return self.alpha > 0.0 and abs(x1) < self.place and energy < barrier

    def largest_force(self, energy: float) -> float:
        """Return a bound of the force [N] on a carriage in a well with an energy [J] at most.

        Where the spring stiffens or is linear, the larger of what the linear and the cubic part
        alone allow; else the force at the ends of the displacements with so much energy, and in
        between at its extremum.
        """
        k1, alpha, beta = self
        if alpha >= 0.0 and beta >= 0.0:
            square = 2.0 * energy / (k1 * alpha) if alpha > 0.0 else math.inf
            if beta > 0.0:
                square = min(square, math.sqrt(4.0 * energy / (k1 * beta)))
            return k1 * (alpha + beta * square) * math.sqrt(square)
        # k1 (alpha u / 2 + beta u^2 / 4) = energy, u = x1^2; the root does not cancel.
        root = math.sqrt(max(0.0, alpha * alpha + 4.0 * beta * energy / k1))
        inner, outer = sorted(((-alpha - root) / beta, (-alpha + root) / beta))
        least, most = (max(inner, 0.0), outer) if self.is_bistable else (0.0, inner)
        extremum = -alpha / (3.0 * beta)
        squares = [least, most] + ([extremum] if least < extremum < most else [])
        return max(abs(self.force(math.sqrt(square))) for square in squares)

    def force(self, x1: float) -> float:
        """Return the force [N] that resists a displacement [m]."""
        return float(plain(carriage_force)(*self, x1))

    def energy(self, x1: float) -> float:
        """Return the energy [J] at a displacement [m]."""
        return float(plain(carriage_energy)(*self, x1))


CHUNK = 64  # points that one thread computes at a time

TOO_LONG = (
    "the motion is too slow to come to rest: it takes more than 1,000,000 intervals of a fraction "
    "of the carriage's period, or its rates differ by a factor of more than 1e16"
)
"""Message for a motion whose final stick is out of reach."""

FIRST_STEPS, MOST_STEPS = 256, 1 << 20
"""Control steps that a nonlinear motion is simulated for: at first, and at most."""


def row_of(scene: Scene, what: str) -> Array:
    """Return the lane (rows,) that the scene starts as; raise `SceneError` for a range."""
    support = support_of(scene)
    drawn = [
        name
        for name, row in support.names.items()
        if support.start_low[row] != support.start_high[row]
    ]
    if drawn:
        msg = f"{drawn[0]}: got a range; {what} needs one value for every field"
        raise SceneError(msg)
    if support.is_general:
        msg = (
            f"{support.general_because}; allowed: interface.kind 'none', 'viscous', "
            f"'dry_friction' and springs without cubic_coefficient, for which {what} is known"
        )
        raise SceneError(msg)
    return lane_of(support)


def asymptotic_offset(scene: Scene) -> float:
    """Return the relative displacement x2 - x1 [m] at which the free motion comes to rest.

    Without springs, m2 v2 + c (x2 - x1) is constant (eq. 7 of docs/model.md), so x2 - x1 tends to
    its initial value plus m2 v2(0) / c (eq. 8). With c = 0 a sphere at rest stays where it is, and
    the carriage returns to equilibrium: x1 = 0, or one of its two wells, which a simulation finds.
    Springs bring x2 - x1 to zero. Under dry friction the same holds after the last slip, with
    c = mu1 F_N / v_r. The motion is followed until its energy is too small for another slip.
    Actuators stay at rest.

    Raises
    ------
    SceneError
        If a field is a range, the scene has excitation, or the motion never settles.
    SimulationError
        If the last slip comes too late to be computed, or the carriage escapes.
    """
    lane = row_of(scene, "asymptotic_offset")[:, None]
    return float(_offsets(lambda _: scene, lane, lambda _: None)[0])


def bifurcation(
    scene: Scene, parameter: str, values: ArrayLike, *, progress: bool = False
) -> Array:
    """Return the final relative displacement (n,) [m] for values of one parameter, on all cores.

    Parameters
    ----------
    scene
        A scene as for `asymptotic_offset`; it gives all fields but the parameter.
    parameter
        Dotted name of a numeric field, such as "interface.reference_velocity" or
        "initial.sphere_offset".
    values
        (n,) values of the parameter, in the field's unit.
    progress
        Whether to show a progress bar, with tqdm (extra: agents).

    Raises
    ------
    SceneError
        If the parameter is not a number of this scene, a value is not allowed, or
        `asymptotic_offset` refuses the scene.
    SimulationError
        If the last slip of a motion comes too late to be computed.
    gymnasium.error.DependencyNotInstalled
        If a progress bar is asked for without tqdm.
    """
    require_scene(scene)
    points = np.atleast_1d(finite_numbers(parameter, values))
    if points.ndim != 1 or not points.size:
        refuse(parameter, f"shape {points.shape}", "(n,) numbers")
    # The allowed values of a field form an interval, so checking both ends checks all.
    low = scene.replace(**{parameter: float(points.min())})
    scene.replace(**{parameter: float(points.max())})
    lanes = np.repeat(row_of(low, "bifurcation")[:, None], points.size, axis=1)
    offset = lanes[layout.X2] - lanes[layout.X1]
    support = support_of(low)
    row = support.row_of(parameter)
    if row == layout.X2:
        offset = points
    else:
        lanes[row] = points
    if row == layout.DAMPING:  # of a semi-active damper; the row of the damped part follows
        lanes[support.damped_row] = points
    lanes[layout.X2] = lanes[layout.X1] + offset
    if parameter == "sphere.mass" and getattr(scene.interface, "normal_force", 0.0) is None:
        lanes[layout.FN] = points * GRAVITY
    dry_friction.write_regimes(lanes, 0, points.size)

    def scene_of(index: int) -> Scene:
        return scene.replace(**{parameter: float(points[index])})

    if not progress:
        return _offsets(scene_of, lanes, lambda _: None)
    tqdm = optional("tqdm", "a progress bar needs tqdm; install the extra `agents`").tqdm
    with tqdm(total=points.size, desc=parameter, unit="points") as bar:
        return _offsets(scene_of, lanes, bar.update)


def _offsets(
    scene_of: Callable[[int], Scene], lanes: Array, report: Callable[[int], object]
) -> Array:
    """Return the asymptotic offsets (n,) [m] of lanes (rows, n) with the same kinds of parts."""
    first = scene_of(0)
    if first.excitation:
        msg = "excitation: allowed: none; a driven sphere does not come to rest"
        raise SceneError(msg)
    if first.interface.kind != "dry_friction":
        offsets = np.array([_from_first_integral(p, i, scene_of) for i, p in enumerate(lanes.T)])
        report(lanes.shape[1])
        return offsets
    offsets = np.empty(lanes.shape[1])
    for lane in lanes[:, (lanes[layout.ALPHA] < 0.0) | (lanes[layout.BETA] < 0.0)].T:
        _refuse_without_well(lane)
    nonlinear = np.any(lanes[layout.BETA] != 0.0) or np.any(lanes[layout.L0] > 0.0)
    ends = np.minimum(np.arange(0, offsets.size, CHUNK) + CHUNK, offsets.size)

    def work(last: int) -> int:
        begin = (last - 1) // CHUNK * CHUNK
        if not nonlinear:
            return cast("int", final_offsets(lanes, begin, last, offsets))
        for i in range(begin, last):
            offsets[i] = _follow(scene_of(i))
        return layout.OK

    with ThreadPoolExecutor(os.cpu_count()) as pool:  # the kernels release the interpreter's lock
        for size, status in zip(np.diff(ends, prepend=0), pool.map(work, ends), strict=True):
            report(int(size))
            if status > layout.ENDED:
                raise SimulationError(TOO_LONG)
    return offsets


def _refuse_without_well(p: Array) -> None:
    if not Spring.of(p).has_well:
        got = f"{p[layout.ALPHA]} with cubic_coefficient = {p[layout.BETA]}"
        where = "where the carriage has no stable equilibrium"
        refuse("carriage.linear_coefficient", f"{got}, {where}", "one of them greater than 0")


def _from_first_integral(p: Array, index: int, scene_of: Callable[[int], Scene]) -> float:
    """Return the asymptotic offset [m] of a lane (rows,) without dry friction."""
    x1, x2, _, v2 = p[:4]
    c, d, spring = p[layout.C], p[layout.D], Spring.of(p)
    still = x1 == 0.0 and p[layout.V1] == 0.0
    resting = still and x2 == 0.0 and v2 == 0.0
    if min(spring.alpha, spring.beta) < 0.0 and not resting and not (still and c == 0.0):
        _refuse_without_well(p)
        if spring.beta < 0.0 < c + d and not _is_held(p, p[:4]):
            _first_state(scene_of(index), _is_held)  # or it escapes
    if p[layout.K0] > 0.0:
        if c + d > 0.0 or (still and x2 == 0.0 and v2 == 0.0):
            return 0.0
        msg = "carriage.damping: got 0, and the interface has no damping: the motion never settles"
        raise SceneError(msg)
    if c > 0.0:
        return float(x2 - x1 + p[layout.M2] * v2 / c)
    if v2 != 0.0:
        msg = f"initial.sphere_velocity: got {v2}; a free sphere that moves never stops"
        raise SceneError(msg)
    if still:
        return float(x2)
    if d > 0.0:
        return float(x2 - _rest(p, spring, scene_of(index) if spring.is_bistable else None))
    msg = "carriage.damping: got 0, and the sphere is free: the carriage never comes to rest"
    raise SceneError(msg)


def _rest(p: Array, spring: Spring, scene: Scene | None) -> float:
    """Return where a damped carriage under a free sphere comes to rest [m]."""
    if spring.alpha == spring.beta == 0.0:
        # d x1 + m1 v1 is constant
        return float(p[layout.X1] + p[layout.M1] * p[layout.V1] / p[layout.D])
    if scene is None:
        return 0.0

    def has_chosen(p: Array, state: Array) -> bool:
        x1, _, v1, _ = state
        return bool(0.5 * p[layout.M1] * v1**2 + spring.energy(x1) < 0.0)  # below the middle

    return math.copysign(spring.place, _first_state(scene, has_chosen)[1][0])


def _is_held(p: Array, state: Array) -> bool:
    """Tell whether the energy left is too little to leave the carriage's well."""
    return Spring.of(p).holds(float(state[0]), _energy(p, state))


def _energy(p: Array, state: Array) -> float:
    return float(mechanical_energy(p, state[None], np.array([p[layout.STRETCH]]))[0])


def _first_state(scene: Scene, holds: Callable[[Array, Array], bool]) -> tuple[Array, Array]:
    """Return the lane (rows,) and the first state (4,) of a motion of which a condition holds."""
    plant, steps = compile_scene(scene), FIRST_STEPS
    while steps <= MOST_STEPS:
        trajectory = simulate(plant, duration=steps * plant.time_step)
        for state in trajectory.state:
            if holds(trajectory.parameters, state):
                return trajectory.parameters, state
        steps *= 2
    msg = f"the motion does not settle in {MOST_STEPS} control steps; lengthen control.time_step"
    raise SimulationError(msg)


def _follow(scene: Scene) -> float:
    """Return the asymptotic offset [m] of a nonlinear motion with friction, by simulation."""
    p, state = _first_state(scene, _sticks_for_good)
    x1, x2, _, v2 = state
    return 0.0 if p[layout.K0] > 0.0 else float(x2 - x1 + p[layout.M2] * v2 / p[layout.C])


def _sticks_for_good(p: Array, state: Array) -> bool:
    """Tell whether the energy left is too little to slip; see `stays_slower`."""
    m1, m2, vr, spring = p[layout.M1], p[layout.M2], p[layout.VR], Spring.of(p)
    reduced, energy = m1 * m2 / (m1 + m2), _energy(p, state)
    if not spring.holds(float(state[0]), energy):
        return False
    if vr == 0.0:  # friction that provably never slips was compiled to a viscous interface
        return True
    twice = 2.0 * max(0.0, energy - spring.least_energy)
    if np.sqrt(twice) <= vr * np.sqrt(reduced):
        return True
    if p[layout.K0] > 0.0 or abs(state[3] - state[2]) > vr:
        return False
    drive = spring.largest_force(energy) / m1 + p[layout.D] / m1 * np.sqrt(twice / (m1 + m2))
    rate = p[layout.C] / reduced + p[layout.D] * m2 / (m1 * (m1 + m2))
    return bool(drive <= rate * vr)


LEAST = 2.0**-20
"""Smallest reference velocity tried, relative to the fastest slip that the energy at the start
allows: the sphere is then as good as locked, and whether it slips no longer depends on v_r."""

RESOLUTION = 2.0**-50
"""Relative width to which the critical velocity is bracketed: some units of round-off."""

MARGIN = 2.0**-46
"""Relative amount, 1.4e-14, by which the result is rounded up. A motion that just reaches v_r slips
or sticks by its last digits, so the velocity has to stay clear of them."""

WIDEST = 2.0**-20  # largest margin tried


def critical_reference_velocity(scene: Scene) -> float:
    """Return the least reference velocity [m/s] for which the scene's free motion never slips.

    Below v_r friction is viscous with the damping mu1 F_N / v_r. The slip velocity of the linear
    motion just reaches the critical v_r: max |w(t)| = v_r, eq. 21 of docs/model.md. The result does
    not depend on the kinetic coefficient, the slip damping, or the scene's own reference velocity.
    It is found by bisection, because it can be proved whether a motion slips at all, see
    `sticks_throughout`.

    Returns
    -------
    float
        The root, rounded up by a relative 1.4e-14, so that nothing slips at the returned value
        itself; 0 if the sphere sticks for every v_r.

    Raises
    ------
    SceneError
        If the interface is not dry friction, the motion in stick is not linear, or the scene has
        excitation.
    SimulationError
        If the motion is too slow to be followed, or too close to locked for its last digits to
        decide between stick and slip.
    """
    _check(scene)
    row = row_of(scene, "critical_reference_velocity")
    high = _fastest_by_energy(row)  # nothing slips faster
    low, least = 0.5 * high, LEAST * high
    while low > 0.0 and _sticks(row, low):
        high, low = low, 0.5 * low
        if low < least:
            return 0.0
    if low == 0.0:
        return 0.0
    while high - low > RESOLUTION * high:
        middle = 0.5 * (low + high)
        if _sticks(row, middle):
            high = middle
        else:
            low = middle
    return _rounded_up(row, high)


def _rounded_up(row: Array, velocity: float) -> float:
    """Return the velocity enlarged by the margin, or by more until nothing slips."""
    margin = MARGIN
    while margin <= WIDEST:
        if _sticks(row, enlarged := velocity * (1.0 + margin)):
            return enlarged
        margin *= 2.0
    msg = (
        f"critical_reference_velocity: near {velocity:g} m/s the sphere is nearly locked, and "
        "round-off decides whether it slips"
    )
    raise SimulationError(msg)


def _sticks(row: Array, velocity: float) -> bool:
    """Tell whether the motion never slips with a reference velocity."""
    lane = row.copy()
    lane[layout.VR] = velocity
    lane[layout.C] = plain(dry_friction.stick_slope)(lane[layout.MU1], lane[layout.FN], velocity)
    sticks, status = cast("tuple[bool, int]", sticks_throughout(lane))
    if status > layout.ENDED:
        msg = "critical_reference_velocity: the motion decays too slowly for its fastest rate"
        raise SimulationError(msg)
    return sticks


def _fastest_by_energy(row: Array) -> float:
    """Return the slip velocity [m/s] of a motion with all its energy in it, sqrt(2 E / m_r)."""
    m1, m2 = cast("float", piecewise.carriage_mass(row)), row[layout.M2]
    k2 = cast("float", springs.stiffness(row[layout.K0], row[layout.STRETCH]))
    z = piecewise.start(row, row[:4], 0.0, 0, 0.0, row[:0])
    root = cast("float", piecewise.energy_root(row, k2, z))
    return float(root * np.sqrt((m1 + m2) / m1 / m2))


def _check(scene: Scene) -> None:
    require_scene(scene)
    problem = ""
    if scene.interface.kind != "dry_friction":
        problem = f"interface.kind: got {scene.interface.kind!r}; allowed: 'dry_friction'"
    elif scene.carriage.linear_coefficient < 0.0:
        got = f"got {scene.carriage.linear_coefficient}"
        problem = f"carriage.linear_coefficient: {got}; allowed: at least 0; the motion grows"
    elif scene.carriage.cubic_coefficient:
        problem = "carriage.cubic_coefficient: allowed: 0; the motion in stick must be linear"
    elif scene.springs.kind == "finite_stretch":
        problem = "springs.kind: got 'finite_stretch'; the motion in stick must be linear"
    elif scene.excitation:
        problem = "excitation: allowed: none; the critical velocity is that of a free motion"
    if problem:
        raise SceneError(problem)
