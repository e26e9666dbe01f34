"""Controllers for mm_gym, their training and their evaluation.

Run from the checkout: ``python -m agents.train``.
"""

import os
import sys
from importlib.util import find_spec

NEEDED = ("control", "rich", "stable_baselines3", "tensorboard", "torch", "tqdm", "tyro")
"""What the commands import, of the extra `agents`."""

if sys.argv[:1] == ["-m"]:  # so it is while Python looks for a command of this package
    MISSING = [name for name in NEEDED if find_spec(name) is None]
    if MISSING:
        COMMAND = 'pip install "mm-gym[agents]"'
        print(f"error: {', '.join(MISSING)}: not installed; run `{COMMAND}`", file=sys.stderr)
        sys.exit(2)

# Matrices are small here: threads of NumPy's linear algebra cost more than they save, and a result
# would depend on their number in the last digits. Of use where NumPy is not loaded yet.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
