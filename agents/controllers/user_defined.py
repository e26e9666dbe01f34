"""A controller of the user's own, from a file of theirs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from agents.controllers.controller import Reads, columns
from agents.controllers.feedback import Feedback
from agents.controllers.true_state import TrueState
from mm_gym import SceneError
from mm_gym.user_code import call, load, split

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Values
    from mm_gym import MovingMassVectorEnv, Scene

LAW, CONTROLLER = ("begin", "action"), ("reset", "act")
"""Methods of a law and of a controller, see `agents.controllers.controller`."""


def user_defined(text: str, scene: Scene, what: str = "--controller") -> list[Controller]:
    """Return what ``FILE.py:NAME`` names, made for a scene. The file is run.

    Parameters
    ----------
    text
        A file of Python, and in it the name of a class, or of a function, that takes the scene and
        gives a law or a controller.
    scene
        The scene that is controlled.
    what
        The setting that names it, for messages.

    Returns
    -------
    list of Controller
        Of a law two: from the true state, and from the observation. They raise `SceneError`
        where the user's code fails, and where its actions have a wrong shape or are not finite.

    Raises
    ------
    SceneError
        If there is no such file or name, the file or the class raises an exception, or what it
        makes is neither a law nor a controller.
    """
    path, _ = split(text, what)
    made = Guarded(call(what, path, load(text, what), scene), path, scene, what)
    if made.has(CONTROLLER):
        return [made]
    if not made.has(LAW):
        msg = (
            f"{what}: {text} makes a {type(made.inner).__name__}; allowed: a law (with begin and "
            "action) or a controller (with reset and act)"
        )
        raise SceneError(msg)
    bound = Feedback(scene, made, TrueState())
    bound.name += ", full state"
    return [bound, Feedback(scene, made)]


class Guarded:
    """The user's law or controller, whose mistakes are told in plain words."""

    def __init__(self, inner: object, path: Path, scene: Scene, what: str) -> None:
        self.inner: Any = inner
        self.path, self.columns, self.what = path, columns(scene), what
        self.name = str(getattr(inner, "name", type(inner).__name__))
        self.reads: Reads = getattr(inner, "reads", "observation")
        if self.reads not in get_args(Reads):
            msg = (
                f"{what}: {path}: reads: got {self.reads!r}; allowed: {', '.join(get_args(Reads))}"
            )
            raise SceneError(msg)

    def has(self, methods: tuple[str, ...]) -> bool:
        """Tell whether it has all of these methods."""
        return all(callable(getattr(self.inner, method, None)) for method in methods)

    def begin(self, lanes: int) -> None:
        """Prepare a law."""
        self._call(self.inner.begin, lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return a law's actions."""
        return self._checked(self._call(self.inner.action, state, applied), len(state))

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare a controller."""
        self._call(self.inner.reset, env)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return a controller's actions."""
        return self._checked(self._call(self.inner.act, observation, info), len(observation))

    def send(self, action: Values) -> None:
        """Tell a controller that has `send` which actions are applied."""
        if self.has(("send",)):
            self._call(self.inner.send, action)

    def _call(self, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - what the user wrote
        return call(self.what, self.path, function, *arguments)

    def _checked(self, actions: object, lanes: int) -> Values:
        wanted = lanes, len(self.columns)
        values = self._call(np.asarray, actions, np.float64)
        if values.shape != wanted:
            msg = (
                f"{self.what}: {self.path}: {self.name}: got actions of shape {values.shape}; "
                f"allowed: {wanted}, a row for each episode and a column for each of: "
                f"{', '.join(self.columns)}"
            )
            raise SceneError(msg)
        if not np.isfinite(values).all():
            msg = f"{self.what}: {self.path}: {self.name}: got actions that are not finite"
            raise SceneError(msg)
        return values
