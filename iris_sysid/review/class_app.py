"""The page of a class on this machine, from which the review of each group opens."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from threading import Lock

from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.routing import Mount, Route
from starlette.types import ASGIApp, Receive, Scope, Send

from iris_sysid.review.app import application, page_app
from iris_sysid.review.guard import Guard
from iris_sysid.review.session import Session

# the page of a class holds its style and its script, and loads nothing
CONTENT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


class ClassReviews:
    """The reviews of the groups of a class, each opened when it is first asked for.

    Attributes
    ----------
    openers
        What opens the session of a group, by the group's name in an address.
    """

    def __init__(self, openers: Mapping[str, Callable[[], Session]]) -> None:
        self.openers = dict(openers)
        self._sessions: dict[str, Session] = {}
        self._lock = Lock()

    def session(self, group: str) -> Session:
        """The session of a ``group``; HTTPException where there is none, IrisError where it cannot be opened."""
        if group not in self.openers:
            raise HTTPException(404, "there is no such group")
        with self._lock:
            if group not in self._sessions:
                self._sessions[group] = self.openers[group]()
            return self._sessions[group]

    def close(self) -> None:
        """End the threads of all sessions."""
        for session in self._sessions.values():
            session.close()


def class_app(page: Callable[[str], str], reviews: ClassReviews, token: str, hosts: Iterable[str]) -> ASGIApp:
    """The application for a class: its page at ``/``, the review of a group at ``/review/<group>/``.

    Parameters
    ----------
    page
        The page as HTML, given the token, which every link needs.
    reviews
        The reviews of the groups.
    token
        Every request must carry it.
    hosts
        ``address:port`` under which the server may be reached.
    """

    def first(request: Request) -> Response:
        return HTMLResponse(page(token), headers={"content-security-policy": CONTENT_POLICY})

    app_of = cache(partial(page_app, token=token))

    async def review(scope: Scope, receive: Receive, send: Send) -> None:
        session = await run_in_threadpool(reviews.session, scope["path_params"]["group"])
        await app_of(session)(scope, receive, send)

    routes = [Route("/", first), Mount("/review/{group}", review)]
    return Guard(application(routes), token=token, hosts=hosts)
