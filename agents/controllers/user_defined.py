"""A controller of the user's own, from a file of theirs."""

from __future__ import annotations

import traceback
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from agents.controllers.controller import Reads, columns
from agents.controllers.feedback import Feedback
from agents.controllers.true_state import TrueState
from mm_gym.errors import suggest

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from numpy.typing import NDArray

    from agents.controllers.controller import Controller, Values
    from mm_gym import MovingMassVectorEnv, Scene

LAW, CONTROLLER = ("begin", "action"), ("reset", "act")
"""Methods of a law and of a controller, see `agents.controllers.controller`."""


class ControllerError(RuntimeError):
    """A controller of the user's own cannot be read, or does not do what it must."""


def user_defined(text: str, scene: Scene) -> list[Controller]:
    """Return what ``FILE.py:NAME`` names, made for a scene. The file is run.

    Parameters
    ----------
    text
        A file of Python, and in it the name of a class, or of a function, that takes the scene and
        gives a law or a controller.
    scene
        The scene that is controlled.

    Returns
    -------
    list of Controller
        Of a law two: from the true state, and from the observation. They raise `ControllerError`
        where the user's code fails, and where its actions have a wrong shape or are not finite.

    Raises
    ------
    ControllerError
        If there is no such file or name, the file or the class raises an exception, or what it
        makes is neither a law nor a controller.
    """
    path, _, name = text.rpartition(":")
    if not (path and name):
        msg = f"--controller: got {text!r}; allowed: FILE.py:NAME"
        raise ControllerError(msg)
    made = Guarded(_named(Path(path), name)(scene), Path(path), scene)
    if made.has(CONTROLLER):
        return [made]
    if not made.has(LAW):
        msg = f"{text}: allowed: a law (with begin and action) or a controller (with reset and act)"
        raise ControllerError(msg)
    bound = Feedback(scene, made, TrueState())
    bound.name += ", full state"
    return [bound, Feedback(scene, made)]


class Guarded:
    """The user's law or controller, whose mistakes are told in plain words."""

    def __init__(self, inner: object, path: Path, scene: Scene) -> None:
        self.inner: Any = inner
        self.path, self.columns = path, columns(scene)
        self.name = str(getattr(inner, "name", type(inner).__name__))
        self.reads: Reads = getattr(inner, "reads", "observation")
        if self.reads not in get_args(Reads):
            msg = f"{path}: reads: got {self.reads!r}; allowed: {', '.join(get_args(Reads))}"
            raise ControllerError(msg)

    def has(self, methods: tuple[str, ...]) -> bool:
        """Tell whether it has all of these methods."""
        return all(callable(getattr(self.inner, method, None)) for method in methods)

    def begin(self, lanes: int) -> None:
        """Prepare a law."""
        _call(self.path, self.inner.begin, lanes)

    def action(self, state: Values, applied: Values) -> Values:
        """Return a law's actions."""
        return self._checked(_call(self.path, self.inner.action, state, applied), len(state))

    def reset(self, env: MovingMassVectorEnv) -> None:
        """Prepare a controller."""
        _call(self.path, self.inner.reset, env)

    def act(self, observation: NDArray[np.float32], info: dict[str, Any]) -> Values:
        """Return a controller's actions."""
        return self._checked(_call(self.path, self.inner.act, observation, info), len(observation))

    def _checked(self, actions: object, lanes: int) -> Values:
        wanted = lanes, len(self.columns)
        values = _call(self.path, np.asarray, actions, np.float64)
        if values.shape != wanted:
            msg = (
                f"{self.path}: {self.name}: got actions of shape {values.shape}; allowed: {wanted}"
                f", a row for each episode and a column for each of: {', '.join(self.columns)}"
            )
            raise ControllerError(msg)
        if not np.isfinite(values).all():
            msg = f"{self.path}: {self.name}: got actions that are not finite"
            raise ControllerError(msg)
        return values


def _named(path: Path, name: str) -> Callable[[Scene], object]:
    """Return the class or function of a file; a mistake in it is a `ControllerError`."""
    own = vars(_module(path))
    found = own.get(name)
    if not callable(found):
        names = [key for key, value in own.items() if callable(value) and key[0] != "_"]
        msg = f"{path}: it has no class or function {name!r}{suggest(name, names)}"
        raise ControllerError(msg)
    return lambda scene: _call(path, found, scene)


def _module(path: Path) -> ModuleType:
    """Run a file."""
    if not path.is_file():
        msg = f"{path}: no such file"
        raise ControllerError(msg)
    spec = spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        msg = f"{path}: allowed: a file of Python, whose name ends in .py"
        raise ControllerError(msg)
    module = module_from_spec(spec)
    _call(path, spec.loader.exec_module, module)
    return module


def _call(path: Path, function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401
    """Call what the user wrote; raise `ControllerError` with the line of an exception in it."""
    try:
        return function(*arguments)
    except Exception as error:
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if Path(frame.filename) == path]
        where = f", line {own[-1].lineno}" if own else ""
        msg = f"{path}{where}: {type(error).__name__}: {error}"
        raise ControllerError(msg) from error
