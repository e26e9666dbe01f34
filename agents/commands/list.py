"""List the tasks, or the controllers that apply to one.

Alone, ``python -m agents list`` lists the tasks. With a task or a scene file, as ``python -m agents
list Hybrid``, it lists the names of controllers that ``evaluate``, ``record``, ``tune`` and ``train
--base`` take for it.
"""

from typing import Annotated

import tyro

from agents.controllers.registry import laws
from agents.errors import command
from agents.report.score_pages import about
from mm_gym import load_scene
from mm_gym.tasks import ids, path_of, short_name, task_or_scene


@command
def main(task: Annotated[str | None, tyro.conf.Positional] = None) -> None:
    """Print the tasks, or the names of controllers.

    Parameters
    ----------
    task
        a name such as Hybrid, or a scene file; by default all tasks are listed
    """
    if task is None:
        names = {short_name(name): about(path_of(name)) for name in ids()}
        width = max(map(len, names))
        print(*(f"{name:{width}}  {text}".rstrip() for name, text in names.items()), sep="\n")
        print("Variants with uncertain parameters end with Robust: docs/robustness.md")
    else:
        print(*laws(load_scene(task_or_scene(task))), sep="\n")
