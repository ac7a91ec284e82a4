"""Files whole or not at all; the same bytes for the same content."""

import errno
import json
import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.csv_cells import read_sheet
from iris_sysid.io.files import (
    MAX_BYTES,
    atomic_path,
    check_writable,
    json_text,
    origin_of,
    read_file,
    remove_leftovers,
    sha256_of,
    write_atomic,
)
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import OriginDocument
from iris_sysid.io.table_cells import read_cells

ABC_SHA256 = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-2, appendix B.1


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


# --------------------------------------------------------------------------- writing


def test_write_atomic_makes_missing_folders_and_leaves_only_the_file(tmp_path):
    path = tmp_path / "new" / "folder" / "fit.json"
    assert write_atomic(path, "πr²\n") == path
    assert path.read_bytes() == "πr²\n".encode()
    assert names_in(path.parent) == ["fit.json"]


def test_write_atomic_writes_bytes_as_they_are(tmp_path):
    write_atomic(tmp_path / "a.png", b"\x89PNG\r\n\0")
    assert (tmp_path / "a.png").read_bytes() == b"\x89PNG\r\n\0"


def test_write_atomic_respects_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        write_atomic(tmp_path / "a.txt", "a")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == 0o640


def test_write_atomic_overwrite_replaces_the_file(tmp_path):
    path = tmp_path / "a.txt"
    write_atomic(path, "old and longer")
    write_atomic(path, "new", overwrite=True)
    assert path.read_text() == "new"


def test_write_atomic_follows_a_symbolic_link(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    write_atomic(tmp_path / "link.txt", "new", overwrite=True)
    assert (tmp_path / "real.txt").read_text() == "new"
    assert (tmp_path / "link.txt").is_symlink()


def existing_file(folder):
    (folder / "a.txt").write_text("precious")
    return folder / "a.txt"


def file_as_folder(folder):
    return existing_file(folder) / "b.txt"


def named_pipe(folder):
    os.mkfifo(folder / "pipe")
    return folder / "pipe"


BAD_TARGETS = [
    (existing_file, r"a\.txt exists already.*--force"),
    (lambda folder: folder, "is a folder"),
    (file_as_folder, r"a\.txt is a file, not a folder"),
    (named_pipe, "device or pipe"),
    (lambda folder: folder / ("x" * 300), "File name too long"),
    (lambda folder: Path("a\0b"), "null (byte|character)"),
    (lambda folder: Path("/dev/null"), "device or pipe"),
]


@pytest.mark.parametrize(("make", "message"), BAD_TARGETS)
def test_write_atomic_bad_target_says_what_to_do_and_changes_nothing(tmp_path, make, message):
    path = make(tmp_path)
    before = names_in(tmp_path)
    with pytest.raises(OutputError, match=message):
        write_atomic(path, "new")
    assert names_in(tmp_path) == before
    if "a.txt" in before:
        assert (tmp_path / "a.txt").read_text() == "precious"


@pytest.mark.parametrize(("make", "message"), BAD_TARGETS)
def test_check_writable_refuses_what_write_atomic_refuses(tmp_path, make, message):
    with pytest.raises(OutputError, match=message):
        check_writable(make(tmp_path))


def test_check_writable_creates_nothing(tmp_path):
    check_writable(tmp_path / "new" / "a.txt")
    assert names_in(tmp_path) == []


def test_check_writable_without_permission_names_the_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match=f"no permission to write in {tmp_path}; choose another folder"):
        check_writable(tmp_path / "a.txt")


def test_write_atomic_unwritable_folder_is_an_output_error(tmp_path, monkeypatch):
    def refuse(*_):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(os, "open", refuse)
    with pytest.raises(OutputError, match="Permission denied; choose another folder"):
        write_atomic(tmp_path / "a.txt", "a")


def test_write_atomic_full_disk_keeps_the_old_file(tmp_path, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = existing_file(tmp_path)
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left on device; free some space"):
        write_atomic(path, "new", overwrite=True)
    assert names_in(tmp_path) == ["a.txt"]
    assert path.read_text() == "precious"


def test_atomic_path_keeps_the_suffix_and_the_folder(tmp_path):
    with atomic_path(tmp_path / "clip.mp4") as temporary:
        assert temporary.suffix == ".mp4"
        assert temporary.parent == tmp_path
        assert not (tmp_path / "clip.mp4").exists()
        temporary.write_bytes(b"film")
    assert (tmp_path / "clip.mp4").read_bytes() == b"film"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, FileNotFoundError])
def test_atomic_path_error_in_the_block_passes_and_leaves_nothing(tmp_path, error):
    def write_half():
        with atomic_path(tmp_path / "clip.mp4") as temporary:
            temporary.write_bytes(b"half")
            raise error

    with pytest.raises(error):
        write_half()
    assert names_in(tmp_path) == []


def test_atomic_path_removed_by_the_writer_is_an_output_error(tmp_path):
    with pytest.raises(OutputError, match="nothing was written"), atomic_path(tmp_path / "a.txt") as temporary:
        temporary.unlink()


