"""The page of a review and what it asks the server for."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from importlib.resources import files
from typing import Any

import jinja2
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route
from starlette.types import ASGIApp

from iris_sysid.errors import DataError, IrisError
from iris_sysid.review.edits import parse_edit
from iris_sysid.review.guard import Guard
from iris_sysid.review.session import BehindError, ReplacedError, Session
from iris_sysid.review.views import clip_view, fit_view, state_view, tracking_view

ASSETS = {"page.js": "text/javascript", "review.js": "text/javascript", "review.css": "text/css"}
MAX_BYTES = 100_000  # of a request; an edit has some hundreds
PATIENCE_S = 20.0  # that a request for a fit waits
MAX_SIDE_PX = 16384


def review_app(session: Session, token: str, hosts: Iterable[str]) -> ASGIApp:
    """The application for one session, as a page of a server on this machine asks for it.

    Every request must carry the token; ``hosts`` are ``address:port`` under which the server may be reached.
    """
    return Guard(page_app(session, token), token=token, hosts=hosts)


def page_app(session: Session, token: str) -> ASGIApp:
    """The application for one ``session`` with its page, which knows the ``token``, behind a guard of the caller's."""
    page = [Route("/", partial(_page, session.clip.name, token)), Route("/static/{name}", _static)]
    return application([*page, *_routes(_Pages(session))])


def session_app(session: Session) -> ASGIApp:
    """The application for one ``session`` without page and guard, for callers in this process."""
    return application(_routes(_Pages(session)))


def application(routes: Sequence[BaseRoute]) -> Starlette:
    """The application of some ``routes``, whose errors are answered as JSON."""
    failures: Mapping[Any, Callable[[Request, Exception], Response]] = {
        IrisError: _failed,
        HTTPException: _refused,
        Exception: _unexpected,
    }
    return Starlette(routes=routes, exception_handlers=failures)


def _routes(pages: _Pages) -> list[Route]:
    return [
        Route("/frame/{number:int}.jpg", pages.frame),
        Route("/api/clip", pages.clip),
        Route("/api/state", pages.state),
        Route("/api/progress", pages.progress),
        Route("/api/fit", pages.fit),
        Route("/api/edit", pages.edit, methods=["POST"]),
        Route("/api/undo", pages.undo, methods=["POST"]),
        Route("/api/redo", pages.redo, methods=["POST"]),
        Route("/api/track", pages.track, methods=["POST"]),
        Route("/api/stop", pages.stop, methods=["POST"]),
        Route("/api/save", pages.save, methods=["POST"]),
    ]


def _page(name: str, token: str, request: Request) -> Response:
    return HTMLResponse(_templates().get_template("page.html").render(name=name, token=token))


def _static(request: Request) -> Response:
    name = request.path_params["name"]
    if name not in ASSETS:
        raise HTTPException(404, "there is no such file")
    return Response(asset(name), media_type=ASSETS[name])


class _Pages:
    """The answers, one method a route; those that compute run in a pool of threads."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def frame(self, request: Request) -> Response:
        width = _whole(request, "width", MAX_SIDE_PX)
        return Response(self.session.jpeg(request.path_params["number"], width), media_type="image/jpeg")

    def clip(self, request: Request) -> Response:
        return JSONResponse(clip_view(self.session))

    def state(self, request: Request) -> Response:
        return JSONResponse(state_view(self.session))

    def progress(self, request: Request) -> Response:
        return JSONResponse({"version": self.session.version, "tracking": tracking_view(self.session)})

    def fit(self, request: Request) -> Response:
        version = _whole(request, "version", 10**9)
        version = self.session.version if version is None else version
        whole = "whole" in request.query_params
        outcome = self.session.fits.outcome(version, PATIENCE_S, whole=whole)
        if outcome is None:
            return JSONResponse({"pending": True}, 202)
        return JSONResponse(fit_view(self.session, outcome))

    async def edit(self, request: Request) -> Response:
        content = await _content(request)
        return await self._change("edit", content)

    async def undo(self, request: Request) -> Response:
        return await self._change("undo", await _content(request))

    async def redo(self, request: Request) -> Response:
        return await self._change("redo", await _content(request))

    async def track(self, request: Request) -> Response:
        await _content(request)
        await run_in_threadpool(self.session.track)
        return JSONResponse(tracking_view(self.session))

    async def stop(self, request: Request) -> Response:
        await _content(request)
        self.session.stop_tracking()
        return JSONResponse(tracking_view(self.session))

    async def save(self, request: Request) -> Response:
        version = _version(await _content(request))
        names = await run_in_threadpool(self.session.save, version)
        return JSONResponse({"saved": names, "folder": str(self.session.folder)})

    async def _change(self, what: str, content: Mapping[str, Any]) -> Response:
        return await run_in_threadpool(self._changed, what, content)

    def _changed(self, what: str, content: Mapping[str, Any]) -> Response:
        edit = parse_edit(content.get("edit")) if what == "edit" else None
        known = self.session.state.tracks
        self.session.change(what, _version(content), edit)
        return JSONResponse(state_view(self.session, known))


async def _content(request: Request) -> Mapping[str, Any]:
    """The JSON object that a request holds; DataError where it holds none, HTTPException where it is too large."""
    if request.headers.get("content-type", "").partition(";")[0].strip() != "application/json":
        raise HTTPException(415, "a change is sent as application/json")
    body = b""
    async for part in request.stream():
        body += part
        if len(body) > MAX_BYTES:
            raise HTTPException(413, f"a change has at most {MAX_BYTES} bytes")
    try:
        content = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise DataError(f"no JSON: {error}") from error
    if not isinstance(content, dict):
        raise DataError("a change is a JSON object with version and edit")
    return content


def _version(content: Mapping[str, Any]) -> int:
    version = content.get("version")
    if not isinstance(version, int) or isinstance(version, bool):
        raise DataError(f"version must be a whole number, not {version!r:.40}")
    return version


def _whole(request: Request, name: str, most: int) -> int | None:
    """A whole number of the query from 0 to ``most``; None where it is not given."""
    text = request.query_params.get(name)
    if text is None:
        return None
    if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) <= most):
        raise DataError(f"{name} must be a whole number up to {most}, not {text!r:.40}")
    return int(text)


def _failed(request: Request, error: Exception) -> Response:
    if isinstance(error, BehindError):
        return JSONResponse({"error": str(error), "version": error.version}, 409)
    return JSONResponse({"error": str(error)}, 410 if isinstance(error, ReplacedError) else 400)


def _refused(request: Request, error: Exception) -> Response:
    status = error.status_code if isinstance(error, HTTPException) else 400
    return JSONResponse({"error": error.detail if isinstance(error, HTTPException) else str(error)}, status)


def _unexpected(request: Request, error: Exception) -> Response:
    return JSONResponse({"error": f"unexpected {type(error).__name__}: {error}"}, 500)


@cache
def _templates() -> jinja2.Environment:
    loader = jinja2.PackageLoader("iris_sysid", "review")
    return jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)


def markup(name: str) -> str:
    """The elements of a review of the clip of that ``name``, as HTML."""
    return _templates().get_template("review.html").render(name=name)


@cache
def asset(name: str) -> bytes:
    """A file of the page: its module, its style."""
    return files("iris_sysid.review").joinpath(name).read_bytes()
