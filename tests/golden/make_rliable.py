"""Point estimates by rliable 1.2, where it is installed: ``python tests/golden/make_rliable.py``.

It needs an environment of its own, with pandas below 3: arch, which it draws in, needs that.
"""

import json
from pathlib import Path

import numpy as np
from rliable import library, metrics

generator = np.random.default_rng(17)
cases = []
for runs, tasks in ((5, 7), (10, 3), (3, 1), (8, 4)):
    first = generator.normal(0.6, 0.3, size=(runs, tasks))
    second = generator.normal(0.5, 0.4, size=(runs + 1, tasks))
    second[0, 0] = first[0, 0]  # a tie
    thresholds = np.linspace(-0.5, 1.5, 9)
    (profile,) = library.create_performance_profile({"first": first}, thresholds, reps=2)[
        0
    ].values()
    cases.append(
        {
            "first": first.tolist(),
            "second": second.tolist(),
            "thresholds": thresholds.tolist(),
            "iqm": float(metrics.aggregate_iqm(first)),
            "profile": profile.tolist(),
            "improvement": float(metrics.probability_of_improvement(first, second)),
        }
    )
Path(__file__).with_name("rliable.json").write_text(json.dumps(cases, indent=1) + "\n", "utf-8")
