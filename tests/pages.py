"""Code blocks of the pages in docs/clients, run in order as a reader would run them."""

import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs" / "clients"

BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page):
    """The languages and texts of a page's blocks; python blocks without a break are one program."""
    found = BLOCK.findall((PAGES / f"{page}.md").read_text(encoding="utf-8"))
    joined = []
    for language, text in found:
        if joined and joined[-1][0] == language == "python":
            joined[-1][1] += text
        else:
            joined.append([language, text])
    return joined


def run_page(page, folder):
    """Run the blocks of a page in order, and return what they print."""
    environment = os.environ | {
        "OMP_NUM_THREADS": "1",  # the networks are small
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "PATH": os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]),
    }
    parts = blocks(page)
    assert parts
    printed = ""
    for language, text in parts:
        command = [sys.executable, "-c", text] if language == "python" else ["sh", "-ec", text]
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, check=False, text=True
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
        printed += done.stdout
    return printed
