"""A folder of results finds its clip wherever it lies."""

import os
import shutil

import pytest

from iris_sysid.io.clip_place import CLIP_PLACE, places_of, way_to, write_clip_place


def test_clip_is_found_in_another_folder(tmp_path):
    clip, folder = tmp_path / "clips of mine" / "swing.mp4", tmp_path / "results" / "one"
    for path in (clip.parent, folder):
        path.mkdir(parents=True)
    clip.write_bytes(b"frames")
    write_clip_place(clip, folder)
    assert (folder / CLIP_PLACE).read_text("utf-8") == "../../clips of mine/swing.mp4\n"
    assert [place.read_bytes() for place in places_of(folder, "swing.mp4") if place.is_file()] == [b"frames"]


def test_folders_that_move_together_still_find_it(tmp_path):
    (tmp_path / "a" / "clips").mkdir(parents=True)
    (tmp_path / "a" / "clips" / "swing.mp4").write_bytes(b"frames")
    (tmp_path / "a" / "out").mkdir()
    write_clip_place(tmp_path / "a" / "clips" / "swing.mp4", tmp_path / "a" / "out")
    shutil.move(tmp_path / "a", tmp_path / "b")
    assert any(place.is_file() for place in places_of(tmp_path / "b" / "out", "swing.mp4"))


@pytest.mark.parametrize("text", [b"", b"\xff\xfe", b"../../../etc/passwd\n", b"another.mp4"])
def test_file_that_says_nothing_or_another_name_is_passed_over(text, tmp_path):
    (tmp_path / CLIP_PLACE).write_bytes(text)
    assert {place.name for place in places_of(tmp_path, "swing.mp4")} == {"swing.mp4"}


def test_way_between_drives_is_the_whole_path(tmp_path, monkeypatch):
    def no_way(*_):
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    monkeypatch.setattr(os.path, "relpath", no_way)
    assert way_to(tmp_path / "swing.mp4", tmp_path / "out") == (tmp_path / "swing.mp4").resolve().as_posix()
