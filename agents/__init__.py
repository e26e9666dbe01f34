"""Controllers for mm_gym, their training and their evaluation.

Run from the checkout: ``python -m agents`` lists the commands.
"""

import os
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec, spec_from_file_location
from pathlib import Path

NEEDED = (
    *("control", "filelock", "jinja2", "rich", "stable_baselines3", "tensorboard", "torch"),
    *("tqdm", "tyro"),
)
"""What the commands import, of the extra `agents`."""

if sys.argv[:1] == ["-m"]:  # so it is while Python looks for a command of this package
    MISSING = [name for name in NEEDED if find_spec(name) is None]
    if MISSING:
        print(
            f"error: {', '.join(MISSING)}: not installed; install the extra `agents`",
            file=sys.stderr,
        )
        sys.exit(2)


class _OldSpelling(MetaPathFinder):
    """``python -m agents.train`` is ``python -m agents train``."""

    @staticmethod
    def find_spec(name: str, _path: object = None, _target: object = None) -> ModuleSpec | None:
        here, (package, _, command) = Path(__file__).parent, name.partition(".")
        if package != __name__ or not (here / "commands" / f"{command}.py").exists():
            return None
        return spec_from_file_location(name, here / "__main__.py")


sys.meta_path.append(_OldSpelling())

# Matrices are small here: threads of NumPy's linear algebra cost more than they save, and a result
# would depend on their number in the last digits. Of use where NumPy is not loaded yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
