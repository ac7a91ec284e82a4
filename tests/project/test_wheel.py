"""The wheel holds exactly the three packages, is the same bytes wherever it is built, and works anywhere."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests._project import PACKAGES, ROOT

CALLER = """\
from iris_sysid import TRACKERS, fit, read_trajectory

reveal_type(fit(read_trajectory("swing.csv"), "pendulum"))
reveal_type(TRACKERS["disc"])
fit(read_trajectory("swing.csv"), model=3.2)
"""
MYPY = "[mypy]\nstrict = true\nfollow_imports = silent\n"  # of the packages themselves `make lint` speaks


def kept_files() -> list[str]:
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def copied(source: Path, mode: int, modified_s: float) -> Path:
    for name in kept_files():
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).write_bytes((ROOT / name).read_bytes())
        (source / name).chmod(mode)
        os.utime(source / name, (modified_s, modified_s))
    return source


def built(source: Path, out: Path) -> Path:
    done = subprocess.run(
        ["make", "--old-file", ".venv/ready", f"BIN={Path(sys.executable).parent}", f"DIST={out}", "wheel"],
        cwd=source,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    return built(copied(tmp_path_factory.mktemp("source"), 0o644, 1.7e9), tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def site(wheel, tmp_path_factory) -> Path:
    target = tmp_path_factory.mktemp("site")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", str(target)]
    subprocess.run([*install, str(wheel)], check=True, capture_output=True)
    return target


def test_wheel_holds_exactly_the_three_packages(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names if ".dist-info/" not in name} == set(PACKAGES)
    kept = subprocess.run(["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True)
    assert set(kept.stdout.split()) <= set(names)


def test_wheel_is_the_same_bytes_from_files_of_other_dates_and_modes(wheel, tmp_path):
    other = built(copied(tmp_path / "source", 0o664, 1.75e9), tmp_path / "wheel")
    assert other.read_bytes() == wheel.read_bytes()


def test_wheel_works_outside_the_checkout(site, tmp_path):
    code = (
        f"import sys; sys.path.insert(0, {str(site)!r}); sys.argv = ['iris-sysid', 'list']\n"
        "import iris_sysid.cli\nprint(iris_sysid.cli.__file__)\niris_sysid.cli.main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[0].startswith(str(site))
    assert "median-background" in done.stdout
    assert "pendulum" in done.stdout


@pytest.mark.slow
def test_types_are_seen_from_outside(site, tmp_path):
    (tmp_path / "caller.py").write_text(CALLER, "utf-8")
    (tmp_path / "mypy.ini").write_text(MYPY, "utf-8")
    command = [sys.executable, "-m", "mypy", "caller.py"]
    done = subprocess.run(
        command, cwd=tmp_path, env={**os.environ, "MYPYPATH": str(site)}, capture_output=True, text=True
    )
    said = done.stdout.splitlines()
    assert [line.rstrip('"').rpartition(".")[2] for line in said[:2]] == ["FitResult", "Tracker"], said
    assert 'has incompatible type "float"' in said[2]
    assert len(said) == 4, said  # the last line counts the errors
