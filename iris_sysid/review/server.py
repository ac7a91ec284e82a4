"""Serve a review on the loopback interface until it is interrupted."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable
from functools import partial

import uvicorn
from starlette.types import ASGIApp

from iris_sysid.errors import OutputError

ADDRESS = "127.0.0.1"
# on Windows SO_REUSEADDR lets any process take over a port that is in use
ALONE: int = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
LEAVE_AFTER_S = 2  # that requests under way are waited for at the end


def serve(
    app: Callable[[str, list[str]], ASGIApp], port: int, ready: Callable[[str], None], close: Callable[[], None]
) -> None:
    """Serve an application; returns when the process is interrupted.

    Parameters
    ----------
    app
        Makes it of the token and the hosts that it answers to.
    port
        Number of the port; 0 takes a free one.
    ready
        Called with the address to open, token included, once the server answers and heeds Ctrl-C.
    close
        Called at the end.

    Raises
    ------
    OutputError
        When the port is taken.
    """
    listening = listen(port)
    number = listening.getsockname()[1]
    token = secrets.token_urlsafe(24)
    hosts = [f"{name}:{number}" for name in (ADDRESS, "localhost")]
    config = uvicorn.Config(
        app(token, hosts),
        ws="none",  # a request for a web socket is one like any other
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_graceful_shutdown=LEAVE_AFTER_S,
    )
    server = _Announced(config, partial(ready, f"http://{ADDRESS}:{number}/?token={token}"))
    try:
        server.run(sockets=[listening])
    except KeyboardInterrupt:
        pass  # the end that is meant
    finally:
        listening.close()
        close()


class _Announced(uvicorn.Server):
    """A server that says when it has started: an interrupt before that would stop a half-made event loop."""

    def __init__(self, config: uvicorn.Config, started: Callable[[], None]) -> None:
        super().__init__(config)
        self._say_started = started

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to answer, and say so."""
        await super().startup(sockets)
        self._say_started()


def listen(port: int) -> socket.socket:
    """A socket that listens on the loopback interface alone, on that ``port``; OutputError when it is taken."""
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, ALONE, 1)
    try:
        listening.bind((ADDRESS, port))
        listening.listen(64)
    except OSError as error:
        listening.close()
        raise OutputError(f"port {port} cannot be used ({error.strerror}); give another --port, or none") from error
    return listening
