"""The review as a widget: what a teacher does, in a real browser, with the messages between widget and kernel."""

import base64
import json
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

import iris_sysid
from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import read_track
from iris_sysid.review.notebook import review_widget
from tests._browser import browser_is_there, needs_axe, serious_faults, started_browser
from tests.review._screen import NOW, Screen
from tests.review.conftest import OFF_PX, WRONG

WINDOW = "--window-size=1400,1000"

# What a notebook does for a widget: a model with its traits, and messages both ways; two views of one widget.
HOST_PAGE = """<!doctype html><body data-jp-theme-light="%(light)s"><div id="one"></div><div id="two"></div>
<script type="module">
const traits = await (await fetch("/traits")).json();
const widget = (await import(URL.createObjectURL(new Blob([traits._esm], { type: "text/javascript" })))).default;
const listeners = new Set();
const model = {
  get: (name) => traits[name],
  on: (name, listener) => listeners.add(listener),
  off: (name, listener) => listeners.delete(listener),
  send: async (content) => {
    const answer = await (await fetch("/message", { method: "POST", body: JSON.stringify(content) })).json();
    const bytes = Uint8Array.from(atob(answer.body), (letter) => letter.charCodeAt(0));
    for (const listener of [...listeners]) listener(answer.content, [new DataView(bytes.buffer)]);
  },
};
window.keys = [];
document.addEventListener("keydown", (event) => window.keys.push(event.key));
window.ends = [];
for (const id of %(views)s) window.ends.push(await widget.render({ model, el: document.getElementById(id) }));
window.messages = listeners;
</script>"""


@pytest.fixture
def widget(wrong_project):
    pytest.importorskip("anywidget")
    widget = review_widget(wrong_project[0] / "out")
    yield widget
    widget.close()


@contextmanager
def notebook(widget, views=("one",), light="") -> Iterator[str]:
    """The address of a page that shows a widget as a notebook does."""
    sent, ready = {}, threading.Condition()

    def send(content, buffers):
        with ready:
            sent[content["id"]] = {"content": content, "body": base64.b64encode(buffers[0]).decode()}
            ready.notify_all()

    widget.send = send
    traits = {name: getattr(widget, name) for name in ("_esm", "_module", "_style", "_markup")}
    page = HOST_PAGE % {"views": json.dumps(views), "light": light}

    class Answers(BaseHTTPRequestHandler):
        def do_GET(self):
            self.reply("application/json", json.dumps({name: str(value) for name, value in traits.items()})) if (
                self.path == "/traits"
            ) else self.reply("text/html", page)

        def do_POST(self):
            content = json.loads(self.rfile.read(int(self.headers["content-length"])))
            widget._handle_custom_msg(content, [])
            with ready:
                assert ready.wait_for(lambda: content["id"] in sent, 30)
            self.reply("application/json", json.dumps(sent.pop(content["id"])))

        def reply(self, kind, text):
            self.send_response(200)
            self.send_header("content-type", f"{kind}; charset=utf-8")
            self.end_headers()
            self.wfile.write(text.encode())

        def log_message(self, *_):
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Answers)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


class View(Screen):
    """A review in the shadow root of a widget."""

    def __init__(self, driver, view="one", size=(320, 180)):
        super().__init__(driver, None, size)
        self.root = f"return document.querySelector('#{view} > div').shadowRoot"

    def find(self, name):
        return self.driver.execute_script(f"{self.root}.getElementById(arguments[0])", name)

    def focus(self):
        """What a click on the stage does, without its point: the keys are the widget's from here on."""
        self.driver.execute_script("arguments[0].focus()", self.find("stage"))

    def value(self, name, column):
        script = f"{self.root}.querySelectorAll(arguments[0])[arguments[1]]?.innerText.trim() ?? ''"
        return self.driver.execute_script(script, f"#values tr[data-name='{name}'] :is(th, td)", column)

    def label(self):
        return self.find("stage").get_attribute("aria-label")


@pytest.fixture
def driver(tmp_path):
    browser_is_there()
    with started_browser(tmp_path / "profile", WINDOW) as driver:
        yield driver


