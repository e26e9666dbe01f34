"""Numba's private names: who imports them, what is changed in them, and what runs without them."""

import ast
import re
import tomllib
from pathlib import Path

import pytest
from kernel_modules import halving, start

import mm_gym
from mm_gym.__main__ import main
from mm_gym.compiler import guard
from mm_gym.simulation import simulate

PACKAGE = Path(mm_gym.__file__).parent
REPOSITORY = PACKAGE.parent

PUBLIC = {"numba", "numba.extending", "numba.types"}
"""Modules of numba that its documentation tells users to import from."""


def private_names(file):
    """Yield what a file reads from numba's other modules."""
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        match node:
            case ast.Import(names):
                modules = [alias.name for alias in names]
            case ast.ImportFrom(module=module) if module:
                modules = [module]
            case ast.Attribute(ast.Name("numba"), "core" | "np" | "misc" | "parfors" as name):
                modules = [f"numba.{name}"]
            case _:
                continue
        yield from (name for name in modules if name.split(".")[0] == "numba")


def test_only_the_compiler_imports_private_names_of_numba():
    rooms = [PACKAGE, REPOSITORY / "agents", REPOSITORY / "benchmarks"]
    files = {file for room in rooms for file in room.rglob("*.py")}
    guilty = {file for file in files if set(private_names(file)) - PUBLIC}
    assert guilty
    assert {file.parent for file in guilty} == {PACKAGE / "compiler"}


def test_versions_that_were_tested_are_those_that_can_be_installed():
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))["project"]
    (oldest, newest) = ((major, minor) for major, minor in (guard.OLDEST, guard.NEWEST))
    allowed = f"numba>={oldest[0]}.{oldest[1]},<{newest[0]}.{newest[1] + 1}"
    assert allowed in project["dependencies"]


EVERYTHING = """
import pkgutil, sys
from importlib import import_module
from types import ModuleType
from gymnasium.error import DependencyNotInstalled
import numba.core.compiler, numba.core.caching, numba.core.registry, numba.extending
import numba.core.typed_passes, numba.core.untyped_passes, numba.core.runtime

@numba.njit
def other(x):
    return 2.0 * x

other(1.0)  # numba itself registers what it knows when it first compiles
names = sorted(name for name in sys.modules if name.split(".")[0] == "numba")

def found():
    things = {name: vars(sys.modules[name]) for name in names}
    classes = {
        f"{kind.__module__}.{kind.__qualname__}": kind
        for space in things.values() for kind in space.values()
        if isinstance(kind, type) and kind.__module__.split(".")[0] == "numba"
    }
    things |= {name: vars(kind) for name, kind in classes.items()}
    return {
        (place, name): value
        for place, space in things.items() for name, value in space.items()
        # modules imported meanwhile, and what pickling notes on a class
        if not isinstance(value, ModuleType) and name != "__slotnames__"
    }

before = found()
import mm_gym
for module in pkgutil.walk_packages(mm_gym.__path__, "mm_gym."):
    if not module.name.endswith("__main__"):
        try:
            import_module(module.name)
        except DependencyNotInstalled:  # an extra
            assert module.name in {"mm_gym.sb3", "mm_gym.torch"}
if len(sys.argv) > 1:
    import module
    assert module.quarter(2.0) == 0.5
after = found()
keys = before.keys() | after.keys()
print(len(before) > 10_000, sorted(k for k in keys if before.get(k) is not after.get(k)))
"""

MODULE = f"""{halving("inlined_kernel")}
from mm_gym.compiler.addresses import address_of, call, call_and_tell

@kernel
def count(x, y):
    return x + y

@kernel
def refuse(x):
    if x < 0:
        raise ValueError

@kernel
def through(one, other, x):
    return call(one, (x, 3)), call_and_tell(other, (x,)), call_and_tell(other, (-x,))

def called(x):
    return through(address_of(count, x, 3), address_of(refuse, x), x)
"""


@pytest.mark.parametrize("compiles", [[], ["too"]])
def test_importing_and_compiling_change_nothing_in_numba_for_other_code(tmp_path, compiles):
    (tmp_path / "module.py").write_text(MODULE)
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    out, err = start(EVERYTHING, *compiles, folder=tmp_path, **place).communicate()
    assert (out, err) == ("True []\n", "")


UNTESTED = "numba.__version__ = '0.99.1'"
WITHOUT = {
    "a method": "del numba.core.compiler.CompileResult._rebuild",
    "a class": "del numba.core.caching.UserProvidedCacheLocator",
    "a module": "sys.modules['numba.core.sigutils'] = None",
}

