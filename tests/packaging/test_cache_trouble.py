"""Kernels run whatever the state of their cache: missing, full, damaged, or written to at once."""

import errno

import numba
import pytest
from kernel_modules import loaded, start

from mm_gym.compiler import cache, jit

MODULE = """
from mm_gym.compiler.jit import kernel

@kernel
def twice(x):
    return 2.0 * x

@kernel
def thrice(x):
    return 3.0 * x
"""

PROGRAM = """
import module
print(module.twice(1.5), module.thrice(1.5))
"""

CHOICE = "set NUMBA_CACHE_DIR to choose another folder"


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """Return a function that makes the kernel anew, as a process does that finds its cache."""
    monkeypatch.setattr(cache, "_warned", [])
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "module.py"
    path.write_text(MODULE)
    module = loaded(path, monkeypatch)
    return lambda: jit.kernel(module.twice.py_func)


def hits(kernel):
    assert kernel(1.5) == 3.0
    return sum(kernel.stats.cache_hits.values())


def files(folder, suffix):
    return sorted(folder.rglob(f"*{suffix}"))


def test_without_a_folder_to_write_to_kernels_run_after_one_warning(tmp_path):
    # Permissions would not keep root out, as in a container; a file in the folder's place does.
    (tmp_path / "module.py").write_text(MODULE)
    (tmp_path / "__pycache__").touch()
    nowhere = str(tmp_path / "module.py" / "x")
    places = dict.fromkeys(("HOME", "XDG_CACHE_HOME", "NUMBA_CACHE_DIR"), nowhere)
    process = start(PROGRAM, folder=tmp_path, **places)
    out, err = process.communicate()
    assert (process.returncode, out) == (0, "3.0 4.5\n"), err
    assert err.count("Warning") == 1
    assert CHOICE in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["__pycache__", "module.py"]


def test_processes_at_once_fill_one_cache(tmp_path):
    (tmp_path / "module.py").write_text(MODULE)
    places = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    processes = [start(PROGRAM, folder=tmp_path, **places) for _ in range(4)]
    assert [process.communicate() for process in processes] == [("3.0 4.5\n", "")] * 4
    assert len(files(tmp_path / "cache", ".nbi")) == len(files(tmp_path / "cache", ".nbc")) == 2


def test_without_a_home_no_folder_is_made_where_the_process_runs(twice, tmp_path, monkeypatch):
    # As os.path.expanduser leaves it for a user whom the system does not know.
    monkeypatch.setenv("XDG_CACHE_HOME", "~/.cache")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(cache, "_prepare", _refused)
    monkeypatch.chdir(tmp_path)
    with pytest.warns(RuntimeWarning, match=CHOICE):
        assert hits(twice()) == 0
    assert not (tmp_path / "~").exists()


def _refused(_):
    raise PermissionError(errno.EACCES, "Permission denied")


def test_folder_filled_before_it_was_closed_is_used_without_a_warning(twice, tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    assert hits(twice()) == 0
    assert files(tmp_path / "__pycache__", ".nbc")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "module.py" / "x"))
    monkeypatch.setattr(cache, "_prepare", _refused)
    assert hits(twice()) == 1


def test_full_disk_leaves_kernels_running_and_nothing_half_written(twice, tmp_path):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))  # Python ignores the signal
    try:
        with pytest.warns(RuntimeWarning, match=CHOICE) as caught:
            assert [hits(twice()), hits(twice())] == [0, 0]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert len(caught) == 1
    assert not [path for path in (tmp_path / "cache").rglob("*") if path.is_file()]
    assert [hits(twice()), hits(twice())] == [0, 1]


