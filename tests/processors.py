"""Run the tests as other processors would, and on a busy one: ``make test-processors``.

``python tests/processors.py NAME ...`` runs some of the settings only. Each setting prints one
line; all that pytest said of it is in .processors/NAME.txt.
"""

import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).parent.parent
OUTPUT = ROOT / ".processors"
WORDS = "-m pytest -n auto --dist loadfile --no-loadscope-reorder -q -m"
TESTS = [*WORDS.split(), "not slow and not browser"]
BUSY = 8
SETTINGS = {
    "plain": {},
    # Empty features: those that the name implies, and not also this processor's.
    "generic": {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""},
    "x86-64-v3": {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""},
    # The kernels of OpenBLAS sum in other orders. A processor without AVX-512 takes Haswell's.
    "openblas-prescott": {"OPENBLAS_CORETYPE": "Prescott"},
    "openblas-nehalem": {"OPENBLAS_CORETYPE": "Nehalem"},
    "openblas-sandybridge": {"OPENBLAS_CORETYPE": "Sandybridge"},
    "openblas-haswell": {"OPENBLAS_CORETYPE": "Haswell"},
    "numpy-baseline": {"NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"},
    "busy": {},
    "busy-again": {},
}


def result(name):
    """Run the tests in a setting; return pytest's exit code."""
    began, file = time.monotonic(), OUTPUT / f"{name}.txt"
    with ExitStack() as stack, file.open("w", encoding="utf-8") as output:
        for _ in range(BUSY if name.startswith("busy") else 0):
            busy = subprocess.Popen([sys.executable, "-c", "while True: pass"])
            stack.callback(busy.wait)
            stack.callback(busy.kill)
        done = subprocess.run(
            [sys.executable, *TESTS],
            cwd=ROOT,
            env=os.environ | SETTINGS[name],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
    lines = file.read_text("utf-8").splitlines() or ["no output"]
    failed = [line for line in lines if line.startswith(("FAILED", "ERROR"))]
    line = f"{name}: exit code {done.returncode}, {time.monotonic() - began:.0f} s: {lines[-1]}"
    print(line, *failed, sep="\n", flush=True)  # noqa: T201 - scripts talk to their reader
    return done.returncode


def main():
    names = sys.argv[1:] or list(SETTINGS)
    unknown = [name for name in names if name not in SETTINGS]
    if unknown:
        sys.exit(f"unknown setting {unknown[0]!r}; allowed: {', '.join(SETTINGS)}")
    OUTPUT.mkdir(exist_ok=True)
    codes = [result(name) for name in names]
    sys.exit(0 if not any(codes) else 1)


if __name__ == "__main__":
    main()
