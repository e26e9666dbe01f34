"""The first start: processes that start at once compile once, and a terminal is told of it."""

import io
import signal
import sys
import warnings

import numba
import numpy as np
import pytest
from kernel_modules import halving, loaded, start
from numba.core.codegen import JITCPUCodegen

from mm_gym import compile_scene, load_scene
from mm_gym.__main__ import main
from mm_gym.compiler import notice
from mm_gym.compiler.dispatcher import KernelDispatcher
from mm_gym.compiler.lock import locked
from mm_gym.simulation import simulate as warm_module
from mm_gym.simulation.lanes import Lanes
from mm_gym.step import control_step, episodes
from mm_gym.tasks import path_of

TASK = "mm_gym/CarriageForce-v0"

MODULE = f"""{halving()}
@kernel
def eighth(x):
    return half(half(half(x)))
"""

COMPILED_HERE = """
from mm_gym.compiler.dispatcher import OnceDispatcher

compiled = 0

def counted(self, kinds, made=OnceDispatcher._announced_and_made):
    global compiled
    compiled += 1
    return made(self, kinds)

OnceDispatcher._announced_and_made = counted
"""
"""Counts the kernels whose machine code a process makes."""

QUARTER = f"{COMPILED_HERE}\nimport module\nprint(module.quarter(2.0), compiled)"

APART = """
from numba.core import caching
for place in (caching.InTreeCacheLocator, caching.UserWideCacheLocator):
    place.get_cache_path = lambda _: "~"  # none: other tests' code may be there
"""
"""Leaves the folder of `NUMBA_CACHE_DIR` as the only one."""

STEP = f"""{COMPILED_HERE}
import gymnasium, mm_gym
env = gymnasium.make("{TASK}")
env.reset(seed=0)
env.step(env.action_space.sample())
print(compiled)
"""

TWO_FRAMES = {"sensors.history": 2}
"""A change that makes a scene one that is not among the simplest, and moves nothing."""

HOLD = """
import sys
from pathlib import Path
from mm_gym.compiler.lock import locked
with locked(Path(sys.argv[1])) as is_held:
    print(is_held, flush=True)
    sys.stdin.read()
"""

