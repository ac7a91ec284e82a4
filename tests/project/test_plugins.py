"""One new tracker, model, effect or phenomenon is one new file, and the contract tests run over it as they are.

The files below are dropped into folders that extend the packages; nothing of the project is edited.
"""

import os
import subprocess
import sys
from importlib.metadata import EntryPoint

import pytest

from iris_sysid.errors import DataError, PluginError, UnknownNameError
from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA, TRACKERS, Registry
from iris_sysid.types import Tracker
from tests._project import ROOT

TRACKER = '''
"""The centre of brightness of what differs from the mean image."""

import numpy as np

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import Track, Tracker


def track(video, options):
    frames = list(video.frames())
    images = np.array([frame.bgr().astype(float).sum(axis=2) for frame in frames])
    height, width = images.shape[1:]
    x, y, wide, high = options.roi or (0, 0, width, height)
    if x + wide > width or y + high > height:
        raise DataError(f"the region {options.roi} does not lie within {width} x {height} px")
    moving = np.abs(images - np.median(images, axis=0))
    if moving.max() < 60:
        raise TrackingError("nothing in this clip differs from its median image")
    moving[moving < 60] = 0.0
    rows, columns = np.indices((height, width))
    total = moving.sum(axis=(1, 2))
    xy = np.array([[(columns * image).sum(), (rows * image).sum()] for image in moving]) / total[:, None]
    if options.progress is not None:
        options.progress(len(frames), len(frames))
    return [
        Track(
            body="body",
            frame=np.arange(len(frames)),
            t_s=[frame.t_s for frame in frames],
            xy_px=xy,
            sigma_px=np.full_like(xy, 0.2),
            valid=np.ones(len(frames), bool),
            origin={"tracker": "dropped-in"},
        )
    ]


TRACKER = Tracker(name="dropped-in", summary="centre of what differs from the median image", track=track)
'''

MODEL = '''
"""A body that is slowed by its bearing."""

import numpy as np

from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity


def rhs(t, state, params):
    s, v = state
    return v, -params[0] * v


def guess(trajectory):
    s, t_s = trajectory.position[:, 0], trajectory.t_s
    return {"drag": 0.5, "s_0": float(s[0]), "v_0": float(np.polyfit(t_s[:20], s[:20], 1)[0])}


MODEL = OdeModel(
    name="dropped-in",
    summary="a body that is slowed by its bearing",
    equation=r"\\\\ddot s + b\\\\,\\\\dot s = 0",
    source="a test",
    states=(Quantity("s", "m", "s"), Quantity("v", "m/s", "v")),
    parameters=(Parameter("drag", "1/s", "b", lower=-10.0, upper=100.0),),
    observed=(Quantity("s", "m", "s"),),
    rhs=rhs,
    guess=guess,
    typical="a ball bearing: 0.01 to 0.1 1/s",
    example=ModelExample({"drag": 0.8, "s_0": 0.1, "v_0": 1.5}, samples=300, rate_hz=100.0),
)
'''

EFFECT = '''
"""A drag in proportion to the cube of the speed."""

from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t, position, velocity, speed, base, params):
    return -params[0] * speed**2 * velocity


def applies(model):
    return model.second_order and model.name in ("pendulum", "incline")


EFFECT = Effect(
    name="dropped-in",
    summary="a drag in proportion to the cube of the speed",
    equation=r"-c\\\\,\\\\dot x^3",
    source="a test",
    parameters=(Parameter("dropped_in", "s/{x}^2", "c", default=0.0),),
    applies=applies,
    acceleration=acceleration,
    typical="0.05 s/m^2",
    example=EffectExample("pendulum", size=0.05),
)
'''

PHENOMENON = '''
"""A ball that rolls along a rail."""

from iris_sysid.types import Phenomenon

PHENOMENON = Phenomenon(
    name="dropped-in",
    summary="a ball that rolls along a rail",
    tracker="median-background",
    model="coasting-ball",
    observe=lambda world, settings: world[0],
)
'''

FILES = {"trackers": TRACKER, "fitters.models": MODEL, "fitters.effects": EFFECT, "iris_sysid.phenomena": PHENOMENON}
CONTRACTS = (
    "tests/trackers/test_contract.py",
    "tests/fitters/test_models_contract.py",
    "tests/fitters/test_effects_contract.py",
    "tests/phenomena/test_phenomena.py",
    "tests/project/test_registry.py",
)
EXTENDED = """
import importlib, sys
from pathlib import Path
import pytest
for package in {packages!r}:
    importlib.import_module(package).__path__.append(str(Path({folder!r}) / package))
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", "-k", "dropped-in or kebab or exist", *{contracts!r}]))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One folder a package, each with one new file; and all of them as a user's own files."""
    folder = tmp_path_factory.mktemp("plugins")
    for package, text in FILES.items():
        (folder / package).mkdir()
        (folder / package / "dropped_in.py").write_text(text.replace("\\\\", "\\"), encoding="utf-8")
    return folder


