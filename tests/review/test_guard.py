"""Nothing is served, and nothing changed, for anyone but the page of this server."""

import pytest
from starlette.testclient import TestClient

from tests.review.conftest import HOST, TOKEN

PATHS = ["/", "/api/clip", "/api/state", "/api/fit", "/api/progress", "/frame/0.jpg", "/static/review.js"]
EDIT = {"kind": "delete", "body": "1", "first": 10, "last": 12}


def client(page, host=HOST, **headers):
    return TestClient(page.client.app, base_url=f"http://{host}", headers=headers, raise_server_exceptions=False)


@pytest.mark.parametrize("path", PATHS)
def test_right_token_is_served(path, page):
    assert client(page, **{"x-review-token": TOKEN}).get(path).status_code == 200


@pytest.mark.parametrize("token", ["", "wrong", TOKEN[:-1], f"{TOKEN}x", "é"])
@pytest.mark.parametrize("path", PATHS)
def test_wrong_token_is_refused(path, token, page):
    headers = {"x-review-token": token.encode()} if token else {}
    answer = client(page).get(path, headers=headers)
    assert answer.status_code == 403
    assert "token" in answer.json()["error"]


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:8080", "http://127.0.0.1:8081"])
def test_another_origin_is_refused_even_with_the_token(origin, page, session):
    answer = client(page, **{"x-review-token": TOKEN, "origin": origin}).post(
        "/api/edit", json={"version": page.version, "edit": EDIT}
    )
    assert answer.status_code == 403
    assert session.version == 1


def test_request_that_the_browser_calls_cross_site_is_refused(page):
    headers = {"x-review-token": TOKEN, "sec-fetch-site": "cross-site"}
    assert client(page, **headers).get("/frame/0.jpg").status_code == 403


@pytest.mark.parametrize("host", ["evil.example:8080", "127.0.0.1", "127.0.0.1:1", "localhost.evil.example:8080"])
def test_another_host_is_refused(host, page):
    assert client(page, host, **{"x-review-token": TOKEN}).get("/api/state").status_code == 403


def test_every_answer_forbids_scripts_from_elsewhere_and_other_pages_to_read_it(page):
    for path in [*PATHS, "/nothing"]:
        headers = page.get(path).headers
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["cross-origin-resource-policy"] == "same-origin"
        assert headers["cache-control"] == "no-store"
        assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "path",
    [
        "/static/../pyproject.toml",
        "/static/..%2f..%2fpyproject.toml",
        "/static/app.py",
        "/static//etc/passwd",
        "/frame/../../etc/passwd",
        "/frame/-1.jpg",
        "/frame/1e9.jpg",
        "/out/fit.json",
        "/review.jsonl",
        "//etc/passwd",
    ],
)
def test_paths_outside_are_not_served(path, page):
    answer = page.get(path)
    assert answer.status_code == 404
    assert "root:" not in answer.text


def test_change_that_is_no_json_is_refused(page, session):
    for content_type in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data"):
        answer = page.client.post("/api/undo", content=b'{"version": 1}', headers={"content-type": content_type})
        assert answer.status_code == 415
    assert page.client.post("/api/undo", content=b"[", headers={"content-type": "application/json"}).status_code == 400
    assert session.version == 1


def test_change_that_is_too_large_is_refused(page):
    answer = page.post("/api/edit", edit={"kind": "drop", "body": "x" * 200_000})
    assert answer.status_code == 413


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        ({"kind": "place", "body": "1", "frame": 10, "x": float("nan"), "y": 1.0}, "x"),
        ({"kind": "place", "body": "1", "frame": 10, "x": 1e9, "y": 1.0}, "x"),
        ({"kind": "place", "body": "1", "frame": 99999, "x": 1.0, "y": 1.0}, "frame 99999 is not among"),
        ({"kind": "place", "body": "1", "frame": 10, "x": 1.0, "y": 1.0, "zoom": 0}, "zoom"),
        ({"kind": "place", "body": "", "frame": 10, "x": 1.0, "y": 1.0}, "body"),
        ({"kind": "tracked", "file": "../../etc/passwd"}, "file"),
        ({"kind": "tracked", "file": "review-track-1.csv"}, "ask for tracking"),
        ({"kind": "swap", "body": "1", "other": "1", "frame": 3}, "itself"),
        ({"kind": "drop", "body": "7"}, "there is no body '7'; there are 1"),
        ({"kind": "scale", "ends": [0, 0, 0, 100], "length": "five"}, "five"),
        ({"kind": "scale", "ends": [5, 5, 5, 5], "length": "1m"}, "px apart"),
        ({"kind": "phenomenon", "name": "/tmp/mine.py:x"}, "no phenomenon is named"),
        ({"kind": "format-disk"}, "format-disk"),
        ({"kind": "drop", "body": "1", "more": 1}, "more"),
        (None, "edit"),
    ],
)
def test_edit_that_cannot_be_made_says_why_and_changes_nothing(edit, said, page, session):
    import json

    before = (session.folder / "review.jsonl").read_bytes()
    content = json.dumps({"version": page.version, "edit": edit})
    answer = page.client.post("/api/edit", content=content, headers={"content-type": "application/json"})
    assert answer.status_code == 400
    assert said in answer.json()["error"]
    assert session.version == 1
    assert (session.folder / "review.jsonl").read_bytes() == before


@pytest.mark.parametrize("version", [None, "1", 1.5, True])
def test_change_without_a_version_is_refused(version, page):
    answer = page.client.post("/api/undo", json={"version": version})
    assert answer.status_code == 400
    assert "version" in answer.json()["error"]


def test_name_of_the_clip_is_escaped_on_the_page(project, opened, tmp_path):
    from iris_sysid.review.opening import open_clip
    from iris_sysid.review.request import ReviewRequest
    from tests.review.conftest import page_of

    odd = (project / "pendulum.mp4").rename(project / "<script>alert(1)</script>.mp4".replace("/", "_"))
    session = open_clip(odd, tmp_path / "odd", ReviewRequest())
    try:
        text = page_of(session).get("/").text
    finally:
        session.close()
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert" in text
