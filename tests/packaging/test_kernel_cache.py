"""Compiled kernels on disk are those of the sources, helpers in other files included."""

import ast
import itertools
import os
import shutil
import subprocess
import sys

from numba import types
from source_imports import PACKAGE, file_of, imported_by

from mm_gym.compiler.cache import closed_over, sources
from mm_gym.compiler.jit import inlined_kernel
from mm_gym.law.interface import LINE, Law, law_of
from mm_gym.methods import METHODS
from mm_gym.methods.runge_kutta import method as runge_kutta
from mm_gym.methods.splitting import method as splitting
from mm_gym.step import control_step

DECORATORS = ("kernel", "borrowing_kernel", "inlined_kernel", "sharing_kernel")

PROGRAM = """
import numpy as np
import mm_gym
from mm_gym.step.episodes import draw_row
assert mm_gym.__file__.startswith({root!r}), mm_gym.__file__
lanes, streams = np.zeros((1, 4)), np.zeros((2, 4), np.uint64)
draw_row(lanes, 0, -1.0, 1.0, streams, np.arange(4))
print(*lanes[0])
"""
"""Of the kernels that Python calls, one that takes a second to compile, not ten."""

REPLACEMENT = '''

@borrowing_kernel
def uniform(streams, i):
    """Return the middle of every range."""
    return 0.5
'''


def test_editing_a_helper_in_another_file_takes_effect(tmp_path):
    package = tmp_path / "mm_gym"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {
        name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"
    } | {"PYTHONPATH": str(tmp_path)}

    def start():
        program = PROGRAM.format(root=str(tmp_path))
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            cwd=tmp_path,
            capture_output=True,
            check=False,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return [float(value) for value in done.stdout.split()]

    drawn = start()
    assert drawn[0] != 0.0
    assert list(package.rglob("*.nbi")), "kernels are cached next to their sources"
    assert start() == drawn
    helper = package / "lanes" / "random.py"
    helper.write_text(helper.read_text("utf-8") + REPLACEMENT, "utf-8")
    assert start() == [0.0, 0.0, 0.0, 0.0]


def test_package_that_cannot_be_written_to_is_cached_elsewhere_by_processes_at_once(tmp_path):
    package, cache = tmp_path / "mm_gym", tmp_path / "cache"
    shutil.copytree(PACKAGE, package, ignore=shutil.ignore_patterns("__pycache__"))
    # Permissions would not keep root out, as in a container; a file in the directory's place does.
    for folder in {file.parent.relative_to(PACKAGE) for file in sources()}:
        (package / folder / "__pycache__").touch()
    environment = {
        name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"
    } | {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(cache)}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROGRAM.format(root=str(tmp_path))],
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    results = [process.communicate() for process in processes]
    assert [process.returncode for process in processes] == [0, 0], results
    assert results[0][0] == results[1][0] != ""
    assert list(cache.rglob("*.nbi")), "kernels are cached in the user's own directory"
    assert not list(package.rglob("*.nbi"))


def closures_of(kernel):
    """The kernels that a kernel closes over, those that they close over, and it."""
    function = getattr(kernel, "py_func", kernel)
    if isinstance(function, Law):
        return set()
    inner = (closures_of(cell.cell_contents) for cell in function.__closure__ or ())
    return {function}.union(*inner)


def key_of(kernel):
    return kernel.__module__, kernel.__qualname__, closed_over(kernel)


def test_kernels_of_one_key_in_the_cache_have_the_same_code():
    """Else one is found in place of the other."""
    every = [method.entries for method in METHODS if hasattr(method, "entries")]
    for facts in itertools.product((False, True), repeat=3):
        names = ("has_friction", "is_finite", "is_excited")
        law = law_of(LINE, **dict(zip(names, facts, strict=True)))
        every += [runge_kutta.entries_with(law, LINE), splitting.entries_with(law)]
    shared = (control_step.advance, control_step.run)
    shared += (control_step.advance_unexcited, control_step.run_unexcited)
    entries = {entry for one in (*every, shared) for entry in one if callable(entry)}
    kernels = set().union(*(closures_of(entry) for entry in entries))
    keys = {key_of(kernel) for kernel in kernels}
    # One of each method and law for each of the two kinds of excitation, and what crosses impulses.
    assert len({(key_of(kernel), kernel.__code__) for kernel in kernels}) == len(keys)
    assert len(keys) > 4 * len(METHODS)


def kernels_of(file):
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.FunctionDef) and any(
            ast.unparse(decorator) in DECORATORS for decorator in node.decorator_list
        ):
            yield node


def test_every_module_that_kernels_are_compiled_from_is_among_the_sources():
    """Else an edit of it would leave stale machine code in the cache."""
    known = set(sources())
    kernels = {file for file in PACKAGE.rglob("*.py") if any(kernels_of(file))}
    assert len(kernels) > 20
    assert kernels <= known
    imported = {file_of(module) for file in known for module in imported_by(file)}
    assert imported <= known


WITHOUT_PASSES = (
    *(ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp, ast.Lambda),
    *(ast.With, ast.Yield, ast.YieldFrom, ast.Raise, ast.Try, ast.FunctionDef),
)


def test_kernels_contain_nothing_for_which_their_compiler_has_no_pass():
    kernels = [kernel for file in sources() for kernel in kernels_of(file)]
    assert len(kernels) > 100
    for kernel in kernels:
        inside = [type(node) for node in ast.walk(kernel) if node is not kernel]
        assert not set(inside).intersection(WITHOUT_PASSES), kernel.name


@inlined_kernel
def _tripled(number):
    return 3 * number


def test_a_kernel_is_made_once_for_all_constants():
    for constant in (5, 7):
        _tripled.get_call_template((types.literal(constant),), {})
    assert list(_tripled._intermediate) == [(types.int64,)]
