"""Scene files that begin with a task: `base` names it, and the file states what differs."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from mm_gym.errors import SceneError, suggest
from mm_gym.scene.dotted_names import KIND, put
from mm_gym.tasks import task_called

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from mm_gym.scene.dotted_names import Data
    from mm_gym.scene.scene import Scene

BASE, DRAWN = "base", "randomization"


def with_base(data: dict[str, object], load: Callable[[str], Scene]) -> dict[str, object]:
    """Return a scene's fields as in a file, those of its base included if it names one.

    Tables go over those of the base field by field, lists and parts of another kind as a whole.
    What the file states is no longer drawn, unless the file draws it too.

    Parameters
    ----------
    data
        The fields as in the file, not validated.
    load
        Returns the scene of a task. Tasks have no base, so there are no cycles.

    Raises
    ------
    SceneError
        If the base is not a task, "base: text", or the key is misspelt.
    """
    for name in data:
        if name != BASE and suggest(name, [BASE]):
            msg = f"{name}: unknown key{suggest(name, [BASE])}"
            raise SceneError(msg)
    if BASE not in data:
        return data
    own = {name: value for name, value in data.items() if name != BASE}
    base = load(_task(data[BASE]))
    stated = dict(_leaves(own))
    found = cast("dict[str, Data]", base.model_dump(mode="json"))
    gone = [*_replaced(stated, base), *(name for name in stated if not name.startswith(DRAWN))]
    follows = {ratio: field for ratio, (field, _) in base.drawn_ratios.items()}
    found[DRAWN] = {
        name: ends
        for name, ends in cast("dict[str, Data]", found[DRAWN]).items()
        if not any(_within(one, part) for part in gone for one in (name, follows.get(name, name)))
    }
    put(found, stated)
    return cast("dict[str, object]", found)


def _task(name: object) -> str:
    if not isinstance(name, str):
        msg = f"base: got {name!r}; allowed: the name of a task, in quotes"
        raise SceneError(msg)
    try:
        return task_called(name)
    except SceneError as error:
        msg = f"base: {str(error).removeprefix('task: ')}"
        raise SceneError(msg) from None


def _leaves(table: dict[str, object], prefix: str = "") -> Iterator[tuple[str, object]]:
    """Yield what a file states by dotted name: numbers, texts and whole lists."""
    for name, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(cast("dict[str, object]", value), f"{prefix}{name}.")
        else:
            yield prefix + name, value


def _replaced(stated: dict[str, object], base: Scene) -> Iterator[str]:
    """Yield the parts whose kind is another than that of the base."""
    for name, value in stated.items():
        part, _, last = name.rpartition(".")
        if last == KIND and base.value_of(name) != value:
            yield part


def _within(name: str, part: str) -> bool:
    return name == part or name.startswith(f"{part}.")
