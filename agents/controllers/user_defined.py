"""A controller of the user's own, from a file of theirs."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, NoReturn, get_args

import numpy as np
from numpy.typing import NDArray

from agents.control.controller import Acted, Controller, Info, Law, Memory, Observation, Reads
from agents.control.feedback import Feedback, TrueState
from mm_gym import MovingMassVectorEnv, Scene, SceneError
from mm_gym.arrays import Array
from mm_gym.user_code import call, load, split


def user_defined(text: str, scene: Scene, what: str = "--controller") -> list[Controller]:
    """Return what ``FILE.py:NAME`` names, made for a scene. The file is run.

    Raise `SceneError` if there is no such file or name, the file or the class raises an exception,
    or what it makes is neither a law nor a controller.

    Parameters
    ----------
    text
        A file of Python, and in it the name of a class, or of a function, that takes the scene and
        gives a law or a controller.

    Returns
    -------
    list of Controller
        Of a law two: from the true state, and from the observation. They raise `SceneError`
        where the user's code fails, and where its actions have a wrong shape or are not finite.
    """
    path, _ = split(text, what)
    made = call(what, path, load(text, what), scene)
    guard = Guard(made, path, scene, what)
    if guard.has("act"):
        return [UserController(guard)]
    if not guard.has("action"):
        msg = (
            f"{what}: {text} makes a {type(made).__name__}; allowed: a law (with a method action) "
            "or a controller (with a method act)"
        )
        raise SceneError(msg)
    law = UserLaw(guard)
    bound = Feedback(scene, law, TrueState())
    bound.name += ", full state"
    return [bound, Feedback(scene, law)]


class Guard:
    """What the user wrote, whose mistakes are told in plain words."""

    def __init__(self, inner: object, path: Path, scene: Scene, what: str) -> None:
        self.inner: Any = inner
        self.path, self.columns, self.what = path, scene.actuation.names, what
        self.name = str(self.call(getattr, inner, "name", type(inner).__name__))
        self.reads: Reads = self.call(getattr, inner, "reads", "observation")
        if self.reads not in get_args(Reads):
            self.refuse(f"reads: got {self.reads!r}", ", ".join(get_args(Reads)))

    def has(self, method: str) -> bool:
        """Tell whether it has a method."""
        return callable(getattr(self.inner, method, None))

    def begin(self, argument: object, lanes: int) -> Memory:
        if not self.has("begin"):
            return {}
        return self.memory(self.call(self.inner.begin, argument), lanes)

    def acted(
        self, method: Callable[..., Any], memory: Memory, *arguments: NDArray[Any] | dict[str, Any]
    ) -> Acted:
        """Return the actions and the memory that a method returns."""
        if not isinstance(arguments[0], np.ndarray):  # it is followed for an export
            return self.call(method, memory, *arguments)
        lanes = len(arguments[0])
        # It may write into what it is given, and nobody else sees that.
        returned = self.call(method, *deepcopy((memory, *arguments)))
        if not (isinstance(returned, tuple) and len(returned) == 2):  # noqa: PLR2004
            self.refuse(
                f"got a {type(returned).__name__}", "two things, the actions and the memory"
            )
        actions, after = returned
        return self.actions(actions, lanes), self.like(memory, self.memory(after, lanes))

    def call(self, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - what the user wrote
        """Return what the user's function returns."""
        return call(self.what, self.path, function, *arguments)

    def refuse(self, got: str, allowed: str) -> NoReturn:
        """Raise `SceneError`."""
        msg = f"{self.what}: {self.path}: {self.name}: {got}; allowed: {allowed}"
        raise SceneError(msg)

    def actions(self, actions: object, lanes: int) -> Array:
        """Return actions (lanes, k) that are numbers."""
        wanted = lanes, len(self.columns)
        if np.iscomplexobj(actions):
            self.refuse("got complex actions", "real numbers")
        values = self.call(np.asarray, actions, np.float64)
        if values.shape != wanted:
            rows = "a row for each episode and a column for each of: " + ", ".join(self.columns)
            self.refuse(f"got actions of shape {values.shape}", f"{wanted}, {rows}")
        if not np.isfinite(values).all():
            self.refuse("got actions that are not finite", "finite numbers")
        return values

    def memory(self, memory: object, lanes: int) -> Memory:
        """Return a memory that is one: arrays by name, whose first axis is the lanes."""
        if not isinstance(memory, dict):
            self.refuse(f"got a {type(memory).__name__} as memory", "a dict of arrays")
        arrays = {str(name): self.call(np.asarray, array) for name, array in memory.items()}
        for name, array in arrays.items():
            if array.dtype.kind not in "biuf" or array.shape[:1] != (lanes,):
                got = f"memory {name!r}: got {array.dtype} of shape {array.shape}"
                self.refuse(got, f"numbers whose first axis has the {lanes} lanes")
        return arrays

    def like(self, before: Memory, after: Memory) -> Memory:
        """Return a memory that has the names, types and shapes of that before."""
        for name in {**before, **after}:
            told = [
                f"{own[name].dtype} of shape {own[name].shape}" if name in own else "nothing"
                for own in (before, after)
            ]
            if told[0] != told[1]:
                self.refuse(f"memory {name!r}: got {told[1]}", f"as it began, {told[0]}")
        return after


class UserLaw(Law):
    """A law of the user's own."""

    def __init__(self, guard: Guard) -> None:
        self.guard, self.name = guard, guard.name

    def begin(self, lanes: int) -> Memory:
        return self.guard.begin(lanes, lanes)

    def action(self, memory: Memory, state: Array, applied: Array) -> Acted:
        return self.guard.acted(self.guard.inner.action, memory, state, applied)


class UserController(Controller):
    """A controller of the user's own, which is told what is applied if it has `note`."""

    def __init__(self, guard: Guard) -> None:
        self.guard, self.name, self.reads = guard, guard.name, guard.reads

    def begin(self, env: MovingMassVectorEnv) -> Memory:
        return self.guard.begin(env, env.num_envs)

    def propose(self, memory: Memory, observation: Observation, info: Info) -> Acted:
        return self.guard.acted(self.guard.inner.act, memory, observation, info)

    def note(self, memory: Memory, action: Array) -> Memory:
        if not self.guard.has("note"):
            return memory
        given = deepcopy((memory, action)) if isinstance(action, np.ndarray) else (memory, action)
        told = self.guard.call(self.guard.inner.note, *given)
        return self.guard.like(memory, self.guard.memory(told, len(action)))
