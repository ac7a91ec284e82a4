"""Imports go one way only."""

import ast
from pathlib import Path

import pytest

from tests._project import ROOT, python_files

# Lowest first: a module imports from its own package and from those named before it.
ORDER = (
    "iris_sysid._version",
    "iris_sysid.errors",
    "iris_sysid.units",
    "iris_sysid.types",
    "iris_sysid.registry",
    "iris_sysid.io",
    "iris_sysid.phenomena",
    "trackers",
    "iris_sysid.video",
    "iris_sysid.stages",
    "iris_sysid.synthetic",
    "iris_sysid.calibration",
    "iris_sysid.trajectory",
    "fitters",
    "iris_sysid.diagnosis",
    "iris_sysid.report",
    "iris_sysid.pipeline",
    "iris_sysid.benchmark",
    "iris_sysid.classroom",
    "iris_sysid.review",
    "iris_sysid.cli",
    "iris_sysid.__main__",
)
MAX_ENTRIES = 19
SHARED_PRIVATE = "iris_sysid._version"  # one number for the three packages of the distribution
PLUGIN_FOLDERS = ("trackers", "fitters/models", "fitters/effects", "iris_sysid/phenomena")
# the core, and what plugins share: guesses from data alone, generated code, compiled code that is kept
PLUGINS_MAY_IMPORT = (
    "iris_sysid.types",
    "iris_sysid.errors",
    "iris_sysid.registry",
    "iris_sysid.io.kernels",
    "fitters.starting_values",
    "fitters.integrator.codegen",
)
PIXEL_FILES = (
    "trackers/",
    "iris_sysid/video/",
    "iris_sysid/calibration/board/",
    "iris_sysid/calibration/bundle_adjustment.py",
    "iris_sysid/synthetic/",
    "iris_sysid/report/film.py",
    "iris_sysid/report/overlay.py",
    "iris_sysid/report/candidates_sheet.py",
    "iris_sysid/report/frame_sheet.py",
)
OURS = ("iris_sysid", "trackers", "fitters")
# Two methods of the types hand over, when they are called, to functions above them by the public name.
THROUGH_THE_FRONT_DOOR = ("iris_sysid.types._display", "iris_sysid.types._motion")


def is_module(name: str) -> bool:
    place = ROOT / name.replace(".", "/")
    return place.is_dir() or place.with_suffix(".py").is_file()


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= names if names and all(map(is_module, names)) else {node.module} | names
    return found


def relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def is_ours(name: str) -> bool:
    return name.partition(".")[0] in OURS


def module_of(path: Path) -> str:
    return relative(path).removesuffix(".py").removesuffix("/__init__").replace("/", ".")


FILES = {relative(path): imports_of(path) for path in python_files()}


def package_of(module: str) -> str:
    """The package of ORDER that a module belongs to; the root package itself belongs to none."""
    return next((name for name in ORDER if module == name or module.startswith(f"{name}.")), "")


def modules_imported(path: str) -> set[str]:
    """The modules of ours that a file imports, by their full names; names within a module are left out."""
    return {name for name in FILES[path] if is_ours(name) and is_module(name)}


def folder_of(module: str) -> str:
    """The folder that a module lies in, with dots; a package is its own."""
    return module if (ROOT / module.replace(".", "/")).is_dir() else module.rpartition(".")[0]


def is_within(folder: str, other: str) -> bool:
    return f"{folder}.".startswith(f"{other}.")


def circles_of(edges: dict[str, set[str]]) -> list[str]:
    """Sorted names that are left when those that point at nothing left are taken away, again and again."""
    while leaves := {name for name, targets in edges.items() if not targets & edges.keys()}:
        edges = {name: targets for name, targets in edges.items() if name not in leaves}
    return sorted(edges)


def private_part(module: str) -> str:
    """The package that a private module is private to; empty for a public one and for the version."""
    if module == SHARED_PRIVATE:
        return ""
    parts = module.split(".")
    hidden = next((k for k, part in enumerate(parts) if part.startswith("_")), None)
    return "" if hidden is None else ".".join(parts[:hidden])


