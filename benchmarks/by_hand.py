"""Bare kernels of twenty lines that a user would write instead of mm_gym, one for each plant.

They advance the state alone, and neither score nor observe: one array per component, blocks of
lanes within the substep, and every liberty for the compiler. Excitation that is drawn is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

from mm_gym import compile_scene
from mm_gym.lanes import layout

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from mm_gym import Scene

    Values = NDArray[np.float64]
    Arrays = tuple[Values, ...]
    Block = Callable[[Arrays, int], None]

LANES_OF_A_BLOCK = 1024
FAST: dict[str, Any] = {"fastmath": True, "error_model": "numpy"}
"""Options of the compiler; a division that may raise an exception would not be vectorised."""


@dataclass(frozen=True)
class Physics:
    """The constants of a scene, and what its equations consist of.

    Attributes
    ----------
    by_m1, by_m2, k1, k3, c, d
        1 / m1, 1 / m2 [1/kg], k1, k1 beta, damping of the interface and of the carriage, in SI.
    k0, l0
        Stiffness of the springs [N/m], 0 if there are none, and their rest length [m], 0 if small
        on large.
    friction
        Reference velocity [m/s], force where slip begins [N], slip damping; 0 without friction.
    interval
        Sample interval [s].
    is_harmonic, is_sampled, is_shaken, has_impulses
        Whether there is a harmonic force, a sampled excitation, whether that is the ground's, and
        whether there are impulses.
    is_drawn
        Whether each lane has a carriage mass of its own.
    """

    by_m1: float
    by_m2: float
    k1: float
    k3: float
    c: float
    d: float
    k0: float
    l0: float
    friction: tuple[float, float, float]
    interval: float
    is_harmonic: bool
    is_sampled: bool
    is_shaken: bool
    has_impulses: bool
    is_drawn: bool

    @classmethod
    def of(cls, scene: Scene) -> Physics:
        """Return those of a scene of which at most the carriage's mass is drawn."""
        support = compile_scene(scene).support
        lane = support.low
        kinds = {part.kind: part for part in scene.excitation}
        sampled = [part for kind, part in kinds.items() if kind not in ("harmonic", "impulse")]
        kinetic = float(lane[layout.MU2] * lane[layout.FN])
        return cls(
            1.0 / lane[layout.M1],
            1.0 / lane[layout.M2],
            float(lane[layout.K1] * lane[layout.ALPHA]),
            float(lane[layout.K1] * lane[layout.BETA]),
            float(
                lane[layout.MU1] * lane[layout.FN] / lane[layout.VR]
                if support.slips
                else lane[layout.C]
            ),
            float(lane[layout.D]),
            float(lane[layout.K0]),
            float(lane[layout.L0]),
            (float(lane[layout.VR]), kinetic, float(lane[layout.CHI])),
            support.sample_interval,
            "harmonic" in kinds,
            bool(sampled),
            any(getattr(part, "target", "ground") == "ground" for part in sampled),
            "impulse" in kinds,
            bool(support.low[layout.M1] < support.high[layout.M1]),
        )


def _field(physics: Physics) -> Callable[..., Any]:
    """Return (positions, velocities, force, ground, 1 / m1 and k2) -> both accelerations."""
    by_m2, k1, k3, c, d = (
        physics.by_m2,
        physics.k1,
        physics.k3,
        physics.c,
        physics.d,
    )
    vr, kinetic, chi = physics.friction
    by_l0 = 1.0 / physics.l0 if physics.l0 else 0.0
    k0, l0, is_cubic, slips = physics.k0, physics.l0, physics.k3 != 0.0, vr > 0.0

    @numba.njit(**FAST, inline="always")
    def field(
        x: tuple[float, float],
        v: tuple[float, float],
        force: float,
        ground: float,
        own: tuple[float, float],
    ) -> tuple[float, float]:
        (x1, x2), (v1, v2), (by_m1, k2) = x, v, own
        w = v2 - v1
        inner = c * w
        if slips:
            inner = inner if abs(w) <= vr else np.copysign(kinetic + chi * (abs(w) - vr), w)
        if l0 > 0.0:  # k2 is the stretch
            offset = x2 - x1
            sides = k2 * k2 - by_l0 * by_l0 * offset * offset
            inner += 2.0 * k0 * offset * (1.0 + 2.0 * k2 / (sides * sides))
        elif k0 > 0.0:
            inner += k2 * (x2 - x1)
        spring = (k1 + k3 * x1 * x1) * x1 if is_cubic else k1 * x1
        return (inner - d * v1 - spring + force) * by_m1 - ground, -inner * by_m2 - ground

    return field


