"""What Windows does not take, by its rules and not by trying: these tests run anywhere."""

import os
from pathlib import PureWindowsPath

import pytest

from iris_sysid.cli import _terminal
from iris_sysid.errors import OutputError
from iris_sysid.io import files
from iris_sysid.io.files import check_writable, remove_leftovers, write_atomic
from iris_sysid.io.windows_paths import MAX_PATH, length_trouble, name_trouble
from iris_sysid.review import server


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("con", "device"),
        ("out/NUL.csv", "device"),
        ("aux.tar.gz", "device"),
        ("C:/class/com1/report.html", "device"),
        ("lpt².json", "device"),
        ("nul .txt", "device"),
        ("out/a:b.csv", "':'"),
        ("swing?.csv", "'?'"),
        ('"swing".csv', "'\"'"),
        ("out./fit.json", "dot or space"),
        ("out /fit.json", "dot or space"),
    ],
)
def test_names_that_windows_keeps_or_refuses(path, word):
    assert word in name_trouble(PureWindowsPath(path))


@pytest.mark.parametrize(
    "path", ["out/fit.json", "C:/Users/x/console.csv", "../nullable.csv", ".iris-1.csv", "com10.csv", "Körner é.csv"]
)
def test_names_that_windows_takes(path):
    assert name_trouble(PureWindowsPath(path)) == ""


def test_length_of_a_path_is_remarked_on_beyond_what_windows_takes():
    assert length_trouble(PureWindowsPath("x" * MAX_PATH)) == ""
    assert "260 characters" in length_trouble(PureWindowsPath("x" * 260))


def test_reserved_name_is_refused_before_the_work(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "WINDOWS", True)
    with pytest.raises(OutputError, match="keeps the name"):
        check_writable("nul.csv")
    check_writable(tmp_path / "fit.json")


def test_file_that_another_program_has_open_is_named_and_nothing_is_left(tmp_path, monkeypatch):
    path = tmp_path / "class.xlsx"
    path.write_bytes(b"old")

    def refused(self, target):
        raise PermissionError(13, "Access is denied")

    monkeypatch.setattr("pathlib.Path.replace", refused)
    with pytest.raises(OutputError, match="another program has it open; close it there"):
        write_atomic(path, b"new", overwrite=True)
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["class.xlsx"]


def test_no_signal_is_sent_to_find_out_whether_a_process_runs(tmp_path, monkeypatch):
    """On Windows ``os.kill(number, 0)`` would be Ctrl-C for that process."""
    left = tmp_path / f"{files._own_prefix()}1-abc.csv"
    left.write_text("")
    os.utime(left, (0, 0))
    monkeypatch.setattr(files, "WINDOWS", True)
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("a signal was sent"))
    remove_leftovers.__wrapped__(tmp_path)
    assert not left.exists()


def test_printed_commands_are_quoted_for_the_shell_of_the_system(monkeypatch):
    assert _terminal.command("review", "my clips/out") == "iris-sysid review 'my clips/out'"
    monkeypatch.setattr(_terminal.os, "name", "nt")
    assert _terminal.command("review", "my clips\\out") == 'iris-sysid review "my clips\\out"'


def test_port_in_use_is_never_shared():
    first = server.listen(0)
    try:
        with pytest.raises(OutputError, match="cannot be used"):
            server.listen(first.getsockname()[1])
    finally:
        first.close()
