"""Compiled code runs as who loads it: only what the user and root can write is loaded."""

import os
import time

import numba
import pytest
from kernel_modules import loaded, start

from mm_gym.compiler import cache, jit
from mm_gym.compiler.trust import UntrustedError, check_folder

ANOTHER_USER = 12345

PATIENCE = 60.0  # time after which a process that hangs is given up [s]; it takes less than two

MODULE = """
from mm_gym.compiler.jit import kernel

@kernel
def twice(x):
    return 2.0 * x

@kernel
def thrice(x, y):
    return 3.0 * x
"""

PLANTED = """
import pickle
from pathlib import Path
import module, numba
from mm_gym.compiler import cache

class Attack:
    def __reduce__(self):
        return Path.touch, (Path("attacked"),)

(entries,) = [files for place, files in cache.KernelCache(module.twice.py_func)._files.items()
              if str(place).startswith(numba.config.CACHE_DIR)]
cache._prepare(Path(entries._cache_path))
entries._save_index(Attack())
"""

CALL = """
import module
print(module.twice(1.5))
"""


def printed(program, folder, **environment):
    """What a program prints, and what it warns of."""
    process = start(
        program, folder=folder, NUMBA_CACHE_DIR=str(folder / "cache" / "named"), **environment
    )
    out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    return out, err


@pytest.fixture
def planted(tmp_path):
    """Return the index of a kernel, which runs code when it is loaded; no other cache is there."""
    (tmp_path / "module.py").write_text(MODULE)
    (tmp_path / "cache").mkdir(mode=0o755)
    printed(PLANTED, tmp_path)
    (index,) = tmp_path.rglob("*.nbi")
    return index


def made_writable_for_all(path):
    path.chmod(0o777 if path.is_dir() else 0o666)


def made_writable_for_a_group(path):
    os.chown(path, -1, ANOTHER_USER)
    path.chmod(0o775 if path.is_dir() else 0o664)


def given_to_another_user(path):
    os.chown(path, ANOTHER_USER, -1)


CHANGES = [made_writable_for_all]
if os.geteuid() == 0:  # nobody else may give files away
    CHANGES += [made_writable_for_a_group, given_to_another_user]


def test_planted_code_that_only_the_user_could_write_would_run(planted, tmp_path):
    """Else the tests below show nothing."""
    assert planted.exists()
    process = start(CALL, folder=tmp_path, NUMBA_CACHE_DIR=str(tmp_path / "cache" / "named"))
    process.communicate(timeout=PATIENCE)
    assert (tmp_path / "attacked").exists()


@pytest.mark.parametrize("change", CHANGES)
def test_file_that_others_can_write_is_refused_with_one_warning_and_replaced(
    planted, tmp_path, change
):
    change(planted)
    mode, owner = planted.stat().st_mode & 0o7777, planted.stat().st_uid
    out, err = printed(CALL, tmp_path)
    assert out == "3.0\n"
    assert err.count("Warning") == 1
    assert f"can write {planted} (owner {owner}, mode {mode:04o})" in err
    assert "set NUMBA_CACHE_DIR" in err
    assert printed(CALL, tmp_path) == ("3.0\n", "")
    assert not (tmp_path / "attacked").exists()


@pytest.mark.parametrize("level", [0, 1])
def test_folder_that_others_can_change_is_refused_with_one_warning(planted, tmp_path, level):
    folder = planted.parents[2 * level]
    made_writable_for_all(folder)
    content = planted.read_bytes()
    out, err = printed(CALL, tmp_path)
    assert out == "3.0\n"
    assert err.count("Warning") == 1
    assert f"can write {folder} (owner" in err
    assert planted.read_bytes() == content
    assert not (tmp_path / "attacked").exists()
    assert list((tmp_path / "__pycache__").glob("*.nbi")), "another folder has the code"


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("level", [0, 1])
def test_every_folder_on_the_way_is_checked(tmp_path, change, level):
    folder = tmp_path / "outer" / "inner"
    folder.mkdir(parents=True)
    check_folder(folder)
    changed = (folder, *folder.parents)[level]
    change(changed)
    with pytest.raises(UntrustedError, match=rf"can write {changed} \(owner"):
        check_folder(folder)


