"""Networks of earlier versions: NumPy's archives of formats 1 to 3."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from numpy.typing import NDArray
from pydantic import Field, Strict

from agents.network.policy import PARTS, Policy, network, taken
from mm_gym.scene import Document


class Description(Document):
    """What the file says in JSON."""

    format: Literal[1, 2, 3]
    """1 had layers alone, 3 has a base or a linear memory also"""
    activation: Literal["tanh", "relu", "rational"]
    """of `agents.network.layers.FUNCTIONS`"""
    sizes: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Strict(False), Field(min_length=2)]
    """see `Policy.sizes`"""
    low: Annotated[tuple[float, ...], Strict(False)]
    """bounds of the action [-]"""
    high: Annotated[tuple[float, ...], Strict(False)]
    """bounds of the action [-]"""
    squashed: bool = False
    """whether a tanh follows the last layer"""
    authority: Annotated[float, Field(ge=0)] = 0.0
    """most that is added to the action of the base"""


def old_policy(description: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Policy:
    """Return the network of an archive; raise `ValueError` where it is wrong."""
    told = Description.of(description)
    layers = range(len(told.sizes) - 1)
    cell = [f"cell_{i}" for i in range(3)] if "cell_0" in arrays else []
    dense = [f"{kind}_{i}" for i in layers for kind in ("weight", "bias")]
    parts = [name for name in PARTS if name in arrays]
    known = ["description", *dense, *cell, *parts]
    if unknown := sorted(set(arrays) - set(known)):
        msg = f"{unknown[0]}: unknown; allowed: {', '.join(known)}"
        raise ValueError(msg)
    left = dict(arrays)
    own = {name: taken(left, name) for name in known[1:]}
    policy = network(
        [own[f"weight_{i}"] for i in layers],
        [own[f"bias_{i}"] for i in layers],
        told.activation,
        told.low,
        told.high,
        cell=[own[name] for name in cell],
        squashed=told.squashed,
        authority=told.authority,
        **{name: own[name] for name in parts},
    )
    if policy.sizes != list(told.sizes):
        msg = f"sizes: got {list(told.sizes)}; allowed: {policy.sizes}, as the arrays have"
        raise ValueError(msg)
    return policy