def truncated(content):
    return content[: len(content) // 2]


def emptied(content):
    return content[:0]


def overwritten(content):
    middle = len(content) // 2
    return content[:middle] + bytes(64) + content[middle + 64 :]


@pytest.mark.parametrize("damage", [truncated, emptied, overwritten])
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_damaged_cache_heals_after_one_warning(twice, tmp_path, suffix, damage):
    assert [hits(twice()), hits(twice())] == [0, 1]
    (path,) = files(tmp_path / "cache", suffix)
    path.write_bytes(damage(path.read_bytes()))
    with pytest.warns(RuntimeWarning, match=rf"damaged: .*{suffix}; {CHOICE}") as caught:
        assert hits(twice()) == 0
    assert len(caught) == 1
    assert hits(twice()) == 1


def test_folder_in_the_place_of_an_entry_is_no_failure(twice, tmp_path):
    assert hits(twice()) == 0
    (path,) = files(tmp_path / "cache", ".nbi")
    path.unlink()
    path.mkdir()
    with pytest.warns(RuntimeWarning, match=CHOICE):
        assert hits(twice()) == 0


def entries(folder, stamp):
    return cache._Entries(str(folder), "kernel", stamp)


def test_code_of_older_sources_is_not_taken_for_that_which_a_full_disk_kept_out(
    tmp_path, monkeypatch
):
    entries(tmp_path, "old").save("key", "old code")
    with monkeypatch.context() as patch:
        patch.setattr(cache._Entries, "_save_data", _refused_entry)
        with pytest.raises(OSError, match="space"):
            entries(tmp_path, "new").save("key", "new code")
    assert entries(tmp_path, "new").load("key") is None
    entries(tmp_path, "new").save("key", "new code")
    assert entries(tmp_path, "new").load("key") == "new code"


def _refused_entry(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


class Gone:
    """What an older version had, and this one has no module for."""

    def __reduce__(self):
        return __import__, ("a_module_that_is_gone",)


def test_files_of_older_sources_are_passed_over_though_they_name_what_is_gone(tmp_path):
    entries(tmp_path, "older").save("arguments", Gone())
    entries(tmp_path, "older")._write(str(tmp_path / "kernel.nbi"), {"arguments": Gone()})
    present = entries(tmp_path, "present")
    assert present.load("arguments") is None
    present.save("arguments", "code")
    assert present.load("arguments") == "code"


def test_code_for_other_arguments_is_not_taken_when_two_processes_number_theirs_alike(tmp_path):
    one, other = entries(tmp_path, "stamp"), entries(tmp_path, "stamp")
    other.save("other", "other code")
    # `one` has read the index before, and writes its files before the other's index arrives.
    index = other._load_index()
    one._save_index({})
    one.save("one", "code")
    other._save_index(index)
    assert other.load("other") is None


CLOSURES = """
from numba.extending import overload
from mm_gym.compiler.jit import kernel

def doubled(x): ...

def tripled(x): ...

def multiplied(function, factor):
    @overload(function)
    def _(x):
        return lambda x: factor * x

multiplied(doubled, 2.0)
multiplied(tripled, 3.0)

@kernel
def twice(x):
    return doubled(x)

@kernel
def thrice(x):
    return tripled(x)

@kernel
def first(x):
    return twice(x)

@kernel
def second(x):
    return thrice(x)

@kernel
def both(x):
    return twice(x), thrice(x)
"""


def test_closures_of_one_name_stay_apart_though_two_processes_number_them_alike(tmp_path):
    (tmp_path / "module.py").write_text(CLOSURES)

    def printed(name):
        program = f"import module; print(module.{name}(1.0))"
        process = start(program, folder=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        out, err = process.communicate()
        assert process.returncode == 0, err
        return out.strip()

    assert [printed(name) for name in ("first", "second", "both")] == ["2.0", "3.0", "(2.0, 3.0)"]


ARRAYS = """
import numpy as np
from mm_gym.compiler.jit import kernel

@kernel
def ones(size):
    return np.ones(size)

@kernel
def length(size):
    return ones(size).size

@kernel
def total(size):
    return ones(size).sum()
"""


@pytest.mark.parametrize("first", [["length", "ones"], ["ones", "length"]])
@pytest.mark.parametrize("second", [["total", "ones"], ["ones", "total"]])
def test_array_of_a_kernel_that_others_link_is_returned_in_any_order_of_processes(
    tmp_path, first, second
):
    """A wrapper finds the array's type among the objects that belong to the kernel's name."""
    (tmp_path / "module.py").write_text(ARRAYS)
    for names in (first, second, first):
        program = "import module\n" + "\n".join(f"print(module.{name}(3))" for name in names)
        process = start(program, folder=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache"))
        out, err = process.communicate()
        assert process.returncode == 0, err
        results = {"length": "3", "total": "3.0", "ones": "[1. 1. 1.]"}
        assert out.splitlines() == [results[name] for name in names]
