"""Policies as files of numbers: nothing in them can run code.

A file is in safetensors' format, the arrays of a policy and a JSON text of the rest; NumPy's
archives of earlier versions are read too. It is a network (`agents.network`) or a table of value
iteration (`agents.value_table.policy`), and takes NumPy alone to act.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, Strict

from agents.network.files import LARGEST, PolicyError, read_content
from agents.network.interface import Interface
from agents.network.policy import FORMAT, PARTS, Policy, network, policy_of, taken
from agents.value_table.policy import TablePolicy, table_policy
from mm_gym import DesignError, SceneError
from mm_gym.arrays import Array
from mm_gym.errors import finite_numbers, refuse
from mm_gym.files import read_bytes
from mm_gym.scene import Document

AnyPolicy: TypeAlias = Policy | TablePolicy  # what acts: a network, or a table of value iteration


class Deployed:
    """A policy between a laboratory's sensors and actuators: SI units in, SI units out.

    Raise `PolicyError` if one has other numbers than the other.
    """

    def __init__(self, policy: AnyPolicy, interface: Interface) -> None:
        policy.check(interface.observed, len(interface.commands))
        self.policy, self.interface = policy, interface
        self.zero = np.array([channel.zero for channel in interface.channels])
        self.factor = np.array([channel.factor for channel in interface.channels])
        self.frames: Array | None = None

    def act_si(self, measured: ArrayLike, t: float) -> Array:
        """Return the commands (k,), in the units of `Interface.commands`.

        Raise `DesignError`, and remember nothing of it, if an episode does not begin at 0, or there
        is another number of values than of channels, or one that is not finite.

        Parameters
        ----------
        measured
            (channels,) the newest values, in the units of `Interface.channels`.
        t
            Time since the episode's start [s]; at 0 all that is remembered is forgotten.
        """
        values = finite_numbers("measured", measured, DesignError)
        if values.shape != self.zero.shape:
            names = ", ".join(channel.name for channel in self.interface.channels)
            refuse("measured", f"shape {values.shape}", f"a number each of {names}", DesignError)
        finite_numbers("t", t, DesignError)
        frame = (values - self.zero) * self.factor
        if t < 0.5 * self.interface.time_step:
            self.frames = np.tile(frame, (self.interface.history, 1))
            self.memory = self.policy.begin(1)
        if self.frames is None:
            refuse("t", f"{t:g} in the first step", "0, where an episode begins", DesignError)
        self.frames = np.vstack([self.frames, frame])[-self.interface.history :]
        (action,), self.memory = self.policy.step(self.frames.reshape(1, -1), self.memory)
        return self.interface.commanded(action)


def load_policy(path: str | Path) -> AnyPolicy:
    """Read a policy that `save` of either kind wrote; nothing in the file is run.

    Raise `PolicyError` if the file is missing, too large, damaged, or no policy.
    """
    return load_exported(path)[0]


def load_exported(path: str | Path) -> tuple[AnyPolicy, Interface | None]:
    """Read a policy with the interface in its file, None if there is none.

    Raise `PolicyError` as `load_policy` does, or if the interface is of another size.
    """
    try:
        content = read_bytes(path, most=LARGEST)
    except SceneError as error:
        raise PolicyError(str(error)) from None
    try:
        policy, description = policy_in(content), read_content(content)[0]
        if "interface" not in description:
            return policy, None
        if not isinstance(described := description["interface"], dict):
            refuse("interface", f"{described!r}", "a table", ValueError)
        interface = Interface.of(described)
    except ValueError as error:
        told = "; ".join(str(error).splitlines())
        msg = f"{path}: not a policy that `train` wrote: {told}"
        raise PolicyError(msg) from None
    policy.check(interface.observed, len(interface.commands), f"the interface in {path}")
    return policy, interface


def load_deployed(path: str | Path) -> Deployed:
    """Read an exported policy with the interface in its file; raise `PolicyError` without one."""
    policy, interface = load_exported(path)
    if interface is None:
        msg = f"{path}: has no interface; `python -m agents export` with --task writes one"
        raise PolicyError(msg)
    return Deployed(policy, interface)


def policy_in(content: bytes) -> AnyPolicy:
    """Return the policy in the content of a file; raise `ValueError` if it is none."""
    description, arrays = read_content(content)
    if "after" in arrays:
        return table_policy(description, arrays)
    if description.get("format") == FORMAT:
        return policy_of(description, arrays)
    return old_policy(description, arrays)


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
        refuse("sizes", f"{list(told.sizes)}", f"{policy.sizes}, as the arrays have", ValueError)
    return policy
