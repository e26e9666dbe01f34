"""A policy over lanes, followed forwards through an episode and back to its parameters."""

import numpy as np
from scipy.linalg import eig

from agents.network.layers import UNIT, Correlation, SettlingObserver
from agents.policies import Policy
from agents.training.arrays import Arrays
from agents.training.start import Start
from mm_gym.arrays import Array, Single

Parameters = dict[str, Single]

REAL = np.float32  # of the passes; the physics is in double precision

NONE = np.empty((0, 0), REAL)

LONGEST = 0.995
"""Largest eigenvalue of a memory that began with no larger one: what is older than some 200 steps
is forgotten."""


TURNS = 0.2, 1.2  # least and largest angle of an oscillator in a control step [rad]
LOSSES = 0.025, 0.5  # least and largest part that it forgets in a control step

ROLES = {
    "layers.0.weight": "hidden",
    "layers.0.bias": "bias",
    "layers.2.weight": "output",
    "layers.2.bias": "last",
} | {name: name for name in ("keep", "enter", "back", "early", "pairs", "direct")}
"""By the end of an array's name: what it is to a policy with one hidden layer."""


def _roles(policy: Policy) -> dict[str, str]:
    """Return the names of a policy's arrays by their roles, of what is trained."""
    found: dict[str, str] = {}
    for name in policy.arrays:
        end = name.partition(".")[2]
        within = end.removeprefix("layers.").partition(".")[2]  # an observer is around all
        role = ROLES.get(end) or ROLES.get(within)
        if role is not None:
            found[role] = name
    return found


def parameters_of(policy: Policy) -> Parameters:
    """Return what is trained of a policy with one hidden layer, copied; pairs side by side."""
    found = {role: policy.arrays[name].astype(REAL) for role, name in _roles(policy).items()}
    if "pairs" in found:
        found["pairs"] = found["pairs"].reshape(-1, found["pairs"].shape[-1])
    return found


def policy_of(parameters: Arrays, policy: Policy) -> Policy:
    """Return a policy with other parameters, copied; the numbers of its units stay."""
    roles, arrays = _roles(policy), policy.arrays
    return policy.with_arrays(
        {
            name: parameters[role].astype(np.float32).reshape(arrays[name].shape)
            for role, name in roles.items()
        }
    )


def with_oscillators(start: Start, count: int, generator: np.random.Generator) -> Start:
    """Return the start with so many oscillators, which have no part in the action yet.

    An oscillator is two states that turn and decay, driven by the observation with random weights.
    """
    n, size = start.pairs.shape[2] - len(start.keep), 2 * count
    keep, enter = np.zeros((size, size)), np.zeros((size, n))
    for row in range(0, size, 2):
        loss, turn = np.exp(generator.uniform(*np.log(LOSSES))), generator.uniform(*TURNS)
        cosine, sine, pair = np.cos(turn), np.sin(turn), slice(row, row + 2)
        keep[pair, pair] = (1.0 - loss) * np.array([[cosine, -sine], [sine, cosine]])
        enter[pair] = loss * generator.standard_normal((2, n))
    return start.with_memory(keep, enter)


def longest(keep: Single) -> float:
    """Return the largest eigenvalue that a memory may come to have, which begins as given."""
    return max([LONGEST, *np.abs(np.linalg.eigvals(keep))])


def hold_stable(keep: Single, most: float) -> None:
    """Scale a memory's weights so that it forgets."""
    if keep.size:
        keep *= min(1.0, most / np.abs(np.linalg.eigvals(keep)).max())


def shorten(keep: Single, most: float) -> None:
    """Shorten what a memory remembers for too long, and leave alone what it forgets in time."""
    if not keep.size:
        return
    values, left, right = eig(keep.astype(np.float64), left=True, right=True)
    long = np.abs(values) > most
    values, left, right = values[long], left.conj().T[long], right[:, long]
    sizes = (1.0 - most / np.abs(values)) * values / np.einsum("ij,ji->i", left, right)
    keep -= ((right * sizes) @ left).real.astype(keep.dtype)


