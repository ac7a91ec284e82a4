"""The pages: complete, safe to open, in need of nothing else, the same bytes again."""

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from iris_sysid import MODELS, diagnose, fit, run, write_report
from iris_sysid.errors import IrisError, OutputError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.registry import EFFECTS
from iris_sysid.report import clip_page, figures
from iris_sysid.report import page as page_module
from iris_sysid.report.chart import Chart, ChartMark, Series
from iris_sysid.report.diagnosis_files import FILES
from iris_sysid.report.diagnosis_page import write_diagnosis
from iris_sysid.report.glossary import TERMS
from iris_sysid.report.overlay import draw_body, write_overlay
from iris_sysid.report.page import (
    Bar,
    KeyValue,
    Page,
    PageImage,
    Section,
    estimates_section,
    html_of,
    numbers,
    png_of,
    words,
)
from iris_sysid.report.text import table_names
from iris_sysid.types import Completeness, Diagnosis, Doubt, Estimate, Quantity, Segment, Track, Trajectory, Verdict
from iris_sysid.video.multiple_exposure import PHASES, multiple_exposure
from tests._drawn import DrawnClip, moving_disc
from tests.conftest import listing

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(1)>\"'&{{ 7 * 7 }}"
LOADING = ("src", "href", "xlink:href", "srcset", "action", "background", "poster", "data")
FOREIGN = {"link", "iframe", "object", "embed", "base", "form", "foreignobject", "animate", "set"}


