"""The number of control steps that Gymnasium asks for when it makes an environment."""

from __future__ import annotations

from inspect import currentframe
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

from gymnasium.envs import registration
from gymnasium.wrappers import TimeLimit

from mm_gym.errors import SceneError

if TYPE_CHECKING:
    from collections.abc import Mapping

    import gymnasium

    from mm_gym.scene.scene import Scene

    Wrapper: TypeAlias = gymnasium.Wrapper[Any, Any, Any, Any]

STEPS = "control.steps"

MAKERS = (registration.make.__code__, registration.make_vec.__code__)


class Limit(NamedTuple):
    """What ends an episode that `gymnasium.make` or `make_vec` makes.

    Attributes
    ----------
    steps
        Control steps; None if no `TimeLimit` is asked for, and only the scene ends episodes.
    is_asked
        Whether the caller asked for so many, with ``max_episode_steps`` or by a registration or
        specification of his own. If not, it is the number of the registered task, whatever scene is
        used instead.
    """

    steps: int | None
    is_asked: bool


def limit_of_maker() -> Limit | None:
    """Return the limit of the Gymnasium function that is making an environment, if one is.

    `gymnasium.make` puts a `TimeLimit` around the environment that it makes, and tells it neither
    this nor its argument ``max_episode_steps``. Both stand in its frame only.
    """
    frame = currentframe()
    while frame is not None:
        if frame.f_code in MAKERS:
            return _limit(dict(frame.f_locals))
        frame = frame.f_back
    return None


def _limit(names: Mapping[str, Any]) -> Limit | None:
    """Return the limit from the local names of `gymnasium.make` or `make_vec`."""
    if not names.keys() >= {"env_spec", "env_spec_kwargs", "kwargs"}:  # another Gymnasium
        return None
    spec, merged = names["env_spec"], names["env_spec_kwargs"]
    # An argument of make's own; one of many that make_vec passes on.
    given = (names["kwargs"] | names).get("max_episode_steps")
    steps = spec.max_episode_steps if given is None else given
    registered = registration.registry.get(spec.id)
    usual = None if registered is None else registered.max_episode_steps
    if steps == -1 or (steps is None and usual is not None):
        return Limit(None, is_asked=False)
    if steps is None:
        return None
    own = {} if registered is None else registered.kwargs
    is_own_scene = all(merged.get(name) == own.get(name) for name in ("scene", "changes"))
    is_other = steps != usual
    return Limit(steps, given is not None or is_other or is_own_scene)


def limited(scene: Scene, changes: Mapping[str, object] | None, limit: Limit) -> Scene:
    """Return a scene that ends its episodes where Gymnasium was asked to end them.

    Raises
    ------
    SceneError
        If `changes` says another number than was asked for.
    """
    if limit.steps is None or not limit.is_asked:
        return scene
    if changes and STEPS in changes and scene.control.steps != limit.steps:
        msg = (
            f"{STEPS}: got {scene.control.steps} in changes and max_episode_steps = {limit.steps}; "
            "allowed: one of them, or twice the same"
        )
        raise SceneError(msg)
    return scene.replace(**{STEPS: limit.steps})


def let_follow(env: object, steps: int) -> bool:
    """Set the `TimeLimit` through which an environment is being called; tell whether there is one.

    `gymnasium.make` gives it the number of the registered task, whatever scene is used instead, and
    an environment does not know its wrappers: only their frames have them.
    """
    frame = currentframe()
    while frame is not None:
        wrapper = frame.f_locals.get("self")
        if isinstance(wrapper, TimeLimit) and cast("Wrapper", wrapper).unwrapped is env:
            wrapper._max_episode_steps = steps  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - there is no public way
            return True
        frame = frame.f_back
    return False