def test_sticky_bit_makes_a_parent_safe_and_not_the_folder_of_the_files(tmp_path):
    """As in /tmp, where everybody may plant, and nobody may rename what is another's."""
    folder = tmp_path / "shared" / "own"
    folder.mkdir(parents=True, mode=0o755)
    folder.parent.chmod(0o1777)
    check_folder(folder)
    with pytest.raises(UntrustedError, match=r"shared \(owner"):
        check_folder(folder.parent)


def test_link_is_followed_through_what_only_the_user_can_change(tmp_path):
    (tmp_path / "own" / "cache").mkdir(parents=True, mode=0o755)
    (tmp_path / "link").symlink_to(tmp_path / "own")
    (tmp_path / "second").symlink_to("link/cache")
    check_folder(tmp_path / "second")
    (tmp_path / "own").chmod(0o777)
    with pytest.raises(UntrustedError, match="own"):
        check_folder(tmp_path / "second")


def test_ring_of_links_is_no_folder(tmp_path):
    (tmp_path / "ring").symlink_to("ring")
    with pytest.raises(OSError, match="symbolic links"):
        check_folder(tmp_path / "ring")


def test_link_in_the_place_of_a_file_is_refused(planted, tmp_path):
    planted.rename(tmp_path / "elsewhere")
    planted.symlink_to(tmp_path / "elsewhere")
    out, err = printed(CALL, tmp_path)
    assert (out, err.count("Warning")) == ("3.0\n", 1)
    assert f"{planted} is a link" in err
    assert not planted.is_symlink()
    assert not (tmp_path / "attacked").exists()


def filled(folder):
    """The files of a module that one process has filled a cache with."""
    (folder / "module.py").write_text(MODULE)
    printed("import module; module.twice(1.0); module.thrice(1.0, 1.0)", folder)
    return sorted((folder / "cache").rglob("*.nb?"))


@pytest.mark.parametrize("suffix", [".nbi", ".nbc", ".lock"])
def test_pipe_in_the_place_of_a_file_does_not_hang(tmp_path, suffix):
    for path in filled(tmp_path):
        if path.suffix == suffix:
            path.unlink()
            os.mkfifo(path)
        if suffix == ".lock":
            path.unlink()
            name = path.name.removesuffix(path.suffix).removesuffix(".1")
            lock = path.with_name(f"{name}.lock")
            if not lock.exists():
                os.mkfifo(lock)
    begin = time.monotonic()
    out, err = printed(CALL, tmp_path)
    assert out == "3.0\n"
    assert ("is no regular file" in err) == (suffix != ".lock")
    assert time.monotonic() - begin < PATIENCE


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_files_exchanged_between_kernels_are_compiled_anew(tmp_path, suffix):
    one, other = [path for path in filled(tmp_path) if path.suffix == suffix]
    one.rename(tmp_path / "kept")
    other.rename(one)
    (tmp_path / "kept").rename(other)
    program = "import module; print(module.twice(1.5), module.thrice(1.5, 0.0))"
    assert printed(program, tmp_path) == ("3.0 4.5\n", "")


def test_code_is_kept_by_a_user_whose_files_all_can_write(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "_warned", [])
    (tmp_path / "module.py").write_text(MODULE)
    module = loaded(tmp_path / "module.py", monkeypatch)
    before = os.umask(0)
    try:
        counts = []
        for _ in range(2):
            kernel = jit.kernel(module.twice.py_func)
            assert kernel(1.5) == 3.0
            counts.append(sum(kernel.stats.cache_hits.values()))
    finally:
        os.umask(before)
    assert counts == [0, 1]
    assert cache._warned == []
