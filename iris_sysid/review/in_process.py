"""Ask the application of a review in this process, without a server: what a notebook's messages do."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Message, Scope


@dataclass(frozen=True, slots=True)
class Answer:
    """What the application answered: status of HTTP, media type, and the bytes."""

    status: int
    media_type: str
    body: bytes


async def answer(app: ASGIApp, path: str, content: Any = None) -> Answer:
    """Send one request to an application, as ASGI 3 defines it.

    Parameters
    ----------
    app
        The application.
    path
        With its query.
    content
        Sent as JSON with POST; None asks with GET.
    """
    sent = b"" if content is None else json.dumps(content).encode()
    address = urlsplit(path)
    scope: Scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "GET" if content is None else "POST",
        "scheme": "http",
        "path": address.path,
        "raw_path": address.path.encode(),
        "query_string": address.query.encode(),
        "root_path": "",
        "headers": [] if content is None else [(b"content-type", b"application/json")],
    }
    events: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.request", "body": sent, "more_body": False}

    async def send(event: Message) -> None:
        events.append(event)

    try:
        await app(scope, receive, send)
    except Exception:
        if not events:  # Starlette raises what is unexpected again once it has answered
            raise
    started = next(event for event in events if event["type"] == "http.response.start")
    media_type = dict(started["headers"]).get(b"content-type", b"").decode("latin-1")
    body = b"".join(event.get("body", b"") for event in events if event["type"] == "http.response.body")
    return Answer(int(started["status"]), media_type, body)
