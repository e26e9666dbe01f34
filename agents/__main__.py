"""Train and evaluate controllers: ``python -m agents COMMAND``.

``python -m agents COMMAND --help`` says what a command does, and which flags it takes.
"""

import ast
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

from agents.errors import FAILED, leave
from agents.training.runs import INTERRUPTED
from mm_gym.errors import suggest

FOLDER = Path(__file__).with_name("commands")


def commands() -> dict[str, str]:
    """Return what each command says of itself in its first line, by name; none is imported."""
    files = sorted(FOLDER.glob("[!_]*.py"))
    trees = {file.stem: ast.parse(file.read_text("utf-8")) for file in files}
    return {
        name.replace("_", "-"): (ast.get_docstring(tree) or "").splitlines()[0]
        for name, tree in trees.items()
    }


def usage() -> str:
    """Return the list of the commands."""
    found = commands()
    width = max(map(len, found))
    rows = "\n".join(f"  {name:{width}}  {text}" for name, text in found.items())
    text = f"usage: python -m agents COMMAND [...]\n\n{__doc__}\ncommands:\n{rows}"
    return text.replace("``", "")


def _imported(name: str) -> ModuleType:
    """Return the module of a command, whose imports can take seconds; Ctrl-C ends them."""
    try:
        return import_module(f"agents.commands.{name}")
    except KeyboardInterrupt:
        print("interrupted: give the same command again", file=sys.stderr)
        sys.exit(INTERRUPTED)


def main() -> None:
    """Run the command that is named, and end as it ends."""
    name, *words = sys.argv[1:] or ["--help"]
    known = commands()
    if name in {"-h", "--help"}:
        print(usage())
    elif name == "--version":
        print(f"mm-gym {version('mm-gym')}")
    elif name.replace("_", "-") in known:
        sys.argv = [f"python -m agents {name}", *words]
        leave(_imported(name.replace("-", "_")).main())
    else:
        near = suggest(name, known)
        print(f"error: command: got {name!r}{near}; allowed: {', '.join(known)}", file=sys.stderr)
        sys.exit(FAILED)


if __name__ == "__main__":
    own = __spec__.name.rpartition(".")[2]
    sys.argv[1:1] = [] if own == "__main__" else [own]
    main()
