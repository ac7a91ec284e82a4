"""The gallery shows every registered item, with what it states and a figure of it, and the docs write it anew."""

import re

import numpy as np
import pytest
from matplotlib.mathtext import MathTextParser

from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.report.typeset import typeset
from iris_sysid.types import ComponentKind
from tests._project import ROOT
from validation import gallery

ITEMS = [*MODELS.values(), *EFFECTS.values()]
PAGES = gallery.models_page(MODELS.values()) + gallery.effects_page(EFFECTS.values())
SHOWN = ("pendulum", "bouncing-ball")
# each kind of map, and another unit
CHANGED = ("quadratic-drag", "camera-tilt", "time-scale", "gain-change", "dropped-frame")


def section_of(name: str) -> str:
    """What the pages say below the heading of an item."""
    return re.split(r"^#", re.split(rf"^###? {re.escape(name)}$", PAGES, flags=re.MULTILINE)[1], flags=re.MULTILINE)[0]


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.name)
def test_every_item_is_shown_with_equation_source_sizes_and_units(item):
    section = section_of(item.name)
    assert f"$$\n{item.equation}\n$$" in section
    assert item.source in section
    assert typeset(item.typical) in section
    assert f"](figures/{item.name}.svg)" in section
    rows = re.findall(r"^\| \$(.+?)\$ \| `(\w+)` \| (.+?) \|", section, re.MULTILINE)
    assert rows == [(p.symbol, p.name, typeset(p.unit.replace("{x}", "[x]"))) for p in item.parameters]


def test_effects_stand_below_the_part_of_a_residual_that_they_are():
    assert set(gallery.KINDS) == set(ComponentKind.__args__)
    above = PAGES.split("### coulomb-friction")[0]
    assert re.findall(r"^## (.*)$", above, re.MULTILINE)[-1] == "Forces that depend on the velocity"
    assert not re.search(r"^## Others", PAGES, re.MULTILINE)


@pytest.mark.parametrize("name", SHOWN)
def test_figure_of_a_model_shows_its_example(name):
    (axes,) = gallery.model_figure(MODELS[name]).axes
    (line,) = axes.get_lines()
    times, observed = line.get_data()
    example = MODELS[name].example
    assert 100 < times.size <= gallery.MAX_POINTS
    assert times[-1] == pytest.approx(example.t_s[-1], abs=4 / example.rate_hz)
    assert observed[0] == pytest.approx(example.values[f"{MODELS[name].states[0].name}_0"])
    assert axes.get_ylabel().endswith(f"({MODELS[name].observed[0].unit})")


@pytest.mark.parametrize("name", CHANGED)
def test_figure_of_an_effect_shows_the_difference_that_it_makes(name):
    top, bottom = gallery.effect_figure(EFFECTS[name]).axes
    (_, without), (_, changed) = (line.get_data() for line in top.get_lines())
    ((_, difference),) = (line.get_data() for line in bottom.get_lines())
    np.testing.assert_allclose(difference, changed - without, atol=1e-12)
    assert np.ptp(difference) > 1e-4 * np.ptp(without)


@pytest.mark.parametrize("item", ITEMS, ids=lambda item: item.name)
def test_symbols_can_be_set_in_a_figure(item):
    quantities = (*item.observed, *item.parameters) if item in MODELS.values() else item.parameters
    for quantity in quantities:
        MathTextParser("path").parse(f"${quantity.symbol or 'x'}$")


def test_figure_is_the_same_file_every_time_and_transparent(tmp_path):
    for name in ("a.svg", "b.svg"):
        gallery.save(gallery.model_figure(MODELS["free-fall"]), tmp_path / name)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert b'style="fill: #ffffff"' not in (tmp_path / "a.svg").read_bytes()


def test_docs_write_the_gallery_when_they_are_built_and_the_index_leads_to_it():
    assert "write_gallery(" in (ROOT / "docs" / "conf.py").read_text("utf-8")
    assert "gallery/index" in (ROOT / "docs" / "index.md").read_text("utf-8").split()
    assert {"models", "effects"} <= set((ROOT / "docs" / "gallery" / "index.md").read_text("utf-8").split())
