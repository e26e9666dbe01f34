"""Controllers for mm_gym, their training and their evaluation.

Run from the checkout: ``python -m agents`` lists the commands.
"""

import os
import sys
from importlib.util import find_spec
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

# ``python -m agents train`` is ``python -m agents train``, as it was called before.
__path__.append(str(Path(__file__).with_name("commands")))

# Matrices are small here: threads of NumPy's linear algebra cost more than they save, and a result
# would depend on their number in the last digits. Of use where NumPy is not loaded yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
