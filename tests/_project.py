"""What the tests about the project itself share: its root, its Python files, the recordings and the publication."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("iris_sysid", "trackers", "fitters")
SHARED = ROOT.parent / "shared"


def python_files() -> list[Path]:
    """Every Python file of the three packages."""
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def recording(name: str, shared: Path = SHARED) -> Path:
    """The path of a real recording; without it the test is skipped, and fails where CI is set."""
    return _present(shared / "data" / name, f"the real recording {name} (../shared/data)")


def publication(name: str, shared: Path = SHARED) -> Path:
    """The path of a file of the publication's source; without it the test is skipped, and fails where CI is set."""
    return _present(shared / "paper" / name, f"the publication's {name} (../shared/paper)")


def _present(path: Path, what: str) -> Path:
    if path.exists():
        return path
    if os.environ.get("CI", "").lower() not in ("", "0", "false"):
        pytest.fail(f"{what} is absent although CI is set; a test that needs it must not pass unseen")
    pytest.skip(f"{what} is not on this machine")
