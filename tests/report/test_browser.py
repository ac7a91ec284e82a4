"""The pages in a real browser: nothing is fetched, charts and film work, and axe finds nothing serious.

Skipped where there is no browser, but in CI; the test with axe-core, which is not a part of the project, also where
``AXE_CORE`` is not the path of its ``axe.min.js``.
"""

import time

import pytest

from iris_sysid import diagnose, run, write_report
from iris_sysid.report.diagnosis_page import write_diagnosis
from tests._browser import browser_is_there, needs_axe, serious_faults, started_browser

LONG_S = 20.0  # until something that should happen counts as failed


@pytest.fixture(autouse=True, scope="module")
def _browser_is_there():
    browser_is_there()


@pytest.fixture(scope="module")
def pages(pendulum_clip, tmp_path_factory):
    folder, measured = tmp_path_factory.mktemp("pages"), run(pendulum_clip, "pendulum")
    found = diagnose(measured.trajectory, "pendulum", effects=["quadratic-drag"])
    return {
        "run": write_report(measured, folder / "run"),
        "diagnosis": write_diagnosis(found, measured.trajectory, folder / "diagnosis", footage=measured),
        "table": write_diagnosis(found, measured.trajectory, folder / "table"),
    }


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with started_browser(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture
def opened(browser, pages):
    """Open a page; afterwards nothing may have been fetched, refused or raised."""

    def opening(name, width=1200, scheme="light", media="screen"):
        size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": False}
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": features})
        browser.get(pages[name].as_uri())
        return browser

    yield opening
    fetched = browser.execute_script("return performance.getEntriesByType('resource').map(entry => entry.name)")
    assert [address for address in fetched if not address.startswith(("data:", "file:"))] == []
    assert browser.get_log("browser") == []


def find(page, selector):
    return page.find_element("css selector", selector)


def shown(page, selector):
    """How many elements of that kind are seen."""
    return sum(one.is_displayed() for one in page.find_elements("css selector", selector))


def until(condition):
    """Wait until something holds."""
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


def moved_over(page, chart, *shares):
    """The pointer over a chart, at shares of its width."""
    over = find(page, f"#chart-{chart} .u-over")
    page.execute_script("arguments[0].scrollIntoView({block: 'center'})", over)
    from selenium.webdriver import ActionChains

    pointer = ActionChains(page)
    for share in shares:
        pointer.move_to_element_with_offset(over, round((share - 0.5) * over.size["width"]), 0)
    return pointer


def frame(page):
    return find(page, "#frame").get_attribute("href")


def test_pointing_at_a_residual_shows_its_frame_and_the_model(opened):
    page = opened("run")
    whole = frame(page)
    moved_over(page, "residual-0", 0.48, 0.5).perform()
    until(lambda: frame(page) != whole)
    half = frame(page)
    assert find(page, "#shown").text.startswith("The frame at ")
    assert shown(page, "#markers .ring.before") == 1
    assert shown(page, "#markers .dot.body-1") == 1
    assert shown(page, "#lenses svg") == 1
    assert find(page, "#chart-residual-0 .read").text != ""
    moved_over(page, "residual-0", 0.9).perform()
    until(lambda: frame(page) != half)


def test_diagnosis_shows_the_model_before_and_after(opened):
    page = opened("diagnosis")
    whole, names = frame(page), find(page, ".film .legend").text
    moved_over(page, "residual-0-0", 0.48, 0.5).perform()
    until(lambda: frame(page) != whole)
    assert shown(page, "#markers .ring.after") == int("with the added effects" in names)
    assert shown(page, "#markers .ring.before") == 1


def test_film_plays_and_can_be_moved_by_key(opened):
    page = opened("run")
    find(page, "#play").click()
    assert find(page, "#play").text == "Pause"
    until(lambda: int(find(page, "#scrub").get_attribute("value")) > 2)
    find(page, "#play").click()
    find(page, "#scrub").send_keys("\ue011", "\ue014")  # home, arrow to the right
    assert find(page, "#scrub").get_attribute("value") == "1"
    assert find(page, "#moment").text == find(page, "#scrub").get_attribute("aria-valuetext")


def test_dragging_zooms_all_charts_over_time_and_a_double_click_goes_back(opened):
    page = opened("run")

    def pictures():
        return page.execute_script("return [...document.querySelectorAll('canvas')].map(one => one.toDataURL())")

    time.sleep(0.2)
    before = pictures()
    moved_over(page, "residual-0", 0.3).click_and_hold().perform()
    moved_over(page, "residual-0", 0.5, 0.6).release().perform()
    until(lambda: all(one != other for one, other in zip(before, pictures(), strict=True)))
    zoomed = pictures()
    moved_over(page, "residual-0", 0.6).double_click().perform()
    until(lambda: pictures()[0] != zoomed[0])


def test_legend_names_what_is_in_view(opened):
    page = opened("run")
    entries, away = "#chart-motion-0 .legend li", "#chart-motion-0 .legend .outside"
    every, lacking = (len(page.find_elements("css selector", one)) for one in (entries, away))
    until(lambda: shown(page, entries) == every - lacking)
    assert shown(page, away) == 0
    moved_over(page, "motion-0", 0.5).double_click().perform()
    until(lambda: shown(page, entries) == every)


def test_without_scripts_the_charts_are_there_as_svg(pages, tmp_path):
    with started_browser(tmp_path, **{"profile.managed_default_content_settings.javascript": 2}) as page:
        page.get(pages["run"].as_uri())
        assert shown(page, "svg.still") == len(page.find_elements("css selector", "svg.still")) >= 2
        assert shown(page, ".live") == 0


def test_in_print_the_charts_are_svg(opened):
    page = opened("diagnosis", media="print")
    assert shown(page, "svg.still") == len(page.find_elements("css selector", "svg.still"))
    assert shown(page, "canvas") == 0


def unfold(page):
    page.execute_script("document.querySelectorAll('details').forEach(one => one.open = true)")


@pytest.mark.parametrize("name", ["run", "diagnosis", "table"])
def test_nothing_is_cut_on_a_phone(name, opened):
    page = opened(name, width=400)
    unfold(page)
    assert page.execute_script("return document.documentElement.scrollWidth") <= 400
    cut = (
        "return [...document.querySelectorAll('table, td, h1, p')].filter(one => one.scrollWidth > one.clientWidth + 1)"
    )
    assert page.execute_script(cut) == []


@needs_axe
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", ["run", "diagnosis", "table"])
def test_axe_finds_nothing_serious(name, scheme, opened):
    page = opened(name, scheme=scheme)
    unfold(page)
    assert serious_faults(page) == []
