"""Requests reach the review only from its own page: host, origin and token are checked, nothing is cached.

A server on the loopback interface can be reached by every page that the browser shows, and by names that an attacker
lets point to it (DNS rebinding). The host must therefore be the loopback address itself, a stated origin must be the
page's, and every request carries a random token.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterable
from urllib.parse import parse_qs

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_HEADER = "x-review-token"
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": CONTENT_POLICY,
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """ASGI middleware that refuses what does not come from the page of this server.

    Attributes
    ----------
    app
        The application behind it.
    token
        What the page knows.
    hosts
        ``address:port`` under which the server may be reached.
    """

    def __init__(self, app: ASGIApp, token: str, hosts: Iterable[str]) -> None:
        self.app, self.token, self.hosts = app, token, frozenset(hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # there are no web sockets

        async def with_headers(event: Message) -> None:
            if event["type"] == "http.response.start":
                headers = MutableHeaders(scope=event)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(event)

        refusal = self.refusal(scope)
        answer: ASGIApp = self.app if not refusal else JSONResponse({"error": refusal}, 403)
        await answer(scope, receive, with_headers)

    def refusal(self, scope: Scope) -> str:
        """Why a request is refused; empty where it is not."""
        headers = Headers(scope=scope)
        if headers.get("host", "") not in self.hosts:
            return "this server answers under its own address only"
        origin = headers.get("origin")
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return "this request comes from another page"
        if headers.get("sec-fetch-site", "none") not in ("same-origin", "none"):
            return "this request comes from another page"
        return "" if self._knows_token(scope, headers) else "the token is wrong: open the address that was printed"

    def _knows_token(self, scope: Scope, headers: Headers) -> bool:
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        stated = headers.get(TOKEN_HEADER) or (query.get("token") or [""])[0]
        return secrets.compare_digest(stated.encode("utf-8", "replace"), self.token.encode())
