"""A policy: layers over observations, with an explicit memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from agents.network.arithmetic import Arithmetic
from agents.network.files import Arrays, FilePolicy, numbers
from agents.network.graph import Graph
from agents.network.layers import (
    KINDS,
    LSTM,
    Activation,
    Clip,
    Correlation,
    Dense,
    Layer,
    LinearMemory,
    Observer,
    Residual,
    SettlingObserver,
    Skip,
    every,
    outputs_of,
    run,
)
from mm_gym.arrays import Array, Single
from mm_gym.errors import refuse

Kind = TypeVar("Kind", bound=Layer)

FORMAT = 4  # of files. 1 to 3 are NumPy's archives, see `agents.policies`.


@dataclass(frozen=True, eq=False)
class Policy(FilePolicy):
    """Layers, one after the other, whose last output is the action: that of a trained agent's mean.

    Raise `ValueError` if the layers do not fit each other.
    """

    layers: tuple[Layer, ...]  # from the observation (n,) to the action (k,) in [-1, 1]
    # observed, actions: n, k.
    observed: int
    actions: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "actions", outputs_of(self.layers, self.observed))

    @property
    def sizes(self) -> list[int]:
        """Numbers of an observation, of the outputs of each dense layer, the action's the last."""
        dense = [layer for layer in every(self.layers) if isinstance(layer, Dense)]
        return [self.observed, *(len(layer.bias) for layer in dense)]

    @property
    def remembers(self) -> int:
        """How many numbers it remembers from step to step."""
        return sum(layer.remembers for layer in self.layers)

    @property
    def arrays(self) -> dict[str, Single]:
        """All arrays, by the names that they have in files: "0.keep", "2.layers.0.weight"."""
        return dict(_named(self.layers))

    def find(self, kind: type[Kind]) -> Kind | None:
        """Return the first layer of a kind."""
        return next((layer for layer in every(self.layers) if isinstance(layer, kind)), None)

    def step(self, observation: Array | Single, memory: Array) -> tuple[Array, Array]:
        """Return the actions (lanes, k) for observations (lanes, n), and the memory after them."""
        return run(self.layers, np, observation.astype(np.float64), memory)

    def act(self, observation: ArrayLike, memory: Array | None = None) -> Array:
        """Return the actions (lanes, k) for observations (lanes, n) as the environment has them.

        Parameters
        ----------
        observation
            (lanes, n).
        memory
            What `begin` returned at the episode's start; moved on by a step. Without, an episode
            begins.
        """
        values = np.asarray(observation, np.float64)
        memory = self.begin(len(values)) if memory is None else memory
        action, memory[:] = self.step(values, memory)
        return action

    @classmethod
    def of_graph(cls, graph: Graph) -> Policy:
        """Return a computation from "observation" and "memory" to "action" and "next_memory"."""
        return cls((Arithmetic.of(graph),), graph.inputs["observation"].made_by.width)

    def graph(self) -> Graph:
        """Return what C and ONNX are written from."""
        graph = Graph()
        given = graph.input("observation", self.observed), graph.input("memory", self.remembers)
        made = run(self.layers, np, *given)  # pyright: ignore[reportArgumentType] - signals
        graph.outputs = dict(zip(("action", "next_memory"), made, strict=True))
        return graph

    def with_arrays(self, arrays: Mapping[str, Single]) -> Policy:
        """Return the policy with other arrays, by their names in `arrays`."""
        return replace(self, layers=_replaced(self.layers, arrays, ""))

    def _content(self) -> tuple[dict[str, Any], Arrays]:
        layers = [_described(layer) for layer in self.layers]
        return {"format": FORMAT, "observed": self.observed, "layers": layers}, self.arrays


def _named(layers: Sequence[Layer], prefix: str = "") -> Iterator[tuple[str, Single]]:
    for number, layer in enumerate(layers):
        for name, array in layer.arrays.items():
            yield f"{prefix}{number}.{name}", array
        yield from _named(getattr(layer, "layers", ()), f"{prefix}{number}.layers.")


def _replaced(layers: Sequence[Layer], arrays: Mapping[str, Any], prefix: str) -> tuple[Layer, ...]:
    found: list[Layer] = []
    for number, layer in enumerate(layers):
        own = f"{prefix}{number}."
        changed = {name: arrays[own + name] for name in layer.arrays if own + name in arrays}
        if inner := getattr(layer, "layers", ()):
            changed["layers"] = _replaced(inner, arrays, f"{own}layers.")
        found.append(replace(layer, **changed))  # pyright: ignore[reportArgumentType] - a dataclass
    return tuple(found)


def _described(layer: Layer) -> dict[str, Any]:
    """Return what a file says of a layer in JSON: all but its arrays."""
    told: dict[str, Any] = {"kind": layer.kind}
    for name in (one.name for one in fields(layer)):  # pyright: ignore[reportArgumentType] - a dataclass
        value = getattr(layer, name)
        if name == "layers":
            told["layers"] = [_described(inner) for inner in value]
        elif name not in layer.arrays:
            told[name] = value
    return told


def policy_of(description: Mapping[str, Any], arrays: Mapping[str, Single]) -> Policy:
    """Return the policy that a file describes; raise `ValueError` where it is wrong."""
    observed, told = description.get("observed"), description.get("layers")
    if type(observed) is not int or observed < 1 or not isinstance(told, list) or not told:
        refuse("observed, layers", f"{observed!r} and {told!r}", "a number and a list", ValueError)
    left = dict(arrays)
    policy = Policy(_read(told, left, ""), observed)
    if left:
        msg = f"{next(iter(left))}: unknown; allowed: {', '.join(policy.arrays)}"
        raise ValueError(msg)
    return policy


