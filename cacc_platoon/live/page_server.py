"""Serves a page that shows a platoon, to this machine alone."""

from __future__ import annotations

import json
import threading
from collections import deque
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from types import TracebackType
from typing import Any, Self

from cacc_platoon.errors import UserError
from cacc_platoon.live.picture import Picture

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
"""What a browser may call this machine: a page from elsewhere that has its name lead here may not
read what is served (DNS rebinding)."""
TIMEOUT = 10.0
"""How long a client may be silent [s]."""
MOST_CLIENTS = 32
"""Connections that are served at a time."""
KEPT = 1500
"""Pictures whose curves are kept for pages that are opened later, five minutes of them."""

_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class PageServer:
    """Serves a page and the newest picture of a platoon.

    Parameters
    ----------
    port : int
        Where; 0 for any that is free.

    Raises
    ------
    UserError
        When the port is taken.
    """

    def __init__(self, port: int) -> None:
        self._picture: dict[str, Any] = {}
        self._curves: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()
        try:
            self._server = _Server((HOST, port), self)
        except OSError as error:
            raise UserError(
                f"--port {port}: cannot be used ({error.strerror}). Give another one, or 0 for any."
            ) from error
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)

    @property
    def port(self) -> int:
        """Where it serves."""
        return int(self._server.server_address[1])

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.port}/"

    def __enter__(self) -> Self:
        """Begin to serve."""
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Serve no longer."""
        self._server.shutdown()
        self._server.server_close()

    def show(self, picture: Picture) -> None:
        """Serve a picture from now on."""
        document = picture.to_json()
        with self._lock:
            last = self._curves[-1]["sample"] if self._curves else -1
            seen = picture.seen
            if seen < last:
                self._curves.clear()
            if seen != last and seen >= 0:
                self._curves.append(_curve(picture))
            self._picture = document

    def answer(self, path: str) -> tuple[str, bytes] | None:
        """Return type and body of what is at a path; None where nothing is."""
        with self._lock:
            if path == "/picture.json":
                return "application/json", json.dumps(self._picture).encode()
            if path == "/curves.json":
                return "application/json", json.dumps([*self._curves]).encode()
        return FILES.get(path)


def _curve(picture: Picture) -> dict[str, Any]:
    """Return what the page draws of a picture."""
    return {
        "sample": picture.seen,
        "time": round(picture.seen * picture.step, 9),
        "speed": [vehicle.velocity for vehicle in picture.vehicles],
        "spacing_error": [vehicle.spacing_error for vehicle in picture.vehicles],
        "gap": [vehicle.gap for vehicle in picture.vehicles],
    }


def _read_files() -> dict[str, tuple[str, bytes]]:
    folder = files("cacc_platoon.live") / "page"
    found = {}
    for name in ("index.html", "live.css", "live.js"):
        kind = f"{_TYPES[name.rpartition('.')[2]]}; charset=utf-8"
        found[f"/{name}"] = kind, (folder / name).read_bytes()
    return {**found, "/": found["/index.html"]}


FILES = _read_files()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], page: PageServer) -> None:
        self.page = page
        self.free = threading.BoundedSemaphore(MOST_CLIENTS)
        super().__init__(address, _Handler)
        port = self.server_address[1]
        self.names = {f"{name}:{port}" for name in NAMES} | ({*NAMES} if port == 80 else set())

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection, unless there are too many."""
        if self.free.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection in its thread."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a client that is gone."""


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "cacc_platoon", ""
    protocol_version = "HTTP/1.1"
    timeout = TIMEOUT

    def do_GET(self) -> None:
        """Answer a request."""
        self._answer(body=True)

    def do_HEAD(self) -> None:
        """Answer a request without the body."""
        self._answer(body=False)

    def _answer(self, *, body: bool) -> None:
        hosts = self.headers.get_all("Host", [])
        if len(hosts) != 1 or hosts[0].lower() not in self.server.names:
            self._send(HTTPStatus.MISDIRECTED_REQUEST, "text/plain", b"", body=body)
            return
        found = self.server.page.answer(self.path.partition("?")[0])
        if found is None:
            self._send(HTTPStatus.NOT_FOUND, "text/plain", b"there is nothing here\n", body=body)
        else:
            self._send(HTTPStatus.OK, *found, body=body)

    def _send(self, status: HTTPStatus, kind: str, content: bytes, *, body: bool) -> None:
        self.send_response(status)
        for name, value in _HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        if body:
            self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """Log nothing."""
