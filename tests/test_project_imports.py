"""One direction of flow: who may import whom, and what costs nothing to import."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from tests._project import ROOT, python_files

CORE = {"iris_sysid.types", "iris_sysid.arrays", "iris_sysid.errors", "iris_sysid.registry"}
PLUGIN_FOLDERS = ("trackers", "fitters/models", "fitters/effects", "iris_sysid/phenomena")
PIXEL_FILES = (
    "trackers/",
    "iris_sysid/video.py",
    "iris_sysid/_video",
    "iris_sysid/boards.py",
    "iris_sysid/_board",
    "iris_sysid/_camera_fit.py",
    "iris_sysid/synthetic",
    "iris_sysid/report/overlay",
    "iris_sysid/benchmark/changed_clips",
)
OURS = ("iris_sysid", "trackers", "fitters")


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def is_ours(name: str) -> bool:
    return name.partition(".")[0] in OURS


def is_core(name: str) -> bool:
    return any(name == core or name.startswith(f"{core}.") for core in CORE)


def module_of(path: Path) -> str:
    return relative(path).removesuffix(".py").removesuffix("/__init__").replace("/", ".")


FILES = {relative(path): imports_of(path) for path in python_files()}


def test_core_imports_nothing_of_ours_but_each_other():
    core = [path for path in FILES if is_core(module_of(ROOT / path))]
    assert len(core) > len(CORE)
    for path in core:
        ours = {one for one in FILES[path] if is_ours(one)}
        assert all(is_core(one) for one in ours), (path, ours)


@pytest.mark.parametrize("path", [p for p in FILES if p.startswith(PLUGIN_FOLDERS) and not p.endswith("__init__.py")])
def test_plugin_imports_only_the_core_and_its_own_helpers(path):
    folder = path.rpartition("/")[0].replace("/", ".")
    allowed = (*CORE, f"{folder}._", "fitters._")
    ours = {one for one in FILES[path] if is_ours(one) and one not in ("iris_sysid", folder)}
    assert all(one.startswith(allowed) for one in ours), ours


def test_trackers_and_fitters_never_import_one_another():
    for path, imported in FILES.items():
        if path.startswith("trackers/"):
            assert not any(one.startswith("fitters") for one in imported), path
        if path.startswith("fitters/"):
            assert not any(one.startswith("trackers") for one in imported), path


def test_nothing_imports_the_command_line():
    outside = {path: imported for path, imported in FILES.items() if not path.startswith("iris_sysid/cli/")}
    assert [path for path, imported in outside.items() if any(i.startswith("iris_sysid.cli") for i in imported)] == []


def test_pixels_are_handled_only_where_pixels_are_handled():
    handlers = {path for path, imported in FILES.items() if imported & {"cv2", "av"}}
    assert {path for path in handlers if not path.startswith(PIXEL_FILES)} == set()


def test_pysindy_is_imported_only_by_the_sindy_fitter():
    assert {p for p, imported in FILES.items() if "pysindy" in imported} <= {
        p for p in FILES if p.startswith("fitters/sindy")
    }


def test_help_imports_nothing_heavy():
    code = (
        "import sys; sys.argv = ['iris-sysid', '--help']\n"
        "import contextlib, io, iris_sysid.cli\n"
        "with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):\n"
        "    iris_sysid.cli.main()\n"
        "assert 'Commands' in out.getvalue(), out.getvalue()\n"
        "heavy = {'numpy', 'scipy', 'numba', 'cv2', 'av', 'pandas', 'lmfit', 'matplotlib', 'pydantic', 'jinja2'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_importable():
    import iris_sysid

    for name in iris_sysid.__all__:
        assert getattr(iris_sysid, name) is not None


def test_unknown_public_name_is_an_attribute_error():
    import iris_sysid

    with pytest.raises(AttributeError, match="no_such_name"):
        _ = iris_sysid.no_such_name
