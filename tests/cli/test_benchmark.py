"""The command ``iris-sysid benchmark``: how its arguments are read."""

import pytest

from iris_sysid.cli.benchmark import named_files
from iris_sysid.errors import DataError


def test_named_files_are_read_in_order(tmp_path):
    files = named_files(["b=two.csv", f" a = {tmp_path}/one=1.csv "], "--latent")
    assert list(files) == ["b", "a"]
    assert files["a"] == tmp_path / "one=1.csv"


@pytest.mark.parametrize("argument", ["baseline.csv", "=a.csv", "a="])
def test_file_without_a_name_is_refused(argument):
    with pytest.raises(DataError, match="write --latent as NAME=FILE"):
        named_files([argument], "--latent")


def test_repeated_name_is_refused():
    with pytest.raises(DataError, match="--latent gives the name 'a' twice"):
        named_files(["a=b.csv", "a=c.csv"], "--latent")