class Network:
    """The passes of an evolved policy through episodes side by side.

    What the way back needs is recorded on the way forwards.

    Parameters
    ----------
    policy
        Its sizes, and the numbers of its correlation units, which are not trained.
    steps, lanes
        Of the episodes.

    Attributes
    ----------
    parameters
        Those of the next pass, by name; replace them between passes.
    gradient
        The slopes of the cost over them, after the way back.
    """

    def __init__(self, policy: Policy, steps: int, lanes: int) -> None:
        self.parameters, self.gradient = parameters_of(policy), parameters_of(policy)
        correlation = policy.find(Correlation)
        numbers = np.empty((0, len(UNIT)), np.float32) if correlation is None else correlation.units
        self.kept, self.floor, self.offset, self.scale = numbers.T[:, :, None]
        units, settling = len(numbers), policy.find(SettlingObserver)
        self.settles = 0.0 if settling is None else settling.fade.item()
        self.memory, self.acting = self.parameters.get("back", np.empty((0, 0))).shape
        if not self.acting:
            self.memory = policy.remembers - 2 * units
        self.observed, hidden, actions = policy.sizes
        m, n = self.memory, self.observed
        self._early = {"keep": slice(m), "enter": slice(m, m + n), "back": slice(m + n, None)}
        self.shown = self.observed + self.memory
        sizes = self.shown + units, 2 * units, units, units, hidden, hidden
        records = (np.empty((steps, rows, lanes), REAL) for rows in sizes)
        self.inputs, self.pairs, self.products, self.squares, self.sums, self.hidden = records
        self.acted = np.empty((steps, actions, lanes), REAL)
        self.free = np.empty((steps, actions, lanes), np.bool_)
        # Slopes of the cost over what is remembered after a step.
        self.by_memory = np.empty((self.memory, lanes), REAL)
        self.by_products, self.by_squares = np.empty((2, units, lanes), REAL)
        self.by_acted = np.empty((self.acting, lanes), REAL)

    def act(self, step: int, observation: Single) -> Single:
        """Return the actions (k, lanes), not clipped, for observations (n, lanes)."""
        own, inputs, n = self.parameters, self.inputs[step], self.observed
        inputs[:n] = observation
        if self.memory:
            keep, enter, back = self._weights(step)
            memory = np.matmul(enter, inputs[:n], out=inputs[n : self.shown])
            if step > 0:
                memory += keep @ self.inputs[step - 1, n : self.shown]
                if self.acting:
                    memory += back @ self.acted[step - 1]
        if self.kept.size:
            inputs[self.shown :] = self._correlate(step, inputs[: self.shown])
        sums = np.matmul(own["hidden"], inputs, out=self.sums[step])
        sums += own["bias"][:, None]
        np.clip(sums, -3.0, 3.0, out=sums)
        square = sums * sums
        hidden = np.divide(27.0 + square, 27.0 + 9.0 * square, out=self.hidden[step])
        hidden *= sums
        asked = own["direct"] @ inputs + own["output"] @ hidden + own["last"][:, None]
        np.clip(asked, -1.0, 1.0, out=self.acted[step])
        self.free[step] = self.acted[step] == asked
        return asked

    def _correlate(self, step: int, shown: Single) -> Single:
        pairs = np.matmul(self.parameters["pairs"], shown, out=self.pairs[step])
        a, b = pairs[::2], pairs[1::2]
        products, squares = self.products[step], self.squares[step]
        np.multiply(2.0 * a, b, out=products)
        np.add(a * a, b * b, out=squares)
        if step > 0:
            products += self.kept * self.products[step - 1]
            squares += self.kept * self.squares[step - 1]
        return (products / (self.floor + squares) - self.offset) * self.scale

    def _weights(self, step: int) -> tuple[Single, Single, Single]:
        """Return `keep`, `enter` and `back` of the linear memory in a step."""
        own = self.parameters
        weights = [own.get(name, NONE) for name in self._early]
        if "early" in own:
            early = REAL(self.settles**step) * own["early"]
            weights = [
                one + early[:, part]
                for one, part in zip(weights, self._early.values(), strict=True)
            ]
        keep, enter, back = weights
        return keep, enter, back

    def begin_back(self) -> None:
        """Begin the way back, at an episode's end."""
        for slopes in (*self.gradient.values(), *self._remembered, self.by_acted):
            slopes[:] = 0.0

    def back(self, step: int, by_action: Array, *, inwards: float = 0.0) -> Single:
        """Return the slopes over the observation (n, lanes), given the motion's over the actions.

        Those over the parameters are added to the gradient. Steps come from the last to the first.
        """
        own, add, inputs, n = self.parameters, self.gradient, self.inputs[step], self.observed
        by_asked = by_action.astype(REAL)
        if self.acting:
            by_asked += self.by_acted
        leads_inside = by_asked * self.acted[step] > 0.0
        by_asked *= np.maximum(self.free[step], REAL(inwards) * leads_inside)
        add["last"] += by_asked.sum(axis=1)
        add["direct"] += by_asked @ inputs.T
        add["output"] += by_asked @ self.hidden[step].T
        square = self.sums[step] ** 2
        by_sums = np.square((9.0 - square) / (9.0 + 3.0 * square))  # the slope of the activation
        by_sums *= own["output"].T @ by_asked
        add["bias"] += by_sums.sum(axis=1)
        add["hidden"] += by_sums @ inputs.T
        by_inputs = own["hidden"].T @ by_sums
        by_inputs += own["direct"].T @ by_asked
        by_shown = by_inputs[: self.shown]
        if self.kept.size:
            by_pairs = self._correlate_back(step, by_inputs[self.shown :])
            add["pairs"] += by_pairs @ inputs[: self.shown].T
            by_shown += own["pairs"].T @ by_pairs
        if self.memory:
            self.by_memory += by_shown[n:]
            keep, enter, back = self._weights(step)
            slopes = {"enter": self.by_memory @ inputs[:n].T}
            if step > 0:
                slopes["keep"] = self.by_memory @ self.inputs[step - 1, n : self.shown].T
                if self.acting:
                    slopes["back"] = self.by_memory @ self.acted[step - 1].T
            for name, slope in slopes.items():
                add[name] += slope
                if "early" in own:
                    add["early"][:, self._early[name]] += REAL(self.settles**step) * slope
            if self.acting:
                self.by_acted[:] = back.T @ self.by_memory
            by_shown[:n] += enter.T @ self.by_memory
            self.by_memory[:] = keep.T @ self.by_memory
        return by_shown[:n]

    def _correlate_back(self, step: int, by_units: Single) -> Single:
        a, b = self.pairs[step, ::2], self.pairs[step, 1::2]
        over = 1.0 / (self.floor + self.squares[step])
        slope = by_units * self.scale * over
        self.by_products += slope
        self.by_squares -= slope * over * self.products[step]
        by_pairs = np.empty_like(self.pairs[step])
        by_pairs[::2] = 2.0 * (b * self.by_products + a * self.by_squares)
        by_pairs[1::2] = 2.0 * (a * self.by_products + b * self.by_squares)
        self.by_products *= self.kept
        self.by_squares *= self.kept
        return by_pairs

    def fade(self, factor: Array) -> None:
        """Multiply the slopes over what is remembered by a factor (lanes,).

        Those over the last action stay, as the motion's over the action do: an observer knows the
        force, and where its own recursion is not stable, only both together stay bounded.
        """
        own = factor.astype(REAL)
        for slopes in self._remembered:
            np.multiply(slopes, own, out=slopes)

    @property
    def _remembered(self) -> tuple[Single, ...]:
        return self.by_memory, self.by_products, self.by_squares