ALTERED = """
import sys, warnings
import numba, numba.core.compiler, numba.core.caching
{change}
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    import module
    from mm_gym.compiler import kernel
    {program}
for warning in caught:
    print(warning.category.__name__, warning.message, sep=": ")
"""

COST = (
    "; each process compiles its kernels anew, which takes a minute or more, runs them in one "
    "thread, and steps a single environment more slowly; install numba>=0.62,<0.69"
)


def lines_with(folder, change, program):
    """Lines that a program prints with a numba that is changed, and its warnings."""
    (folder / "module.py").write_text(MODULE)
    text = ALTERED.format(change=change, program=program.replace("\n", "\n    "))
    place = {"NUMBA_CACHE_DIR": str(folder / "cache")}
    out, err = start(text, folder=folder, **place).communicate()
    assert err == ""
    assert not (folder / "cache").exists(), "numba's own cache mixes closures of one name"
    return out.splitlines()


def test_version_that_was_not_tested_compiles_after_one_warning(tmp_path):
    program = "print(module.quarter(2.0), *module.called(4))"
    values, warning = lines_with(tmp_path, UNTESTED, program)
    reason = "numba 0.99.1 is none of the versions that were tested, 0.62 to 0.68"
    assert values == "0.5 7 False True"
    assert warning == f"RuntimeWarning: {reason}{COST}"


@pytest.mark.parametrize("change", WITHOUT.values(), ids=WITHOUT)
def test_without_a_private_name_kernels_compile_after_one_warning(tmp_path, change):
    value, warning = lines_with(tmp_path, change, "print(module.quarter(2.0))")
    assert value == "0.5"
    assert " lacks a private name: " in warning
    assert warning.endswith(COST)


INDISPENSABLE = {
    "a function": "del numba.core.typing.templates.make_intrinsic_template",
    "a module": "sys.modules['numba.core.cgutils'] = None",
}


@pytest.mark.parametrize("change", INDISPENSABLE.values(), ids=INDISPENSABLE)
def test_without_what_kernels_are_written_with_a_sentence_names_the_versions(tmp_path, change):
    program = "import sys, numba.core.typing.templates\n" + change + "\nimport mm_gym.lanes.simd"
    _, err = start(program, folder=tmp_path).communicate()
    name = change.rsplit(".", 1)[-1].split("'")[0]
    reason = rf"numba \S+ lacks a private name: .*{name}.*; install numba>=0\.62,<0\.69"
    assert re.fullmatch(f"ImportError: {reason}", err.splitlines()[-1])


MOTION = """
import numpy as np
from mm_gym import MovingMassEnv, MovingMassVectorEnv, SimulationError
env = MovingMassVectorEnv("mm_gym/CarriageForce-v0", 70, threads=2, max_episode_steps=9)
single = MovingMassEnv("mm_gym/CarriageForce-v0")
env.reset(seed=0)
single.reset(seed=0)
actions = np.linspace(-1.0, 1.0, 70, dtype=np.float32)[:, None]
for _ in range(5):
    env.step(actions)
    single.step(actions[0])
print(sha256(env.state.tobytes()).hexdigest(), env.state[0].tolist() == single.state.tolist())

@numba.njit
def law(observed, actions, limit):
    if observed[0, 0] > limit:
        raise ValueError
    actions[0] = -observed[0]

run = env.closed_loop(law, 1e9)
env.reset(seed=1)
print(run().returns.tolist())
run = env.closed_loop(law, -1e9)
env.reset(seed=1)
try:
    run()
except SimulationError as error:
    print(error)
"""


def test_motion_and_closed_loops_are_the_same_without_private_names(tmp_path):
    program = f"from hashlib import sha256\n{MOTION}".strip()
    *altered, _ = lines_with(tmp_path, UNTESTED, program)
    expected, err = start(f"import numba\n{program}").communicate()
    assert err == ""
    assert altered == expected.splitlines()
    assert altered[0].endswith(" True")
    assert altered[-1].startswith("controller: raised an error in compiled code")


def test_warming_fails_where_nothing_can_be_kept(monkeypatch, capsys):
    monkeypatch.setattr(simulate, "OBSTACLE", "numba 0.99.1 is new")
    assert main(["warm", "mm_gym/CarriageForce-v0"]) == 2
    assert capsys.readouterr().err == "error: nothing can be kept: numba 0.99.1 is new\n"
