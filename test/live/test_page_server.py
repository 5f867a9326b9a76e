"""The page and what it is given: to this machine alone, under the names of this machine alone."""

import http.client
import json
import socket
from collections.abc import Iterator

import pytest

from cacc_platoon.errors import UserError
from cacc_platoon.live.page_server import HOST, MOST_CLIENTS, PageServer
from cacc_platoon.live.picture import Picture, VehicleNow

PICTURE = Picture("/platoon", "running", 5, 100, 0.01, vehicles=(VehicleNow(0, 5, velocity=25.0),))


@pytest.fixture
def page() -> Iterator[PageServer]:
    with PageServer(0) as server:
        server.show(PICTURE)
        yield server


def get(page: PageServer, path: str, host: str | None = None, method: str = "GET"):
    connection = http.client.HTTPConnection(HOST, page.port, timeout=10)
    connection.putrequest(method, path, skip_host=True)
    if host is None:
        host = f"127.0.0.1:{page.port}"
    if host:
        connection.putheader("Host", host)
    connection.endheaders()
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def test_the_newest_picture_is_served(page):
    answer, body = get(page, "/picture.json")
    assert (answer.status, answer.getheader("Content-Type")) == (200, "application/json")
    assert json.loads(body) == PICTURE.to_json()


def test_curves_are_kept_for_pages_opened_later(page):
    """One point for each sample at which vehicles were seen; of another run, anew."""

    def curves(sample: int, seen: int) -> list[tuple[int, list[float]]]:
        page.show(Picture("/platoon", "running", sample, 100, 0.01, vehicles=(at(seen),)))
        return [(one["sample"], one["speed"]) for one in json.loads(get(page, "/curves.json")[1])]

    def at(sample: int) -> VehicleNow:
        return VehicleNow(0, sample, velocity=25.0 + sample)

    assert curves(7, 5) == [(5, [25.0])]
    assert curves(9, 9) == [(5, [25.0]), (9, [34.0])]
    assert curves(2, 2) == [(2, [27.0])]


def test_the_page_needs_nothing_from_elsewhere(page):
    for path in ("/", "/live.js", "/live.css"):
        answer, body = get(page, path)
        assert answer.status == 200
        assert b"http://" not in body
        assert b"https://" not in body
        assert "default-src 'none'" in str(answer.getheader("Content-Security-Policy"))


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "LOCALHOST"])
def test_names_of_this_machine_are_served(page, name):
    assert get(page, "/picture.json", f"{name}:{page.port}")[0].status == 200


@pytest.mark.slow
@pytest.mark.parametrize(
    "host", ["", "evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:{port}x", "0.0.0.0"]
)
def test_other_names_are_refused(page, host):
    """As of a page elsewhere whose name leads here: DNS rebinding."""
    answer, body = get(page, "/picture.json", host.format(port=page.port))
    assert (answer.status, body) == (421, b"")


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", ["/../picture.json", "/page_server.py", "/etc/passwd", "/picture.json/"]
)
def test_nothing_else_is_served(page, path):
    assert get(page, path)[0].status == 404


def test_other_methods_are_refused(page):
    assert get(page, "/picture.json", method="POST")[0].status == 501
    answer, body = get(page, "/picture.json", method="HEAD")
    assert (answer.status, body) == (200, b"")


def test_only_this_machine_is_listened_to(page):
    assert page._server.server_address == ("127.0.0.1", page.port)


def test_a_port_that_is_taken_is_one_line(page):
    with pytest.raises(UserError, match=f"--port {page.port}: cannot be used"):
        PageServer(page.port)


@pytest.mark.slow
def test_clients_that_say_nothing_do_not_hold_up_others_without_end(page):
    """Too many connections are closed, and those that end make room again."""
    idle = [socket.create_connection((HOST, page.port)) for _ in range(MOST_CLIENTS + 5)]
    closed = 0
    for one in idle:
        one.settimeout(1.0 if closed == 0 else 0.01)
    assert idle[-1].recv(1) == b""
    for one in idle:
        one.close()
    deadline = 50
    while deadline:
        try:
            if get(page, "/picture.json")[0].status == 200:
                break
        except (OSError, http.client.HTTPException):
            deadline -= 1
    assert deadline