DEEPEST = 4  # layers within layers that are read


def _read(told: object, left: dict[str, Single], prefix: str) -> tuple[Layer, ...]:
    """Return layers, and take their arrays out of those that are left."""
    if not isinstance(told, list) or prefix.count("layers") > DEEPEST:
        refuse(f"{prefix}layers", f"{told!r}", f"a list, at most {DEEPEST} deep", ValueError)
    found: list[Layer] = []
    for number, entry in enumerate(told):
        own = f"{prefix}{number}."
        kind = KINDS.get(str(entry.get("kind"))) if isinstance(entry, dict) else None
        if kind is None:
            refuse(f"{own}kind", f"{entry!r}", ", ".join(KINDS), ValueError)
        given: dict[str, Any] = {name: value for name, value in entry.items() if name != "kind"}
        types = {one.name: one.type for one in fields(kind)}  # pyright: ignore[reportArgumentType] - a dataclass
        for name, type_ in types.items():
            if name == "layers":
                given[name] = _read(given.get(name), left, f"{own}layers.")
            elif name not in given:
                dtype = np.float64 if type_ == "Array" else np.float32
                given[name] = taken(left, own + name, dtype)
        if set(given) != set(types):
            refuse(f"{own}{kind.kind}", ", ".join(given), ", ".join(types), ValueError)
        _check_settings(kind, given, own)
        found.append(kind(**given))
    return tuple(found)


def _check_settings(kind: type[Layer], given: Mapping[str, Any], own: str) -> None:
    """Raise `ValueError` unless what is no array has the type that the layer declares."""
    types = {"str": str, "float": (float, int), "int": int, "list[Any]": list}
    for own_field in fields(kind):  # pyright: ignore[reportArgumentType] - a dataclass
        wanted, value = types.get(str(own_field.type)), given[own_field.name]
        wrong = wanted is not None and (not isinstance(value, wanted) or value is True)
        if wrong or (wanted is None and not isinstance(value, np.ndarray | tuple)):
            refuse(f"{own}{own_field.name}", f"{value!r}", f"{own_field.type}", ValueError)


def taken(left: dict[str, Single], name: str, dtype: DTypeLike = np.float32) -> Single:
    """Return one of several arrays, and drop it there; raise `ValueError` if it is none."""
    if name not in left or not left[name].ndim or not left[name].size:
        got = f"shape {left[name].shape}" if name in left else "nothing"
        refuse(name, got, "an array of finite numbers", ValueError)
    found = numbers(left, name, left[name].shape, dtype)
    del left[name]
    return found


def network(
    weights: Sequence[ArrayLike],
    biases: Sequence[ArrayLike],
    activation: str,
    low: ArrayLike,
    high: ArrayLike,
    **optional: Any,  # noqa: ANN401 - as below
) -> Policy:
    """Return the policy of dense layers, with what may stand before, around and after them.

    Parameters
    ----------
    weights, biases
        Of each dense layer (outputs, inputs) and (outputs,).
    activation
        Of `agents.network.layers.FUNCTIONS`, after all of them but the last.
    low, high
        (k,) bounds of the action [-].
    optional
        `keep` and `enter` of a `LinearMemory`, or with `back` of an `Observer` around all, which
        with `early` and `fade` is a `SettlingObserver`; then
        `pairs` and `units` of a `Correlation`, then
        `cell`, the three arrays of an `LSTM`; `direct` of a `Skip`; `squashed`, whether a tanh
        follows; `base` and `authority` of a `Residual`. Empty arrays stand for none.
    """
    given = {name: value for name, value in optional.items() if np.isscalar(value) or len(value)}
    for one, other in (("keep", "enter"), ("pairs", "units")):
        if (one in given) != (other in given):
            refuse(f"{one}, {other}", "one without the other", "both, or none", ValueError)
    dense: list[Layer] = []
    for weight, bias in zip(weights, biases, strict=True):
        dense += [Activation(activation)] if dense else []
        dense.append(Dense(_single(weight), _single(bias)))
    layers: list[Layer] = []
    if "keep" in given and "back" not in given:
        layers.append(LinearMemory(_single(given["keep"]), _single(given["enter"])))
    if "units" in given:
        layers.append(Correlation(_single(given["pairs"]), _single(given["units"])))
    if "cell" in given:
        layers.append(LSTM(*map(_single, given["cell"])))
    layers += [Skip(tuple(dense), _single(given["direct"]))] if "direct" in given else dense
    layers += [Activation("tanh")] if given.get("squashed") else []
    layers.append(Clip(_single(low), _single(high)))
    if "back" in given:
        kind, names = Observer, ["keep", "enter", "back"]
        if "early" in given:
            kind, names = SettlingObserver, [*names, "early", "fade"]
        layers = [kind(tuple(layers), *(_single(given[name]) for name in names))]
    observed = _observed(layers)
    if "base" in given:
        base = _single(given["base"])
        layers, observed = [Residual(tuple(layers), base, given["authority"])], observed - len(base)
    return Policy(tuple(layers), observed)


PARTS = (
    *("keep", "enter", "back", "pairs", "units", "cell", "direct", "squashed", "base", "authority"),
)
"""What `network` takes in addition."""


def _observed(layers: Sequence[Layer]) -> int:
    """Return how many numbers the first layer reads."""
    first = layers[0].layers[0] if isinstance(layers[0], Skip) else layers[0]
    name = next(name for name in ("enter", "pairs", "weight") if name in first.arrays)
    return first.arrays[name].shape[-1]


def _single(values: ArrayLike) -> Single:
    return np.asarray(values, np.float32)