COUNT = """
import sys
from pathlib import Path
from mm_gym.compiler.lock import locked
number = Path(sys.argv[2])
for _ in range(20):
    with locked(Path(sys.argv[1])):
        before = int(number.read_text())
        number.write_text(str(before + 1))
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    return lambda: loaded(path, monkeypatch)


def test_lock_keeps_processes_apart_and_leaves_nothing_behind(tmp_path):
    number = tmp_path / "number"
    number.write_text("0")
    processes = [start(COUNT, tmp_path / "lock", number) for _ in range(3)]
    assert [process.communicate() for process in processes] == [("", "")] * 3
    assert number.read_text() == "60"
    assert list(tmp_path.iterdir()) == [number]


def test_lock_of_a_killed_process_is_free(tmp_path):
    path = tmp_path / "lock"
    process = start(HOLD, path)
    assert process.stdout.readline() == "True\n"
    with locked(path, patience=0.1) as is_held:
        assert not is_held, "the other process has it; this one goes on without"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert path.exists()
    with locked(path, patience=0.0) as is_held:
        assert is_held
    assert not path.exists()


def test_without_a_place_for_a_lock_the_work_is_done_without(tmp_path):
    (tmp_path / "file").touch()
    with locked(tmp_path / "file" / "lock") as is_held:
        assert not is_held


def test_processes_that_start_at_once_compile_once(module, tmp_path):
    module()
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    processes = [start(QUARTER, folder=tmp_path, **place) for _ in range(4)]
    results = [process.communicate() for process in processes]
    assert sorted(results) == [("0.5 0\n", "")] * 3 + [("0.5 1\n", "")]


def test_ten_workers_that_start_at_once_compile_what_one_would(tmp_path):
    alone = start(APART + STEP, NUMBA_CACHE_DIR=str(tmp_path / "one")).communicate()[0]
    processes = [start(APART + STEP, NUMBA_CACHE_DIR=str(tmp_path / "ten")) for _ in range(10)]
    results = [process.communicate() for process in processes]
    assert [err for _, err in results] == [""] * 10
    # A control step, and what seeds a lane, starts it and shows its first frame.
    assert sum(int(out) for out, _ in results) == int(alone) == 4


@pytest.mark.parametrize(
    ("changes", "is_simple"),
    [
        ({}, True),
        (TWO_FRAMES, False),
        ({"sensors.noise": {"carriage_velocity": 0.01}}, False),
        ({"actuation.force.rate_limit": 1000.0}, False),
        ({"excitation": [{"kind": "harmonic", "amplitude": 0.0, "frequency": 9.0}]}, False),
        ({"excitation": [{"kind": "impulse", "size": 1e-9, "time": 0.01}]}, False),
    ],
)
def test_the_simplest_scenes_do_without_the_kernels_of_the_others(changes, is_simple):
    plant = compile_scene(load_scene(TASK).replace(**changes))
    other = control_step.advance if plant.support.sampled else control_step.advance_unexcited
    assert Lanes(plant, 1)._advance is (plant.entries.advance_simply if is_simple else other)


def test_steps_of_the_simplest_scenes_are_those_of_the_others():
    simple = load_scene(TASK)
    both = [Lanes(compile_scene(scene), 5) for scene in (simple, simple.replace(**TWO_FRAMES))]
    actions = np.random.default_rng(0).uniform(-1.5, 1.5, (40, 5))
    for lanes in both:
        lanes.seed(3)
        lanes.restart()
    for action in actions:
        assert both[0].advance(action) == both[1].advance(action) == 0
        np.testing.assert_array_equal(both[0].values[:4], both[1].values[:4])
        np.testing.assert_array_equal(both[0].rewards, both[1].rewards)
        np.testing.assert_array_equal(both[0].observed, both[1].observed[4:])


def test_only_what_python_calls_becomes_machine_code(module):
    kernels = module()
    assert kernels.quarter(2.0) == 0.5
    assert len(kernels.quarter.overloads) == 1
    assert not kernels.half.overloads
    assert kernels.half(2.0) == 1.0, "Python may call it nevertheless"


def test_code_that_kernels_link_is_loaded(module):
    assert module().quarter(2.0) == 0.5
    kernels = module()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(kernels.half), "_lower", refused_but_for(kernels.eighth))
        assert kernels.eighth(2.0) == 0.25
    assert kernels.half(2.0) == 1.0
    assert module().half(2.0) == 1.0


def refused_but_for(kernel, lower=KernelDispatcher._lower):
    def only(self, kinds):
        assert self is kernel, "it is on disk"
        return lower(self, kinds)

    return only


def test_code_made_for_one_processor_is_not_used_on_another(module, monkeypatch):
    def hits():
        kernels = module()
        assert kernels.quarter(2.0) == 0.5
        return sum(kernels.quarter.stats.cache_hits.values())

    assert [hits(), hits()] == [0, 1]
    here = JITCPUCodegen.magic_tuple
    monkeypatch.setattr(JITCPUCodegen, "magic_tuple", lambda self: (*here(self)[:1], "another", ""))
    assert hits() == 0


class Terminal(io.StringIO):
    """A stream that says that somebody reads it."""

    def isatty(self):
        return True


def test_terminal_is_told_once_that_and_for_how_long_kernels_are_compiled(module, monkeypatch):
    monkeypatch.setattr(notice, "_announced", [])
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    kernels = module()
    kernels.quarter(2.0)
    kernels.half(2.0)
    words = terminal.getvalue().split()
    assert words[:4] == ["mm_gym:", "compiling", "once,", "about"]
    assert words[5:] == ["s"]


def test_pipe_is_told_nothing(module, monkeypatch):
    monkeypatch.setattr(notice, "_announced", [])
    stream = io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    assert module().quarter(2.0) == 0.5
    assert stream.getvalue() == ""


def test_estimate_counts_every_kernel_that_is_called_and_none_twice(module):
    kernels = module()
    one, both = notice.seconds(kernels.half), notice.seconds(kernels.quarter)
    sizes = [len(kernel.py_func.__code__.co_code) for kernel in (kernels.half, kernels.quarter)]
    assert one == pytest.approx(notice.SECONDS_PER_BYTE * sizes[0], rel=1e-12)
    assert both == pytest.approx(notice.SECONDS_PER_BYTE * sum(sizes), rel=1e-12)
    assert notice.seconds(kernels.half, kernels.quarter) == both
    # those in other modules too, that it names by their modules
    assert notice.seconds(episodes.start) > 5.0 * notice.seconds(episodes.place_of)


def test_after_warming_a_process_compiles_nothing_and_does_not_prepare_to(capsys):
    assert main(["warm", TASK]) == 0
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith(f"1/1 {TASK}: ")
    assert out[1].endswith(" s in total")
    # What numba imports before it compiles, and SciPy's linear algebra with it, takes 0.15 s.
    loaded = "import sys\nprint({'numba.np.arraymath', 'scipy.linalg'} & set(sys.modules))"
    assert start(STEP + loaded).communicate() == ("0\nset()\n", "")


def test_warming_takes_files_and_reports_what_is_no_scene(capsys):
    assert main(["warm", str(path_of(TASK))]) == 0
    assert main(["warm", "mm_gym/CarriageForse-v0"]) == 2
    assert "did you mean 'mm_gym/CarriageForce-v0'?" in capsys.readouterr().err


def test_warming_fails_where_compiled_code_cannot_be_kept(monkeypatch, capsys):
    def warned(*_):
        warnings.warn(f"{notice.NOT_KEPT}: no space", RuntimeWarning, stacklevel=2)
        return Lanes(*_)

    monkeypatch.setattr(warm_module, "Lanes", warned)
    assert main(["warm", TASK]) == 2
    assert capsys.readouterr().err == f"error: {notice.NOT_KEPT}: no space\n"


WHILE_COMPILING = """
import gc
from numba.core.bytecode import FunctionIdentity
from numba.core.registry import cpu_target
def state():
    return FunctionIdentity._unique_ids, gc.isenabled(), dict(vars(cpu_target.typing_context))
gc.enable()
numbers, _, before = state()
import module
print(module.quarter(2.0))
now, collects, after = state()
print(now is numbers, collects, before.keys() == after.keys())
"""


def test_what_compiling_changes_in_a_process_is_as_before_for_other_code(module, tmp_path):
    module()
    place = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    told = start(WHILE_COMPILING, folder=tmp_path, **place).communicate()
    assert told == ("0.5\nTrue True True\n", "")