def test_new_files_pass_the_contract_tests_with_nothing_else_edited(folder):
    code = EXTENDED.format(packages=list(FILES), folder=str(folder), contracts=list(CONTRACTS))
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert "dropped-in" not in {*TRACKERS, *MODELS, *EFFECTS, *PHENOMENA}


OWN = [
    (TRACKERS, "trackers", "TRACKER"),
    (MODELS, "fitters.models", "MODEL"),
    (EFFECTS, "fitters.effects", "EFFECT"),
    (PHENOMENA, "iris_sysid.phenomena", "PHENOMENON"),
]


def kinds(value):
    return value.kind if isinstance(value, Registry) else ""


@pytest.mark.parametrize(("registry", "package", "name"), OWN, ids=kinds)
def test_own_file_gives_every_kind_of_plugin(registry, package, name, folder):
    text = f"{folder / package / 'dropped_in.py'}:{name}"
    item = registry.named(text)
    assert item.name == "dropped-in"
    assert registry.named(text) is item
    assert "dropped-in" not in registry


@pytest.mark.parametrize(("registry", "package", "name"), OWN, ids=kinds)
def test_own_file_without_the_item_names_those_it_has(registry, package, name, folder):
    with pytest.raises(DataError, match=f"'nothing' is not there in .*; items of type .* in it: {name}"):
        registry.named(f"{folder / package / 'dropped_in.py'}:nothing")


def test_own_file_is_read_again_after_it_has_changed(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(PHENOMENON)
    first = PHENOMENA.named(f"{path}:PHENOMENON")
    path.write_text(PHENOMENON.replace("rolls", "slides"))
    os.utime(path, ns=(1, 1))
    assert (first.summary, PHENOMENA.named(f"{path}:PHENOMENON").summary) == (
        "a ball that rolls along a rail",
        "a ball that slides along a rail",
    )


def test_plain_look_up_runs_no_file_of_the_user(folder):
    with pytest.raises(UnknownNameError, match="no tracker is named"):
        TRACKERS[f"{folder / 'trackers' / 'dropped_in.py'}:TRACKER"]


@pytest.fixture
def declared(monkeypatch):
    """Make entry points of a made-up distribution, as ``name=module:attribute``."""

    class Distribution:
        name = "swing-tracker"

    def declare(**points):
        made = [EntryPoint(name.replace("_", "-"), value, "iris_sysid.trackers") for name, value in points.items()]
        for point in made:
            vars(point).update(dist=Distribution())
        monkeypatch.setattr("importlib.metadata.entry_points", lambda group: made)
        return Registry("tracker", "trackers", Tracker, "iris_sysid.trackers")

    return declare


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A module ``swing_tracker`` on the path, as another distribution would install it."""
    (tmp_path / "swing_tracker.py").write_text(TRACKER.replace('name="dropped-in"', 'name="swing"'))
    (tmp_path / "swing_leaves.py").write_text("import sys\nsys.exit(3)\n")
    (tmp_path / "swing_broken.py").write_text("import no_such_package\n")
    monkeypatch.syspath_prepend(tmp_path)


@pytest.mark.usefixtures("installed")
def test_entry_point_of_another_distribution_is_registered(declared):
    registry = declared(swing="swing_tracker:TRACKER")
    assert registry["swing"].summary == "centre of what differs from the median image"
    assert set(registry) == {*TRACKERS, "swing"}
    assert registry.summaries()["swing"] == registry["swing"].summary
    assert registry.unusable == {}


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("swing", "swing_broken:TRACKER", "ModuleNotFoundError: No module named 'no_such_package'"),
        ("swing", "swing_leaves:TRACKER", r"it calls sys\.exit while it is imported"),
        ("swing", "swing_tracker:nothing", "AttributeError.*"),
        ("swing", "swing_tracker:np", "it is of type module, not Tracker"),
        ("sway", "swing_tracker:TRACKER", "its name is 'swing'"),
        ("disc", "swing_tracker:TRACKER", "another tracker has that name"),
    ],
)
def test_entry_point_that_cannot_be_used_is_passed_over_and_named(declared, name, value, reason):
    registry = declared(**{name: value})
    assert set(registry) == set(TRACKERS)
    with pytest.raises(
        PluginError, match=f"swing-tracker declares the tracker '{name}' .*{reason}; update swing-tracker"
    ):
        raise PluginError(registry.unusable[name])
    if name != "disc":
        with pytest.raises(PluginError, match=reason):
            registry[name]


@pytest.mark.parametrize("registry", [TRACKERS, MODELS, EFFECTS, PHENOMENA], ids=kinds)
def test_summaries_read_from_the_source_are_those_of_the_items(registry):
    fresh = Registry(registry.kind, registry.package, registry.item_type)
    assert fresh.summaries() == {name: item.summary for name, item in registry.items()}