def test_atomic_path_file_that_came_into_being_meanwhile_is_kept(tmp_path):
    path = tmp_path / "a.txt"

    def write_while_another_does():
        with atomic_path(path) as temporary:
            temporary.write_text("mine")
            path.write_text("another's")

    with pytest.raises(OutputError, match="exists already"):
        write_while_another_does()
    assert path.read_text() == "another's"


# --------------------------------------------------------------------------- hashes and origin


def test_sha256_of_abc_is_the_published_value(tmp_path):
    (tmp_path / "abc").write_bytes(b"abc")
    assert sha256_of(tmp_path / "abc") == ABC_SHA256


def test_sha256_of_folder_depends_on_content_and_names_not_on_location(tmp_path):
    hashes = []
    for folder, name, content in (("one", "1.png", b"a"), ("two", "1.png", b"a"), ("x", "2.png", b"a")):
        write_atomic(tmp_path / folder / name, content)
        hashes.append(sha256_of(tmp_path / folder))
    assert hashes[0] == hashes[1] != hashes[2]


def test_sha256_of_missing_file_is_a_data_error(tmp_path):
    with pytest.raises(DataError, match=r"cannot read .*gone\.csv: No such file"):
        sha256_of(tmp_path / "gone.csv")


def test_origin_of_is_the_same_from_two_folders_and_names_neither(tmp_path):
    texts = []
    for folder in ("one", "two"):
        clip = tmp_path / folder / "06.mp4"
        write_atomic(clip, b"abc")
        texts.append(json_text(origin_of(clip, {"seed": 3, "calibration": tmp_path / folder / "c.json", "fps": None})))
    assert texts[0] == texts[1]
    assert str(tmp_path) not in texts[0]
    origin = json.loads(texts[0])
    assert (origin["source"], origin["sha256"]) == ("06.mp4", ABC_SHA256)
    assert origin["options"] == {"calibration": "c.json", "fps": None, "seed": 3}
    assert {"iris-sysid", "numpy", "av", "lmfit"} <= set(origin["versions"])


def test_origin_of_nothing_read_has_no_hash():
    origin = origin_of(None, {})
    assert (origin["source"], origin["sha256"]) == (None, None)


# --------------------------------------------------------------------------- JSON


def test_json_text_not_a_number_becomes_null():
    values = {"a": np.nan, "b": np.float32("inf"), "c": [float("-inf")], "d": np.array([[1.0, np.nan]])}
    assert json.loads(json_text(values)) == {"a": None, "b": None, "c": [None], "d": [[1.0, None]]}


def test_json_text_numpy_scalars_become_numbers():
    text = json_text([np.float64(0.1), np.int64(3), np.bool_(True), np.uint8(200), np.str_("x"), (1, 2)])
    assert json.loads(text) == [0.1, 3, True, 200, "x", [1, 2]]


def test_json_text_is_stable_and_readable():
    assert json_text({"b": 1, "a": {"z", "y"}}) == '{\n  "b": 1,\n  "a": [\n    "y",\n    "z"\n  ]\n}\n'


def test_json_text_replaces_bytes_that_are_no_text():
    assert json.loads(json_text({"source": Path(os.fsdecode(b"clip\xff.mp4"))})) == {"source": "clip?.mp4"}


@pytest.mark.parametrize("value", [object(), 1j, {"f": print}, [np.datetime64("2020-01-01")]])
def test_json_text_of_something_else_is_a_data_error(value):
    with pytest.raises(DataError, match="as JSON"):
        json_text(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_json_text_floats_read_back_exactly(value):
    assert json.loads(json_text(value)) == value


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
@pytest.mark.parametrize("read", [read_file, read_sheet, read_cells, lambda path: read_document(path, OriginDocument)])
def test_what_is_no_ordinary_file_is_refused_and_never_waited_for(tmp_path, make, read):
    make(tmp_path / "a.csv")
    with pytest.raises(DataError, match=r"^cannot read [^ ]*a\.csv: it is a"):
        read(str(tmp_path / "a.csv"))


def test_file_too_large_to_be_read_whole_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(DataError, match=r"a\.csv has 256 MB; at most 256 MB are read: split it"):
        read_file(path)


def test_temporary_file_of_a_killed_process_is_removed_later(tmp_path):
    script = (
        f"import os, iris_sysid.io.files as f\nwith f.atomic_path({str(tmp_path / 'a.csv')!r}): os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", script], check=False)
    (left,) = tmp_path.iterdir()
    write_atomic(tmp_path / "b.csv", "b")
    assert left.exists()  # so young that its process may be one that this machine does not see
    os.utime(left, (0, 0))
    subprocess.run(
        [sys.executable, "-c", f"import iris_sysid.io.files as f; f.write_atomic({str(tmp_path / 'c.csv')!r}, 'c')"],
        check=True,
    )
    assert names_in(tmp_path) == ["b.csv", "c.csv"]


def test_temporary_file_of_a_running_process_is_kept(tmp_path):
    with atomic_path(tmp_path / "a.csv") as temporary:
        os.utime(temporary, (0, 0))
        remove_leftovers.cache_clear()
        remove_leftovers(tmp_path)
        assert temporary.exists()
