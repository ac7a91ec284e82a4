"""The pages in a real browser: nothing is fetched, charts and film work, and axe finds nothing serious.

Skipped where playwright, chromium or, for the last, axe-core is absent: ``AXE_CORE`` is the path of ``axe.min.js``.
"""

import os
import shutil
from pathlib import Path

import pytest

from iris_sysid import diagnose, run, write_report
from iris_sysid.report.diagnosis_page import write_diagnosis
from iris_sysid.report.film import Footage

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
AXE = Path(os.environ.get("AXE_CORE", "axe.min.js"))
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update"]
FLAGS += ["--disable-sync"]
needs_axe = pytest.mark.skipif(not AXE.is_file(), reason="AXE_CORE names no axe.min.js")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")


@pytest.fixture(scope="module")
def pages(pendulum_clip, tmp_path_factory):
    folder, measured = tmp_path_factory.mktemp("pages"), run(pendulum_clip, "pendulum")
    found = diagnose(measured.trajectory, "pendulum", effects=["quadratic-drag"])
    footage = Footage(measured.video, measured.tracks)
    return {
        "run": write_report(measured, folder / "run"),
        "diagnosis": write_diagnosis(found, measured.trajectory, folder / "diagnosis", footage=footage),
        "table": write_diagnosis(found, measured.trajectory, folder / "table"),
    }


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        running = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


@pytest.fixture
def opened(browser, pages):
    """Open a page; afterwards nothing may have been fetched, refused or raised."""
    contexts, faults = [], []

    def opening(name, width=1200, **options):
        context = browser.new_context(viewport={"width": width, "height": 800}, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: faults.append(message.text))
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda asked: asked.url.startswith(("file:", "data:")) or faults.append(asked.url))
        page.goto(pages[name].as_uri())
        return page

    yield opening
    for context in contexts:
        context.close()
    assert faults == []


def at(page, chart, share):
    """Move the pointer over a chart, to a share of its width."""
    over = page.locator(f"#chart-{chart} .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + share * box["width"] - 1, box["y"] + 50)
    page.mouse.move(box["x"] + share * box["width"], box["y"] + 50)


def test_pointing_at_a_residual_shows_its_frame_and_the_model(opened):
    page = opened("run")
    whole = page.locator("#frame").get_attribute("href")
    at(page, "residual-0", 0.5)
    shown = page.locator("#frame").get_attribute("href")
    assert shown != whole
    assert page.locator("#shown").inner_text().startswith("The frame at ")
    assert page.locator("#markers .ring.before").count() == 1
    assert page.locator("#markers .dot.body-1").count() == 1
    assert page.locator("#lenses svg").is_visible()
    assert page.locator("#chart-residual-0 .read").first.inner_text() != ""
    at(page, "residual-0", 0.9)
    assert page.locator("#frame").get_attribute("href") != shown


def test_diagnosis_shows_the_model_before_and_after(opened, pages):
    page = opened("diagnosis")
    names = page.locator(".film .legend").inner_text()
    at(page, "residual-0-0", 0.5)
    after = "with the added effects" in names
    assert page.locator("#markers .ring.after").count() == int(after)
    assert page.locator("#markers .ring.before").count() == 1


def test_film_plays_and_can_be_moved_by_key(opened):
    page = opened("run")
    page.locator("#play").click()
    assert page.locator("#play").inner_text() == "Pause"
    page.wait_for_function("document.getElementById('scrub').value > 2")
    page.locator("#play").click()
    page.locator("#scrub").focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    assert page.locator("#scrub").input_value() == "1"
    assert page.locator("#moment").inner_text() == "0.03 s"


def test_dragging_zooms_all_charts_over_time_and_a_double_click_goes_back(opened):
    page = opened("run")
    labels = "[...document.querySelectorAll('canvas')].map(canvas => canvas.toDataURL())"
    page.wait_for_timeout(100)
    before = page.evaluate(labels)
    box = page.locator("#chart-residual-0 .u-over").bounding_box()
    page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.6 * box["width"], box["y"] + 40, steps=4)
    page.mouse.up()
    page.wait_for_timeout(100)
    zoomed = page.evaluate(labels)
    assert all(one != other for one, other in zip(before, zoomed, strict=True))
    page.locator("#chart-residual-0 .u-over").dblclick()
    page.wait_for_timeout(100)
    assert page.evaluate(labels)[0] != zoomed[0]


def test_without_scripts_the_charts_are_there_as_svg(opened):
    page = opened("run", java_script_enabled=False)
    assert page.locator("svg.still").count() == page.locator("svg.still:visible").count() >= 2
    assert page.locator(".live:visible").count() == 0


def test_in_print_the_charts_are_svg(opened):
    page = opened("diagnosis")
    page.emulate_media(media="print")
    assert page.locator("svg.still:visible").count() == page.locator("svg.still").count()
    assert page.locator("canvas:visible").count() == 0


@pytest.mark.parametrize("name", ["run", "diagnosis", "table"])
def test_nothing_is_cut_on_a_phone(name, opened):
    page = opened(name, width=400)
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    assert page.evaluate("document.documentElement.scrollWidth") == 400
    cut = (
        "[...document.querySelectorAll('table, td, h1, p')].filter(one => one.scrollWidth > one.clientWidth + 1).length"
    )
    assert page.evaluate(cut) == 0


@needs_axe
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["run", "diagnosis", "table"])
def test_axe_finds_nothing_serious(name, scheme, opened):
    page = opened(name, color_scheme=scheme)
    page.evaluate("document.querySelectorAll('details').forEach(one => one.open = true)")
    found = page.evaluate(f"{AXE.read_text('utf-8')};axe.run(document)")
    assert [fault["id"] for fault in found["violations"] if fault["impact"] in ("serious", "critical")] == []
