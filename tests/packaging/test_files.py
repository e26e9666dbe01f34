"""Files are written whole, and nothing that is there is lost for it."""

import os
import socket
import stat
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

import mm_gym
from mm_gym.errors import SceneError
from mm_gym.files import check_outputs, write_bytes, write_text

NEW = "new\n" * 1000


@pytest.fixture
def old(tmp_path):
    path = tmp_path / "old.csv"
    path.write_text("old\n")
    return path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o755, 0o666])
def test_replaced_file_keeps_its_mode_and_owner(old, mode):
    old.chmod(mode)
    with suppress(PermissionError):
        os.chown(old, 1, 1)
    before = old.stat()
    write_text(old, NEW)
    after = old.stat()
    assert old.read_text() == NEW
    assert (after.st_mode, after.st_uid, after.st_gid) == (
        before.st_mode,
        before.st_uid,
        before.st_gid,
    )


@pytest.mark.parametrize("mask", [0o022, 0o077, 0o002])
def test_new_file_has_the_mode_that_the_umask_leaves(tmp_path, mask):
    before = os.umask(mask)
    try:
        write_text(tmp_path / "new.csv", NEW)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new.csv").stat().st_mode) == 0o666 & ~mask


def test_missing_folders_are_created(tmp_path):
    write_text(tmp_path / "a" / "b" / "new.csv", NEW)
    assert names(tmp_path / "a" / "b") == ["new.csv"]


def test_link_stays_and_its_target_is_replaced_whole(tmp_path, old):
    inode = old.stat().st_ino
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "first").symlink_to(Path("..") / "second")
    (tmp_path / "second").symlink_to("old.csv")
    write_text(tmp_path / "folder" / "first", NEW)
    assert old.read_text() == NEW
    assert old.stat().st_ino != inode, "the file is written next to it and renamed"
    assert (tmp_path / "folder" / "first").is_symlink()
    assert (tmp_path / "second").is_symlink()
    assert not old.is_symlink()


def test_link_to_a_missing_file_stays_and_the_file_is_created(tmp_path):
    (tmp_path / "link").symlink_to(Path("missing") / "new.csv")
    write_text(tmp_path / "link", NEW)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "missing" / "new.csv").read_text() == NEW


def test_links_in_a_circle_are_refused(tmp_path):
    (tmp_path / "one").symlink_to("other")
    (tmp_path / "other").symlink_to("one")
    with pytest.raises(OSError, match=r"one: cannot be written: .*links"):
        write_text(tmp_path / "one", NEW)


def test_device_is_written_to_and_not_replaced(tmp_path):
    (tmp_path / "null").symlink_to(os.devnull)
    write_text(tmp_path / "null", NEW)
    assert (tmp_path / "null").is_symlink()
    assert Path(os.devnull).is_char_device()
    main, terminal = os.openpty()
    write_text(os.ttyname(terminal), "new\n")
    assert os.read(main, 100) == b"new\r\n"
    os.close(main)
    os.close(terminal)


def test_pipe_is_written_to_and_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    writer = threading.Thread(target=write_text, args=(tmp_path / "pipe", NEW), daemon=True)
    writer.start()
    with (tmp_path / "pipe").open() as stream:
        assert stream.read() == NEW
    writer.join()
    assert (tmp_path / "pipe").is_fifo()


@pytest.mark.parametrize("flag", ["w", "a"])
@pytest.mark.parametrize("path", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_that_is_a_file_receives_all_in_order(tmp_path, path, flag):
    program = f"""
from mm_gym.files import write_text
print("before")
write_text({path!r}, "table\\n")
print("after")
"""
    file = tmp_path / "printed"
    file.write_text("first\n")
    with file.open(flag) as stream:
        subprocess.run(
            [sys.executable, "-c", program],
            env=os.environ | {"PYTHONPATH": str(Path(mm_gym.__file__).parents[1])},
            stdout=stream,
            check=True,
        )
    kept = "first\n" if flag == "a" else ""
    assert file.read_text() == f"{kept}before\ntable\nafter\n"


@pytest.mark.parametrize("path", ["", ".", "folder", "folder/", "new/", "socket", "a\0b"])
def test_what_is_no_file_is_refused_by_name(tmp_path, monkeypatch, path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("socket")
    before = names(tmp_path)
    for write in (lambda path: write_text(path, NEW), lambda path: check_outputs([path])):
        with pytest.raises(SceneError, match="cannot be written: ") as caught:
            write(path)
        assert repr(path)[1:-1] in str(caught.value)
    assert names(tmp_path) == before


@pytest.mark.parametrize("path", [None, 3, b"table.csv"])
def test_what_is_no_path_is_refused_by_name(path):
    with pytest.raises(SceneError, match=r"path: got .*; allowed: the path of a file, as text or"):
        write_text(path, "")


def test_path_below_a_file_is_refused_by_name(old):
    for path in (old / "new.csv", old / "a" / "new.csv"):
        with pytest.raises(NotADirectoryError, match=r"new\.csv: cannot be written: Not a dir"):
            check_outputs([path])


def test_without_permission_the_message_names_the_output(old, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    for write in (lambda: write_text(old, NEW), lambda: check_outputs([old])):
        with pytest.raises(PermissionError) as caught:
            write()
        assert str(caught.value) == f"{old}: cannot be written: Permission denied"
    assert old.read_text() == "old\n"


def test_full_disk_leaves_the_old_file_and_no_other(old):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))  # Python ignores the signal
    try:
        with pytest.raises(OSError, match=r"old\.csv: cannot be written: File too large"):
            write_bytes(old, bytes(1000))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert old.read_text() == "old\n"
    assert names(old.parent) == ["old.csv"]


def test_content_is_on_disk_before_the_name_leads_to_it(old, monkeypatch):
    calls = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(os, "fsync", lambda handle: (calls.append("fsync"), fsync(handle)))
    monkeypatch.setattr(
        Path, "replace", lambda path, to: (calls.append("replace"), replace(path, to))
    )
    write_text(old, NEW)
    assert calls == ["fsync", "replace"]


def test_longest_name_can_be_written(tmp_path):
    write_text(tmp_path / ("é" * 127), NEW)  # 254 bytes; a file's name has at most 255
    assert (tmp_path / ("é" * 127)).read_text() == NEW


def test_output_that_is_an_input_is_refused_under_any_name(tmp_path, old):
    (tmp_path / "link").symlink_to(old)
    (tmp_path / "hard").hardlink_to(old)
    for path in (old, tmp_path / "link", tmp_path / "hard", tmp_path / "." / "old.csv"):
        with pytest.raises(SceneError, match="it is an input of this command"):
            check_outputs([path], [tmp_path / "missing.toml", old])


def test_two_outputs_of_one_path_are_refused_but_for_devices(tmp_path):
    (tmp_path / "link").symlink_to("new.csv")
    with pytest.raises(SceneError, match="it is named for two outputs"):
        check_outputs([tmp_path / "new.csv", tmp_path / "link"])
    check_outputs([os.devnull, os.devnull])
    check_outputs(["/dev/stdout", "/dev/stdout"])
