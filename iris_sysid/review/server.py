"""Serve a review on the loopback interface until it is interrupted."""

from __future__ import annotations

import secrets
import socket
from collections.abc import Callable

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
        Called with the address to open, token included, once the server listens.
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
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_graceful_shutdown=LEAVE_AFTER_S,
    )
    try:
        ready(f"http://{ADDRESS}:{number}/?token={token}")
        uvicorn.Server(config).run(sockets=[listening])
    except KeyboardInterrupt:
        pass  # the end that is meant
    finally:
        listening.close()
        close()


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