def _excitation(physics: Physics) -> Callable[..., Any]:
    """Return (held, part, start and rise of what is sampled, sine) -> force and ground."""
    harmonic, sampled, shaken = physics.is_harmonic, physics.is_sampled, physics.is_shaken

    @numba.njit(**FAST, inline="always")
    def excitation(
        held: float, part: float, start: float, rise: float, sine: float
    ) -> tuple[float, float]:
        force, ground = held, 0.0
        if harmonic:
            force += sine
        if sampled and shaken:
            ground = start + part * rise
        elif sampled:
            force += start + part * rise
        return force, ground

    return excitation


def rk4(scene: Scene) -> Block:
    """Return the classical Runge-Kutta method; see `in_blocks` for its arrays."""
    physics = Physics.of(scene)
    field, excitation = _field(physics), _excitation(physics)
    interval, impulses, harmonic = physics.interval, physics.has_impulses, physics.is_harmonic
    is_drawn, by_m1_of_all = physics.is_drawn, float(physics.by_m1)

    @numba.njit(**FAST)
    def block(arrays: Arrays, count: int) -> None:
        x1s, x2s, v1s, v2s, us, k2s, starts, rises, cs, ss, rcs, rss, whens, jumps, by_m1s = arrays
        h = interval / count
        half, sixth = 0.5 * h, h / 6.0
        for k in range(count):
            here, middle, there = k / count, (k + 0.5) / count, (k + 1.0) / count
            for i in range(x1s.size):
                x1, x2, v1, v2, u, k2 = x1s[i], x2s[i], v1s[i], v2s[i], us[i], k2s[i]
                start, rise, s0 = starts[i], rises[i], ss[i]
                own = by_m1s[i] if is_drawn else by_m1_of_all, k2
                s1, s2 = s0, s0
                if harmonic:  # half a substep on, by its rotation
                    c0, rc, rs = cs[i], rcs[i], rss[i]
                    c1, s1 = c0 * rc - s0 * rs, s0 * rc + c0 * rs
                    c2, s2 = c1 * rc - s1 * rs, s1 * rc + c1 * rs
                    cs[i], ss[i] = c2, s2
                if impulses:
                    v1 += jumps[i] if whens[i] == k else 0.0
                f, g = excitation(u, here, start, rise, s0)
                a1, a2 = field((x1, x2), (v1, v2), f, g, own)
                p1, p2 = v1 + half * a1, v2 + half * a2
                f, g = excitation(u, middle, start, rise, s1)
                b1, b2 = field((x1 + half * v1, x2 + half * v2), (p1, p2), f, g, own)
                q1, q2 = v1 + half * b1, v2 + half * b2
                c1, c2 = field((x1 + half * p1, x2 + half * p2), (q1, q2), f, g, own)
                r1, r2 = v1 + h * c1, v2 + h * c2
                f, g = excitation(u, there, start, rise, s2)
                d1, d2 = field((x1 + h * q1, x2 + h * q2), (r1, r2), f, g, own)
                x1s[i] = x1 + sixth * (v1 + 2.0 * (p1 + q1) + r1)
                x2s[i] = x2 + sixth * (v2 + 2.0 * (p2 + q2) + r2)
                v1s[i] = v1 + sixth * (a1 + 2.0 * (b1 + c1) + d1)
                v2s[i] = v2 + sixth * (a2 + 2.0 * (b2 + c2) + d2)

    return in_blocks(block, physics)


