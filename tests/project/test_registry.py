"""One new thing is one new file; what does not belong is refused."""

import sys
import types

import pytest

import trackers
from iris_sysid.errors import PluginError, UnknownNameError
from iris_sysid.registry import MODELS, PHENOMENA, TRACKERS, Registry, check_ours
from iris_sysid.types import Tracker

PLUGIN = """
from iris_sysid.types import Tracker
def track(video, options):
    return []
TRACKER = Tracker(name={name!r}, summary="follows nothing", track=track)
"""


@pytest.fixture
def plugin_folder(tmp_path, monkeypatch):
    len(TRACKERS)  # found before the folder is there
    monkeypatch.setattr(trackers, "__path__", [*trackers.__path__, str(tmp_path)])
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("trackers.dropped")]:
        del sys.modules[name]


@pytest.fixture
def fresh():
    return Registry("tracker", "trackers", Tracker)


def test_registry_dropped_in_file_is_found(plugin_folder, fresh):
    (plugin_folder / "dropped_in.py").write_text(PLUGIN.format(name="dropped-in"))
    assert fresh["dropped-in"].summary == "follows nothing"
    assert set(TRACKERS) < set(fresh)


def test_registry_one_name_loads_its_file_alone(plugin_folder, fresh):
    (plugin_folder / "dropped_in.py").write_text(PLUGIN.format(name="dropped-in"))
    (plugin_folder / "dropped_out.py").write_text("raise RuntimeError('not asked for')")
    assert fresh["dropped-in"] is fresh["dropped-in"]
    with pytest.raises(RuntimeError, match="not asked for"):
        len(fresh)


def test_registry_item_asked_for_first_is_the_one_listed_later(plugin_folder, fresh):
    (plugin_folder / "dropped_in.py").write_text(PLUGIN.format(name="dropped-in"))
    item = fresh["dropped-in"]
    assert dict(fresh)["dropped-in"] is item


def test_registry_helper_file_is_not_a_plugin(plugin_folder, fresh):
    (plugin_folder / "_dropped_helper.py").write_text("raise RuntimeError('helpers are not imported')")
    assert set(fresh) == set(TRACKERS)


def test_registry_duplicate_name_is_refused(plugin_folder, fresh):
    (plugin_folder / "dropped_one.py").write_text(PLUGIN.format(name="dropped-one"))
    (plugin_folder / "dropped_two.py").write_text(PLUGIN.format(name="dropped-one"))
    with pytest.raises(PluginError, match="dropped-one"):
        len(fresh)


def test_registry_name_unlike_its_file_is_refused(plugin_folder, fresh):
    (plugin_folder / "dropped_in.py").write_text(PLUGIN.format(name="something-else"))
    with pytest.raises(PluginError, match="must be 'dropped-in'"):
        len(fresh)


def test_registry_unknown_name_lists_the_names_and_the_closest():
    with pytest.raises(UnknownNameError, match=r"did you mean 'median-background'.*there are: .*median-background"):
        TRACKERS["median-backgroud"]


@pytest.mark.parametrize("registry", [TRACKERS, MODELS, PHENOMENA], ids=lambda registry: registry.kind)
def test_registry_items_are_described_and_kebab_case(registry):
    for name, item in registry.items():
        assert name == name.lower().replace("_", "-")
        assert item.summary
        assert not item.summary.endswith(".")


def test_registry_foreign_package_of_the_same_name_is_refused(monkeypatch):
    foreign = types.ModuleType("trackers")
    foreign.__path__ = ["/somewhere/site-packages/trackers"]
    monkeypatch.setitem(sys.modules, "trackers", foreign)
    with pytest.raises(PluginError, match="'trackers' belongs to the package at"):
        check_ours(foreign)


def test_registry_package_shared_with_another_distribution_is_refused(tmp_path, monkeypatch):
    for name, files in (
        ("iris_sysid-0.2.0", "trackers/disc.py"),
        ("trackers-2.0", "trackers/utils.py"),
        ("other-1", "x.py"),
    ):
        (tmp_path / f"{name}.dist-info").mkdir()
        (tmp_path / f"{name}.dist-info" / "RECORD").write_text(f"other/file.py,,\n{files},sha256=0,1\n")
    monkeypatch.setattr(trackers, "__path__", [str(tmp_path / "trackers")])
    with pytest.raises(PluginError, match="pip uninstall trackers iris-sysid"):
        check_ours(trackers)


def test_phenomena_name_trackers_and_models_that_exist():
    for phenomenon in PHENOMENA.values():
        assert phenomenon.tracker in TRACKERS
        assert phenomenon.model in MODELS