def test_every_file_belongs_to_a_package_of_the_order():
    assert [path for path in FILES if not package_of(module_of(ROOT / path))] == ["iris_sysid/__init__.py"]


@pytest.mark.parametrize("path", FILES)
def test_imports_go_down_the_order(path):
    package = package_of(module_of(ROOT / path))
    above = ORDER[ORDER.index(package) + 1 :] if package else ()
    assert {name for name in modules_imported(path) if package_of(name) in above} == set()


@pytest.mark.parametrize("path", FILES)
def test_private_modules_are_imported_by_their_own_package_only(path):
    module = module_of(ROOT / path)
    owners = {name: private_part(name) for name in modules_imported(path)}
    assert {name for name, owner in owners.items() if owner and not f"{module}.".startswith(f"{owner}.")} == set()


def test_no_modules_import_one_another_in_a_circle():
    """Circles are looked for among modules and packages, imports within functions and for the type checker included."""
    edges = {module_of(ROOT / path): modules_imported(path) - {module_of(ROOT / path)} for path in FILES}
    edges = {name: targets & edges.keys() for name, targets in edges.items()}
    for name in THROUGH_THE_FRONT_DOOR:
        edges[name].remove("iris_sysid")
    assert circles_of(edges) == []


def test_no_folders_import_one_another_in_a_circle():
    """A folder and one inside it count as one: a package holds what its parts share."""
    edges: dict[str, set[str]] = {}
    for path in FILES:
        folder = folder_of(module_of(ROOT / path))
        beside = {other for other in map(folder_of, modules_imported(path)) if not is_within(other, folder)}
        edges.setdefault(folder, set()).update(other for other in beside if not is_within(folder, other))
    assert circles_of(edges) == []


def test_the_root_package_has_few_entries():
    entries = {path.split("/")[1] for path in FILES if path.startswith("iris_sysid/")} - {"__init__.py", "__main__.py"}
    assert len(entries) <= MAX_ENTRIES, sorted(entries)


@pytest.mark.parametrize("path", [p for p in FILES if p.startswith(PLUGIN_FOLDERS) and not p.endswith("__init__.py")])
def test_plugin_imports_only_the_core_and_its_own_helpers(path):
    folder = path.split("/_")[0].rpartition("/")[0] if "/_" not in path else path.split("/_")[0]
    helpers = {folder.replace("/", "."), folder.split("/")[0]}  # stages of trackers share theirs
    allowed = (*PLUGINS_MAY_IMPORT, *(f"{package}._" for package in helpers))
    parents = {name.rpartition(".")[0] for name in PLUGINS_MAY_IMPORT} | {"iris_sysid", *helpers}
    ours = {name for name in FILES[path] if is_ours(name)} - parents
    assert {name for name in ours if not name.startswith(allowed)} == set()


def test_trackers_and_fitters_never_import_one_another():
    for path, imported in FILES.items():
        if path.startswith("trackers/"):
            assert not any(module.startswith("fitters") for module in imported), path
        if path.startswith("fitters/"):
            assert not any(module.startswith("trackers") for module in imported), path


def test_nothing_but_python_m_imports_the_command_line():
    inside = ("iris_sysid/cli/", "iris_sysid/__main__.py")
    outside = {path: imported for path, imported in FILES.items() if not path.startswith(inside)}
    assert [path for path, imported in outside.items() if any(i.startswith("iris_sysid.cli") for i in imported)] == []


def test_pixels_are_handled_only_where_pixels_are_handled():
    handlers = {path for path, imported in FILES.items() if imported & {"cv2", "av"}}
    assert {path for path in handlers if not path.startswith(PIXEL_FILES)} == set()


def test_pysindy_is_imported_only_by_the_sindy_fitter():
    assert {p for p, imported in FILES.items() if "pysindy" in imported} <= {
        p for p in FILES if p.startswith("fitters/sindy/")
    }


def test_unknown_public_name_is_an_attribute_error():
    import iris_sysid

    with pytest.raises(AttributeError, match="no_such_name"):
        _ = iris_sysid.no_such_name