def semi_implicit_euler(scene: Scene) -> Block:
    """Return the semi-implicit Euler method; see `in_blocks` for its arrays."""
    physics = Physics.of(scene)
    field, excitation = _field(physics), _excitation(physics)
    interval, impulses, harmonic = physics.interval, physics.has_impulses, physics.is_harmonic
    is_drawn, by_m1_of_all = physics.is_drawn, float(physics.by_m1)

    @numba.njit(**FAST)
    def block(arrays: Arrays, count: int) -> None:
        x1s, x2s, v1s, v2s, us, k2s, starts, rises, cs, ss, rcs, rss, whens, jumps, by_m1s = arrays
        h = interval / count
        for k in range(count):
            for i in range(x1s.size):
                x1, x2, v1, v2 = x1s[i], x2s[i], v1s[i], v2s[i]
                sine, m = ss[i], by_m1s[i] if is_drawn else by_m1_of_all
                if harmonic:
                    cosine = cs[i]
                    cs[i] = cosine * rcs[i] - sine * rss[i]
                    ss[i] = sine * rcs[i] + cosine * rss[i]
                if impulses:
                    v1 += jumps[i] if whens[i] == k else 0.0
                f, g = excitation(us[i], k / count, starts[i], rises[i], sine)
                a1, a2 = field((x1, x2), (v1, v2), f, g, (m, k2s[i]))
                v1, v2 = v1 + h * a1, v2 + h * a2
                x1s[i], x2s[i], v1s[i], v2s[i] = x1 + h * v1, x2 + h * v2, v1, v2

    return in_blocks(block, physics)


def unrolled_taylor(scene: Scene, order: int) -> Block:
    """Return the recurrences of a Taylor series, unrolled: a function written by a loop.

    It is for a cubic spring under a held force.
    """
    physics = Physics.of(scene)
    lines = ["def block(arrays, count):", " x1s, x2s, v1s, v2s, us = arrays[:5]"]
    lines += [" h = interval / count"]
    lines += [" for _ in range(count):", "  for i in range(x1s.size):"]
    lines += ["   x0, y0, v0, w0 = x1s[i], x2s[i], v1s[i], v2s[i]"]
    for n in range(order):
        square = " + ".join(f"x{j} * x{n - j}" for j in range(n + 1))
        cube = " + ".join(f"s{j} * x{n - j}" for j in range(n + 1))
        push = " + us[i]" if n == 0 else ""
        lines += [
            f"   s{n} = {square}",
            f"   slip = c * (w{n} - v{n})",
            f"   a = slip - d * v{n} - k1 * x{n} - k3 * ({cube}){push}",
            f"   v{n + 1} = h / {n + 1}.0 * by_m1 * a",
            f"   w{n + 1} = -h / {n + 1}.0 * by_m2 * slip",
            f"   x{n + 1}, y{n + 1} = h / {n + 1}.0 * v{n}, h / {n + 1}.0 * w{n}",
        ]
    for array, term in (("x1s", "x"), ("x2s", "y"), ("v1s", "v"), ("v2s", "w")):
        lines += [f"   {array}[i] = " + " + ".join(f"{term}{n}" for n in range(order, -1, -1))]
    names = ("by_m1", "by_m2", "k1", "k3", "c", "d", "interval")
    known: dict[str, object] = {name: getattr(physics, name) for name in names}
    exec("\n".join(lines), known)  # noqa: S102 - the text above
    return in_blocks(numba.njit(**FAST)(known["block"]), physics)


def in_blocks(block: Block, physics: Physics) -> Block:
    """Return a kernel that makes all substeps of a block of lanes before those of the next.

    Its arrays, one number each lane: x1, x2, v1, v2 (written), held force, stretch, the sampled
    disturbance at the interval's start and its rise, cosine and sine of the harmonic force (written
    [N]), cosine and sine of its turn, substep and size [m/s] of an impulse, 1 / m1.
    """
    k0, is_small, size = physics.k0, physics.l0 == 0.0, LANES_OF_A_BLOCK

    @numba.njit(**FAST)
    def run(arrays: Arrays, count: int) -> None:
        a, b, c, d, us, stretches, starts, rises, cs, ss, rcs, rss, whens, jumps, by_m1s = arrays
        room = np.empty(size)
        for k in range(0, a.size, size):
            e = k + size
            k2s = stretches[k:e]
            if k0 > 0.0 and is_small:
                k2s = room[: k2s.size]
                for i in range(k2s.size):
                    k2s[i] = 2.0 * k0 * (1.0 + 2.0 / stretches[k + i] ** 3)
            motion = a[k:e], b[k:e], c[k:e], d[k:e], us[k:e], k2s
            drive = starts[k:e], rises[k:e], cs[k:e], ss[k:e], rcs[k:e], rss[k:e]
            block((*motion, *drive, whens[k:e], jumps[k:e], by_m1s[k:e]), count)

    return run