class Tags(HTMLParser):
    """Every tag with its attributes, the text that is read, and the text of scripts and styles by their types."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict]] = []
        self.text = ""
        self.code: dict[str, str] = {}
        self.code_type = ""
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        self.code_type = dict(attributes).get("type", tag) if tag in ("style", "script") else ""

    def handle_endtag(self, tag):
        self.code_type = ""

    def handle_data(self, data):
        if self.code_type:
            self.code[self.code_type] = self.code.get(self.code_type, "") + data
        else:
            self.text += f"{data} "


def assert_safe_and_alone(html: str) -> Tags:
    """Nothing but our own script is executed, nothing is fetched, and the policy of the page says so too."""
    page = Tags(html)
    assert not {tag for tag, _ in page.tags} & FOREIGN
    for tag, attributes in page.tags:
        assert not [name for name in attributes if name.startswith("on") or name == "style"], (tag, attributes)
        for name in LOADING:
            assert attributes.get(name, "data:image/").startswith(("data:image/", "#"))
    (policy,) = [attributes["content"] for _, attributes in page.tags if "http-equiv" in attributes]
    assert policy.startswith("default-src 'none'; img-src data:;")
    assert set(page.code) == {"style", "script", "application/json"}
    for kind in ("style", "script"):
        digest = base64.b64encode(hashlib.sha256(page.code[kind].encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert not re.search(
        r"url\(|@import|\beval\(|\bfetch\(|XMLHttpRequest|innerHTML", page.code["style"] + own_script()
    )
    json.loads(page.code["application/json"])
    return page


def own_script() -> str:
    return (Path(page_module.__file__).parent / "assets" / "page.js").read_text("utf-8")


def pictures_in(html: str, kind: str = "png") -> list[bytes]:
    sources = [attributes["src"] for tag, attributes in Tags(html).tags if tag == "img"]
    return [base64.b64decode(source.partition(",")[2]) for source in sources if f"image/{kind}" in source]


# --------------------------------------------------------------------------- the page itself


def hostile_page() -> Page:
    section = Section(
        HOSTILE,
        (*numbers(HOSTILE), *words(HOSTILE, "symbol")),
        [(HOSTILE, HOSTILE, HOSTILE)],
        [HOSTILE],
        more=[(HOSTILE, HOSTILE, HOSTILE)],
        image=PageImage("a", b"png", HOSTILE),
    )
    curve = Series(HOSTILE, np.arange(3.0), np.arange(3.0), "before")
    chart = Chart("x", HOSTILE, HOSTILE, HOSTILE, [curve], marks=[ChartMark(1.0, 1.0, HOSTILE, HOSTILE)], words=HOSTILE)
    return Page(
        HOSTILE,
        HOSTILE,
        HOSTILE,
        {HOSTILE: HOSTILE},
        values=[KeyValue(HOSTILE, HOSTILE, Estimate(1.0, 0.1, HOSTILE))],
        verdict=Verdict("doubtful", (Doubt("scale", HOSTILE, HOSTILE),), Completeness(0.9, False, rest=HOSTILE)),
        warnings=[HOSTILE],
        statements=[HOSTILE],
        bars=[Bar(HOSTILE, [(HOSTILE, 50.0, "force")])],
        charts=[chart],
        sections=[section],
    )


def test_page_escapes_every_text():
    html = assert_safe_and_alone(html_of(hostile_page()))
    assert html.text.count("<script>alert(1)</script>") >= 20
    assert "{{ 7 * 7 }}" in html.text
    assert "49" not in html.text


def test_page_says_what_it_was_given():
    estimates = {"length": Estimate(1.70342, 0.0042, "m", "fitted", "here"), "g": Estimate(-9.8, 0.1, "m/s^2")}
    section = estimates_section("Parameters", estimates, r"\ddot x = -g", symbols={"length": "L"}, main=["length"])
    page = Page("clip", "length = 1.7", "a bob", {}, sections=[section])
    html = html_of(page)
    text = " ".join(Tags(html).text.split())
    assert "Parameters quantity symbol value ± standard error 95 % interval kind source" in text
    assert "length L 1.7034 ± 0.0042 m 1.6952 to 1.7117 fitted here" in text
    assert "1 more: constants, initial values, small or undetermined parts" in text
    assert "g −9.80 ± 0.10 m/s² −9.996 to −9.604" in text
    assert len(pictures_in(html, "svg+xml")) == 1


def test_page_explains_the_terms_that_it_uses_and_no_others():
    text = Tags(html_of(Page("clip", "The residual is noise.", "a bob", {}))).text
    assert TERMS["residual"] in text
    assert TERMS["score test"] not in text


def test_page_warns_only_of_what_it_was_given():
    plain = Page("clip", "length = 1.7", "a bob", {})
    assert 'class="warning"' not in html_of(plain)
    assert html_of(replace(plain, warnings=["the file ends early"])).count('class="warning"') == 1


def test_licence_of_the_charts_is_in_the_page():
    assert "Copyright (c) 2022 Leon Sorokin" in html_of(Page("clip", "", "", {}))


@pytest.mark.parametrize("name", MODELS)
def test_equation_of_every_model_can_be_drawn(name):
    assert png_of(figures.equation_figure(MODELS[name].equation)).startswith(b"\x89PNG")


@pytest.mark.parametrize("name", EFFECTS)
def test_equation_of_every_effect_can_be_drawn(name):
    assert png_of(figures.equation_figure(EFFECTS[name].equation)).startswith(b"\x89PNG")


def a_page(text="clip"):
    pictures = [PageImage(name, png_of(figures.equation_figure("x = 1")), name) for name in ("one", "two")]
    section = Section("Fit", equation=r"\ddot x = -g")
    return Page(text, text, text, {}, images=pictures, sections=[section])


def test_page_is_written_with_its_images_the_same_again(tmp_path):
    for name in ("a", "b"):
        assert clip_page.write_page(a_page(), tmp_path / name) == tmp_path / name / "report.html"
        page_module._equation_svg.cache_clear()
    assert set(listing(tmp_path / "a")) == {"one.png", "two.png", "report.html"}
    assert listing(tmp_path / "a") == listing(tmp_path / "b")


@pytest.mark.parametrize("name", ["one.png", "two.png", "report.html"])
def test_page_is_refused_whole_when_one_file_exists(name, tmp_path):
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"{name} exists already"):
        clip_page.write_page(a_page(), tmp_path)
    assert listing(tmp_path) == {name: b"mine"}
    clip_page.write_page(a_page(), tmp_path, overwrite=True)
    assert len(listing(tmp_path)) == 3


# --------------------------------------------------------------------------- of a clip


@pytest.fixture(scope="module")
def hostile_run(pendulum_clip, tmp_path_factory):
    """A run of a clip whose name and folder would be HTML."""
    clip = tmp_path_factory.mktemp("hostile") / "<script>alert(1)<" / "script><img src=x onerror=alert(1)>.mp4"
    clip.parent.mkdir()
    clip.write_bytes(pendulum_clip.read_bytes())
    return run(clip, "pendulum", settings={"ball_radius": Estimate(0.03, 0.001, "m", "direct", HOSTILE)})


def test_report_of_a_clip_with_a_hostile_name_is_safe(hostile_run, tmp_path):
    html = write_report(hostile_run, tmp_path).read_text("utf-8")
    page = assert_safe_and_alone(html)
    assert page.text.count("script><img src=x onerror=alert(1)>.mp4") >= 3  # title, heading, origin
    assert HOSTILE in page.text


def test_report_of_a_clip_is_complete(hostile_run, tmp_path):
    html = write_report(hostile_run, tmp_path).read_text("utf-8")
    assert set(listing(tmp_path)) == {"track.png", "fit.png", "report.html"}
    assert '<svg id="film"' in html
    assert {"chart-residual-0", "chart-motion-0"} <= {found.get("id") for _, found in Tags(html).tags}
    text = Tags(html).text
    for part in (
        "Parameters",
        "Uncertainty budget",
        "Calibration",
        "Identifiability",
        "Segments",
        "Intermediate quantities",
        "Checks",
        "Origin",
        "length",
        "rope_length",
        "hand",
        "motion",
        "arc_radius",
        "times the noise of",
        "Mean normalised innovation squared",
        "sha256",
    ):
        assert part in text, part
    assert "nan" not in text.split()


def test_report_has_the_number_large_with_its_symbol_and_both_axes_of_the_verdict(hostile_run, tmp_path):
    html = write_report(hostile_run, tmp_path).read_text("utf-8")
    top = html.partition('class="residual"')[0]
    assert re.search(r'class="value first"><span class="name">length <i>L</i></span>\s*<strong>0\.\d+ ± ', top)
    assert "Can the number be used?" in top
    assert "Is the equation complete?" in top


def test_report_does_not_warn_of_a_vertical_that_is_assumed(hostile_run, tmp_path):
    assert any("the vertical is the image's" in note for note in hostile_run.notes)
    html = write_report(hostile_run, tmp_path).read_text("utf-8")
    assert 'class="warning"' not in html
    assert "vertical is the image&#39;s, by assumption" in html
    wrong = replace(hostile_run, notes=(*hostile_run.notes, "the file ends early"))
    assert clip_page.clip_page(wrong).warnings == ["The file ends early."]


def test_tables_show_what_a_person_came_for_and_keep_the_rest_until_asked(hostile_run):
    parameters, budget, *_ = clip_page.clip_page(hostile_run).sections
    assert [row[0] for row in parameters.rows] == table_names(hostile_run.fit) == ["length", "damping"]
    assert {"pivot_across", "gravity", "theta_0"} <= {row[0] for row in parameters.more}
    assert {row[0] for row in budget.rows} <= set(table_names(hostile_run.fit))
    assert not [row for row in budget.rows if row[-1] == "0.0 %"]


def test_picture_of_a_tall_clip_is_no_taller_than_a_page(hostile_run):
    tall = DrawnClip([np.zeros((1200, 100, 3), np.uint8)] * 3)
    figure = figures.track_figure(tall, [], hostile_run.trajectory, hostile_run.calibration)
    width, height = figure.get_size_inches()
    assert height == pytest.approx(figures.TALLEST_IN)
    assert width == pytest.approx(figures.NARROWEST_IN)


def test_report_of_a_failed_fit_says_so(hostile_run, tmp_path):
    few = hostile_run.trajectory.valid & (np.cumsum(hostile_run.trajectory.valid) <= 3)
    short = fit(hostile_run.trajectory.with_(valid=few, segments=()), MODELS["pendulum"])
    failed = replace(hostile_run, fit=replace(short, origin=hostile_run.fit.origin))
    text = Tags(write_report(failed, tmp_path).read_text("utf-8")).text
    assert "No number could be measured: " in text
    assert "Failed: " in text
    assert "undetermined" in text
    assert 'class="value' not in (tmp_path / "report.html").read_text("utf-8")


def test_track_is_drawn_over_the_clip(hostile_run):
    figure = figures.track_figure(
        hostile_run.video, hostile_run.tracks, hostile_run.trajectory, hostile_run.calibration
    )
    (axes,) = figure.axes
    assert axes.images[0].get_array().shape == (90, 160, 3)
    assert {"motion", "pivot and arc"} <= {text.get_text() for text in axes.get_legend().get_texts()}
    assert axes.get_ylim() == (89.5, -0.5)


def test_multiple_exposure_shows_the_body_at_several_times():
    places = np.column_stack([np.linspace(10, 117, 30), np.full(30, 48.0)])
    picture = multiple_exposure([frame.bgr() for frame in moving_disc(places, 5.0, noise=0.0).sample(9)])
    bright = picture[48, :, 0] > 130
    assert 3 <= np.count_nonzero(np.diff(bright.astype(int)) == 1) <= PHASES


def test_fit_is_drawn_with_a_residual_under_each_quantity():
    t_s = np.linspace(0.0, 1.0, 40)
    rng = np.random.default_rng(2)
    position = np.column_stack([2.0 * t_s, 3.0 * t_s - 4.9 * t_s**2]) + rng.normal(0, 1e-3, (40, 2))
    quantities = (Quantity("x", "m"), Quantity("z", "m"))
    flight = Trajectory(t_s, quantities, position, np.full((40, 2), np.nan), np.ones(40, bool))
    figure = figures.fit_figure(flight, fit(flight, MODELS["projectile"]))
    assert [axes.get_ylabel() for axes in figure.axes] == ["x (m)", "residual (m)", "z (m)", "residual (m)"]


def test_samples_are_labelled_by_their_segment():
    trajectory = Trajectory(
        np.arange(4.0),
        (Quantity("z", "m"),),
        np.zeros((4, 1)),
        np.zeros((4, 1)),
        np.ones(4, bool),
        segments=(Segment("hand", 0, 1, ""), Segment("motion", 2, 4, "")),
    )
    assert figures.sample_labels(trajectory) == ["hand", "", "motion", "motion"]


# --------------------------------------------------------------------------- of a diagnosis


@pytest.fixture(scope="module")
def diagnosed(angles) -> tuple[Diagnosis, Trajectory]:
    trajectory = read_trajectory(angles)
    trajectory = trajectory.with_(origin={**trajectory.origin, "source": HOSTILE})
    effects = [EFFECTS["quadratic-drag"], EFFECTS["zero-offset"]]
    return diagnose(trajectory, MODELS["pendulum"], effects=effects), trajectory


def test_diagnosis_page_is_safe_and_complete(diagnosed, tmp_path):
    page = write_diagnosis(*diagnosed, tmp_path)
    assert diagnosed[0].components.parts == ()  # so that there is no picture of the parts
    assert set(listing(tmp_path)) == {"diagnosis.json", "residual.png", "state.png", "report.html"}
    assert set(listing(tmp_path)) <= set(FILES)
    html = assert_safe_and_alone(page.read_text("utf-8"))
    assert HOSTILE in html.text
    headings = ("Error", "Fit", "Score tests, round 1", "Upper limits on other effects")
    for part in (*headings, "quadratic-drag"):
        assert part in html.text, part


@pytest.mark.parametrize("name", FILES)
def test_diagnosis_is_refused_whole_when_one_file_exists(name, diagnosed, tmp_path):
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match=f"{name} exists already"):
        write_diagnosis(*diagnosed, tmp_path)
    assert listing(tmp_path) == {name: b"mine"}


# --------------------------------------------------------------------------- the overlay


def track_at(places: np.ndarray, fps: float = 60.0) -> Track:
    n = len(places)
    valid = np.isfinite(places[:, 0])
    return Track(np.arange(n) / fps, places, np.full((n, 2), 0.1), valid, np.arange(n), radius_px=np.full(n, 4.0))


def test_overlay_keeps_frames_and_times_and_crops_odd_sides(tmp_path):
    places = np.column_stack([np.linspace(20, 100, 12), np.full(12, 40.0)])
    places[5] = np.nan
    clip = moving_disc(places[[0, 1, 2, 3, 4, 4, 6, 7, 8, 9, 10, 11]], 4.0, shape=(95, 127))
    seen = []
    write_overlay(clip, [track_at(places)], tmp_path / "o.mp4", progress=lambda *now: seen.append(now))
    assert seen[-1] == (12, 12)
    with av.open(str(tmp_path / "o.mp4")) as container:
        frames = list(container.decode(video=0))
    assert (frames[0].width, frames[0].height) == (126, 94)
    assert [float(frame.pts * frame.time_base) for frame in frames] == pytest.approx(
        (np.arange(12) / 60).tolist(), abs=2e-5
    )
    blue = frames[8].to_ndarray(format="bgr24").astype(int)
    assert (blue[..., 0] - blue[..., 2]).max() > 60


def test_body_is_drawn_as_a_ring_where_it_is_and_not_in_a_gap():
    places = np.column_stack([np.full(3, 50.0), np.full(3, 40.0)])
    places[1] = np.nan
    for k, drawn in ((0, True), (1, False), (2, True)):
        picture = np.zeros((90, 100, 3), np.uint8)
        draw_body(picture, track_at(places), k / 60, (255, 255, 255))
        ring = np.argwhere(picture[..., 0] > 128)
        assert bool(len(ring)) == drawn
        if drawn:
            assert ring.mean(axis=0) == pytest.approx([40, 50], abs=0.5)
            assert np.hypot(*(ring - [40, 50]).T).max() == pytest.approx(1.3 * 4 + 2, abs=1.5)


def test_overlay_that_exists_is_refused(tmp_path):
    (tmp_path / "o.mp4").write_text("mine")
    places = np.full((3, 2), 40.0)
    with pytest.raises(OutputError, match="exists already"):
        write_overlay(moving_disc(places, 4.0), [track_at(places)], tmp_path / "o.mp4")
    assert listing(tmp_path) == {"o.mp4": b"mine"}


def test_overlay_of_a_clip_that_breaks_off_leaves_nothing(tmp_path):
    class Broken(DrawnClip):
        def frames(self):
            yield from list(super().frames())[:2]
            raise IrisError("the file ends here")

    clip = Broken(moving_disc(np.full((5, 2), 40.0), 4.0).images)
    with pytest.raises(IrisError, match="ends here"):
        write_overlay(clip, [track_at(np.full((5, 2), 40.0))], tmp_path / "o.mp4")
    assert listing(tmp_path) == {}


def test_image_files_can_be_read(hostile_run, tmp_path):
    write_report(hostile_run, tmp_path)
    for name in ("track.png", "fit.png"):
        picture = cv2.imread(str(tmp_path / name))
        assert picture.shape[1] > 900
        assert picture.std() > 5


def test_long_equation_is_drawn_whole():
    short, long = (figures.equation_figure(r"\ddot x = -k\,x" * count).get_size_inches()[0] for count in (1, 12))
    assert short == 6.0
    assert long > 10.0
