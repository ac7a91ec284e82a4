"""Tests on real recordings fail where CI is set and the recordings are absent; elsewhere they are skipped."""

import pytest

from tests._project import publication, recording


@pytest.mark.parametrize("find", [recording, publication])
def test_absent_file_fails_the_test_where_ci_is_set(find, tmp_path, monkeypatch):
    monkeypatch.setenv("CI", "true")
    with pytest.raises(pytest.fail.Exception, match=r"some\.mp4.* is absent although CI is set"):
        find("some.mp4", tmp_path)


@pytest.mark.parametrize("find", [recording, publication])
@pytest.mark.parametrize("ci", [None, "", "false"])
def test_absent_file_skips_the_test_elsewhere(find, ci, tmp_path, monkeypatch):
    monkeypatch.delenv("CI", raising=False) if ci is None else monkeypatch.setenv("CI", ci)
    with pytest.raises(pytest.skip.Exception, match=r"some\.mp4.* is not on this machine"):
        find("some.mp4", tmp_path)


def test_file_that_is_there_is_found(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "some.mp4").write_bytes(b"video")
    assert recording("some.mp4", tmp_path) == tmp_path / "data" / "some.mp4"
