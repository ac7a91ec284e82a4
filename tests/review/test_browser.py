"""What a teacher does, in a real browser: open, correct three points, set the scale, save, see the value change."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import FitDocument
from tests._browser import browser_is_there, started_browser
from tests.review._screen import NOW, OPENED, Screen
from tests.review.conftest import OFF_PX, WRONG

WINDOW = "--window-size=1400,1000"


@pytest.fixture(autouse=True, scope="module")
def _browser_is_there():
    browser_is_there()


@pytest.fixture
def driver(tmp_path):
    with started_browser(tmp_path / "profile", WINDOW) as driver:
        yield driver


@contextmanager
def served(*arguments: object) -> Iterator[str]:
    """The command in a separate process; gives the address that it prints."""
    command = [sys.executable, "-m", "iris_sysid", "review", *map(str, arguments), "--no-browser"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        first = process.stderr.readline()
        found = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", first)
        assert found, first + process.stderr.read()
        yield found[0]
    finally:
        process.terminate()
        process.communicate(timeout=30)


@pytest.mark.slow
def test_three_points_are_corrected_the_scale_is_set_and_the_value_changes(wrong_project, driver):
    project, right = wrong_project
    with served(project / "out") as address:
        screen = Screen(driver, address)
        opened = screen.value("length", NOW)
        assert opened
        # it opens at a doubtful frame, and says why
        screen.until(lambda: any(screen.text("where").startswith(f"frame {frame} ") for frame in WRONG))
        assert "off the course of its neighbours" in screen.text("question-text")
        for frame, (x, y) in zip(WRONG, right, strict=True):
            screen.go_to(frame)
            screen.drag((x + OFF_PX, y), (x, y))
            screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        screen.until(lambda: screen.value("length", NOW) != opened)
        assert screen.value("length", OPENED) == opened
        screen.keys("3")
        screen.click(40, 20)
        screen.click(40, 120)
        screen.until(lambda: screen.find("dialog").get_attribute("open"))
        screen.keys("0.5+-0.001m", "\ue007")
        screen.until(lambda: "200" in screen.text("scene") and "px/m" in screen.text("scene"))
        screen.until(lambda: screen.text("fit-status").startswith("fitted"))
        now = screen.value("length", NOW)
        screen.find("save").click()
        screen.until(lambda: screen.text("message").startswith("Saved in"))
        screen.until(lambda: screen.text("save") == "Saved")
        assert screen.errors() == []
    (track,) = read_track(project / "out" / "track.csv")
    assert np.flatnonzero(track.edited).tolist() == list(WRONG)
    assert np.abs(track.xy_px[list(WRONG)] - right).max() < 1.0
    length = read_document(project / "out" / "fit.json", FitDocument).parameters["length"]
    assert now.startswith(f"{length.value:.3f}")
    assert abs(length.value - 0.5) < 0.002


@pytest.mark.slow
def test_page_asks_what_moves_and_fits_what_is_chosen(project, driver, tmp_path):
    with served(project / "pendulum.mp4", "-o", tmp_path / "new") as address:
        driver.get(address)
        screen = Screen(driver, None)
        screen.until(lambda: screen.find("dialog").get_attribute("open"))
        screen.until(lambda: screen.text("track") == "Track again")
        driver.find_element(screen.by.CSS_SELECTOR, "#dialog input[value='pendulum']").click()
        screen.find("dialog-yes").click()
        screen.until(
            lambda: screen.value("length", NOW).startswith("0.5") or screen.value("length", NOW).startswith("0.49")
        )
        assert screen.errors() == []


@pytest.mark.slow
def test_everything_goes_by_keys(project, driver):
    with served(project / "out") as address:
        screen = Screen(driver, address)
        screen.go_to(60)
        screen.keys("d", "d", "D", "\ue007")
        screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        screen.keys("u")
        screen.until(lambda: "edited" not in screen.find("stage").get_attribute("aria-label"))
        screen.keys("r")
        screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        screen.keys("\ue017")  # Delete
        screen.until(lambda: "not there" in screen.find("stage").get_attribute("aria-label"))
        screen.keys("?")
        screen.until(lambda: screen.find("keys").get_attribute("open"))
        assert screen.errors() == []


@pytest.mark.slow
def test_body_at_rest_is_placed_once_for_all_frames_in_which_it_is_lost(project, driver):
    path = project / "out" / "track.csv"
    (track,) = read_track(path)
    valid = track.valid & ((track.frame < 50) | (track.frame > 70))
    xy, sigma = (np.where(valid[:, None], values, np.nan) for values in (track.xy_px, track.sigma_px))
    write_track([replace(track, xy_px=xy, sigma_px=sigma, valid=valid)], path, overwrite=True)
    with served(project / "out") as address:
        screen = Screen(driver, address)
        screen.go_to(60)
        screen.keys("h")
        screen.click(100, 60)
        screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        assert not screen.find("at-rest").is_selected()
        screen.go_to(70)
        screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        assert screen.errors() == []


@pytest.mark.slow
def test_stage_of_a_phone_has_the_shape_of_the_clip(project, driver):
    size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    with served(project / "out") as address:
        driver.get(address)
        screen = Screen(driver, None)
        screen.until(lambda: screen.text("where").startswith("frame 0 of 120"))
        stage = screen.find("stage").rect
        assert stage["width"] > 340
        assert stage["width"] / stage["height"] == pytest.approx(320 / 180, rel=0.02)


@pytest.mark.slow
def test_board_is_marked_by_its_corners_and_what_is_no_body_by_a_click(project, driver):
    (track,) = read_track(project / "out" / "track.csv")
    with served(project / "out") as address:
        screen = Screen(driver, address)
        opened = screen.value("length", NOW)
        screen.keys("8")
        for corner in ((60, 40), (260, 40), (260, 140), (60, 140)):
            screen.click(*corner)
        screen.until(lambda: screen.find("dialog").get_attribute("open"))
        screen.keys("1m x 0.5m", "\ue007")
        screen.until(lambda: "four corners of a rectangle of 1 m by 0.5 m" in screen.text("scene"))
        screen.until(lambda: screen.value("length", NOW) != opened)
        screen.go_to(90)
        screen.keys("9")
        screen.click(*track.xy_px[90])
        screen.until(lambda: "not there" in screen.find("stage").get_attribute("aria-label"))
        assert "1 mark on what is no body" in screen.text("scene")
        screen.keys("u", "u")
        screen.until(lambda: screen.value("length", NOW) == opened)
        assert screen.errors() == []


@pytest.mark.slow
def test_browser_that_dies_loses_nothing(project, tmp_path):
    with served(project / "out") as address:
        with started_browser(tmp_path / "first", WINDOW) as driver:
            screen = Screen(driver, address)
            screen.go_to(60)
            screen.click(100, 60)
            screen.until(lambda: "edited" in screen.find("stage").get_attribute("aria-label"))
        with started_browser(tmp_path / "second", WINDOW) as driver:
            screen = Screen(driver, address)
            screen.go_to(60)
            assert "edited" in screen.find("stage").get_attribute("aria-label")


@pytest.mark.slow
def test_page_that_is_behind_shows_the_newer_state(project, tmp_path):
    one, two = started_browser(tmp_path / "one", WINDOW), started_browser(tmp_path / "two", WINDOW)
    with served(project / "out") as address, one as driver, two as other:
        first, second = Screen(driver, address), Screen(other, address)
        first.go_to(60)
        second.go_to(60)
        first.click(100, 60)
        second.until(lambda: "edited" in second.find("stage").get_attribute("aria-label"))
