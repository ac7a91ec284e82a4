"""Bytes that no browser sends, to the server itself: nothing outside is served, nothing reaches the terminal."""

import os
import re
import signal
import socket
import subprocess
import sys

import pytest

from iris_sysid.review.server import listen

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent as a signal")
OWN = "Host: {host}\r\nx-review-token: {token}\r\nConnection: close\r\n"
REQUESTS = {
    "GET /api/state HTTP/1.1\r\n" + OWN + "\r\n": 200,
    "GET /static/../../../../etc/passwd HTTP/1.1\r\n" + OWN + "\r\n": 404,
    "GET /static/..%2f..%2f..%2fetc%2fpasswd HTTP/1.1\r\n" + OWN + "\r\n": 404,
    "GET /frame/../../etc/passwd HTTP/1.1\r\n" + OWN + "\r\n": 404,
    "GET http://evil.example/etc/passwd HTTP/1.1\r\n" + OWN + "\r\n": 404,
    "GET / HTTP/1.0\r\nx-review-token: {token}\r\n\r\n": 403,
    "GET / HTTP/1.1\r\nHost: evil.example\r\nx-review-token: {token}\r\nConnection: close\r\n\r\n": 403,
    "GET /?token={token}x HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n": 403,
    "OPTIONS /api/edit HTTP/1.1\r\n" + OWN + "Origin: http://evil.example\r\n\r\n": 403,
    "GET /api/state HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n": 403,
    "PUT /api/edit HTTP/1.1\r\n" + OWN + "Content-Length: 0\r\n\r\n": 405,
    "GET / HTTP/1.1\r\n" + OWN + "X-Long: " + 200_000 * "a" + "\r\n\r\n": 400,
    "no request at all\r\n\r\n": 400,
}


def _heeds_ctrl_c():
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def answered(port, text):
    """All bytes of the answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
        connection.sendall(text.encode())
        answer = b""
        try:
            while part := connection.recv(65536):
                answer += part
        except (ConnectionResetError, TimeoutError):  # an upgrade that is refused is left open
            pass
    return answer


def test_raw_requests_are_answered_or_refused_and_the_server_lives(pendulum_clip, tmp_path):
    command = [sys.executable, "-m", "iris_sysid", "review", str(pendulum_clip), "-o", str(tmp_path / "out")]
    process = subprocess.Popen([*command, "--no-browser"], stderr=subprocess.PIPE, text=True, preexec_fn=_heeds_ctrl_c)
    try:
        host, token = re.search(r"http://(\S+)/\?token=(\S+)", process.stderr.readline()).groups()
        port = int(host.rpartition(":")[2])
        for request, status in [*REQUESTS.items(), next(iter(REQUESTS.items()))]:
            answer = answered(port, request.format(host=host, token=token))
            assert answer.startswith(f"HTTP/1.1 {status} ".encode()), request[:80]
            assert b"root:" not in answer
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert "Traceback" not in said
    assert "ERROR" not in said
    assert process.returncode == 0


def test_server_listens_on_the_loopback_interface_alone():
    with listen(0) as listening:
        assert listening.getsockname()[0] == "127.0.0.1"
