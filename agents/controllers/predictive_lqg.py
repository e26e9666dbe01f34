"""Linear predictive control on the LQG's estimate: of plant, actuator and excitation."""

from contextlib import suppress

import numpy as np

from agents.control.controller import Acted, Info, Memory, Observation, joined, part
from agents.control.kalman_filter import told_by
from agents.control.scene import STATES, force_weight
from agents.controllers.linear_mpc import HORIZON, Limits
from agents.controllers.lqg import ReachedLQG, best_detuned_lqg, weighed, without_force
from agents.controllers.lqr import Quadratic
from agents.controllers.quadratic_program import Program
from agents.controllers.registry import Entry, once
from agents.controllers.searched import cheapest_of
from mm_gym import DesignError, MovingMassVectorEnv, Scene


class PredictiveLQG(ReachedLQG):
    """Plan the force within its limits, from all that the LQG's filter tells.

    A horizon of the LQG's cost is a quadratic program, behind which stands the LQG's cost to go. So
    it is the LQG as long as no limit matters, and else looks ahead to it. It knows the lag of the
    force, the delay of the sensors and what the excitation's filters tell of the disturbance to
    come. Motions that end an episode are limits as of `LinearMPC`. Rawlings, Mayne and Diehl,
    *Model Predictive Control*, 2nd ed. (2017), chapters 1 and 5. Raise `DesignError` as for
    `lqg.design_lqg`; `gymnasium.error.DependencyNotInstalled` without OSQP (extra: mpc).
    """

    def __init__(self, scene: Scene, effort: float, unmodelled: float) -> None:
        force_weight(scene)  # not of a force that is commanded by its rate
        super().__init__(scene, effort, unmodelled)
        self.name = f"predictive LQG, effort weight times {effort:.2g}, unmodelled {unmodelled:.2g}"
        limits, system, law = Limits.of(scene), self.design.system, self.design.regulator
        names = [signal.name for signal in system.states]
        rows = limits.rows(scene)
        limited, commanded = np.zeros((len(rows), len(names))), rows[:, 4]
        limited[:, [names.index(name) for name in STATES]] = rows[:, :4]
        if "force" in names:
            limited[:, names.index("force")], commanded = commanded, 0.0 * commanded
        planned = told_by(system.A, (limited != 0.0).any(axis=0))
        planned[list(law.states)] = True
        self.planned = np.flatnonzero(planned)
        inside, both = np.ix_(law.states, law.states), np.ix_(self.planned, self.planned)
        (state, last), cross = np.zeros((2, *system.A.shape)), np.zeros((len(names), 1))
        state[inside], last[inside] = law.cost.state, law.riccati
        cross[list(law.states)] = law.cost.cross
        slope, drift = np.zeros(len(names)), system.drift[self.planned]
        slope[list(law.states)] = law.slope
        # What pushes all the time is a state of the plan, 1 at all times.
        one = self.one = int(drift.any())
        a, state = (np.pad(matrix, (0, one)) for matrix in (system.A[both], state[both]))
        last, cross = np.pad(last[both], (0, one)), np.pad(cross[self.planned], ((0, one), (0, 0)))
        if one:
            a[:, -1], last[:-1, -1] = [*drift, 1.0], slope[self.planned]
            last[-1] = last[:, -1]
        self.program = Program(
            scene,
            a,
            np.pad(system.B[self.planned], ((0, one), (0, 0))),
            Quadratic(state, cross, law.cost.force),
            last=last,
            rows=np.column_stack([np.pad(limited[:, self.planned], ((0, 0), (0, one))), commanded]),
            share=self.share,
            horizon=HORIZON,
            penalty=limits.penalty,
        )

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return {**super().begin(env), **joined(program=self.program.begin(env.num_envs))}

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        memory = self.corrected(memory, observation)
        estimate, applied = memory["estimate"][:, self.planned], memory["applied"][:, 0]
        planned = np.pad(estimate, ((0, 0), (0, self.one)), constant_values=1.0)
        force, own = self.program.first(part(memory, "program"), planned, applied)
        return np.clip(force, -1.0, 1.0), {**memory, **joined(program=own)}


def best_predictive_lqg(scene: Scene) -> PredictiveLQG:
    """Search the force's weight between the reward's and that of the best LQG.

    It needs to be cautious where limits come beyond the horizon, but less than an LQG, which knows
    no limit.
    """
    own, best = weighed(scene), once(best_detuned_lqg, scene)
    efforts = {best.effort**share for share in (0.0, 0.5, 1.0)}
    found: list[PredictiveLQG] = []
    for effort in efforts:
        with suppress(DesignError):  # the best LQG's own weight has a solution
            found.append(PredictiveLQG(own, effort, best.unmodelled))
    return cheapest_of(scene, found)


ENTRIES = (
    Entry(
        "predictive-lqg",
        ("force",),
        best_predictive_lqg,
        52,
        "further",
        "predictive LQG",
        without_force,
    ),
)