@pytest.mark.slow
def test_three_points_are_corrected_the_scale_is_set_and_the_run_follows(wrong_project, widget, driver):
    project, right = wrong_project
    with notebook(widget) as address:
        driver.get(address)
        view = View(driver)
        view.until(lambda: view.text("fit-status").startswith("fitted"))
        opened = view.value("length", NOW)
        view.focus()
        for frame, (x, y) in zip(WRONG, right, strict=True):
            view.go_to(frame)
            view.drag((x + OFF_PX, y), (x, y))
            view.until(lambda: "edited" in view.label())
        view.keys("3")
        view.click(40, 20)
        view.click(40, 120)
        view.until(lambda: view.find("dialog").get_attribute("open"))
        view.keys("0.5+-0.001m", "\ue007")
        view.until(lambda: "scale bar of 0.5 m" in view.text("scene"))
        view.until(lambda: view.text("fit-status").startswith("fitted") and view.value("length", NOW) != opened)
        view.find("save").click()
        view.until(lambda: view.text("save") == "Saved")
        assert driver.execute_script("return window.keys") == []  # no key reaches the notebook's shortcuts
        assert view.errors() == []
        shown = view.value("length", NOW)
    assert shown.startswith(f"{widget.run.fit.estimates['length'].value:.3f}")
    (track,) = read_track(project / "out" / "track.csv")
    assert set(WRONG) <= set(np.flatnonzero(track.edited))
    assert np.abs(track.xy_px[list(WRONG)] - right).max() < 1.0
    assert np.array_equal(widget.tracks[0].edited, track.edited)


@needs_axe
@pytest.mark.slow
@pytest.mark.parametrize("light", ["true", "false"])
def test_axe_finds_nothing_serious_in_a_widget(light, widget, driver):
    with notebook(widget, light=light) as address:
        driver.get(address)
        view = View(driver)
        view.until(lambda: view.text("fit-status").startswith("fitted"))
        driver.execute_script("document.documentElement.lang = 'en'; document.title = 'a notebook'")
        assert serious_faults(driver) == []


@pytest.mark.slow
def test_two_views_of_a_widget_share_the_edits_and_nothing_else(widget, driver):
    with notebook(widget, ("one", "two"), light="false") as address:
        driver.get(address)
        one, two = View(driver), View(driver, "two")
        one.until(lambda: two.text("fit-status").startswith("fitted"))
        one.focus()
        one.go_to(30)
        one.until(lambda: one.text("where").startswith("frame 30 "))
        assert not two.text("where").startswith("frame 30 ")
        one.keys("\ue017")  # Delete
        one.until(lambda: "not there" in one.label())
        two.until(lambda: two.text("undo") == "Undo" and two.find("undo").is_enabled())
        assert "dark" in driver.execute_script("return document.querySelector('#one > div').className")
        driver.execute_script("window.ends.forEach((end) => end())")
        one.until(lambda: driver.execute_script("return window.messages.size") == 0)


def test_widget_answers_as_the_page_does(widget):
    sent = []
    widget.send = lambda content, buffers: sent.append((content, buffers))
    widget._answer({"id": "a", "path": "/api/state"})
    widget._answer({"id": "b", "path": "/frame/3.jpg?width=64"})
    edit = {"kind": "place", "body": "1", "frame": 50, "x": 1.5, "y": 2.5}
    version = json.loads(sent[0][1][0])["version"]
    widget._answer({"id": "c", "path": "/api/edit", "content": {"version": version, "edit": edit}})
    widget._answer({"id": "d", "path": "/api/edit", "content": {"version": version, "edit": edit}})
    widget._answer({"id": "e", "path": "/../etc/passwd"})
    widget._answer({"id": "f", "path": "/api/edit", "content": "nonsense"})
    assert [content["id"] for content, _ in sent] == list("abcdef")
    assert [content["status"] for content, _ in sent] == [200, 200, 200, 409, 404, 400]
    assert sent[1][0]["type"] == "image/jpeg"
    assert sent[1][1][0][:2] == b"\xff\xd8"
    assert widget.tracks[0].xy_px[50].tolist() == [1.5, 2.5]


def test_widget_of_a_clip_asks_what_moves(project, tmp_path):
    pytest.importorskip("anywidget")
    widget = review_widget(project / "pendulum.mp4", output=tmp_path / "new")
    try:
        assert widget.session.state.request.phenomenon is None
        with pytest.raises(DataError, match="recorded"):
            review_widget(project / "out", "pendulum")
    finally:
        widget.close()


def test_without_anywidget_the_remedy_is_named(project, monkeypatch):
    monkeypatch.setitem(sys.modules, "iris_sysid.review.widget", None)
    with pytest.raises(DataError, match=r"pip install 'iris-sysid\[notebook\]'"):
        iris_sysid.review_widget(project / "out")
