"""Who may see the page's data and press its buttons: real requests to a running page."""

from __future__ import annotations

import asyncio
import shlex
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock
from urllib.parse import urlsplit

import pytest
from live_client import PATIENCE_S, ask, command, events, page, until
from starlette.applications import Starlette
from uvicorn import Config
from uvicorn.server import ServerState

from daq.logger import Command
from wheelsoil.live import PagePanel
from wheelsoil.web.serving import LARGEST_BODY_BYTES, Connection, Rules

TOKEN = "a-token-of-the-test"
OWN = ("/", "/page.css", "/page.js", "/parts.js", "/plot.js", "/connection.js", "/commands.js")
PAGE = (*OWN, "/tokens.css", "/dom.js", "/drawing.js", "/token.js", "/icon.svg")
MARK = {"kind": "mark", "text": ""}


@pytest.fixture(scope="module")
def local() -> Iterator[PagePanel]:
    with page() as panel:
        yield panel


@pytest.fixture(scope="module")
def closed() -> Iterator[PagePanel]:
    """A page that everybody can reach and that needs its token."""
    with page("0.0.0.0", TOKEN) as panel:
        yield panel


@pytest.fixture(autouse=True)
def _nothing_waits(local: PagePanel, closed: PagePanel) -> Iterator[None]:
    yield
    for panel in (local, closed):
        while panel.commands():
            pass


@pytest.mark.parametrize(
    "given", ["", "Bearer", "Bearer wrong", f"Basic {TOKEN}", f"Bearer {TOKEN}x", f"bearer {TOKEN}"]
)
def test_without_the_token_neither_data_nor_action(closed: PagePanel, given: str) -> None:
    headers = {"Authorization": given} if given else {}
    answer = ask(closed, "GET", "/events", headers=headers)
    assert answer.status == 401 and "a tractor" not in answer.text  # type: ignore[attr-defined]
    assert command(closed, MARK, Authorization=given) == 401
    assert closed.commands() == []


def test_connections_without_the_token_do_not_hold_all_places(closed: PagePanel) -> None:
    """Those who keep asking for what needs no token, and those who ask for nothing."""
    strangers = []
    try:
        with events(closed) as stream:
            for number in range(100):
                strangers.append(socket.create_connection(("127.0.0.1", closed.port), timeout=PATIENCE_S))
                if number % 2:
                    strangers[-1].sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{closed.port}\r\n\r\n".encode())
            assert command(closed, MARK) == 202
            assert ask(closed, "GET", "/").status == 200
            assert next(name for name, _ in stream if name != "hello") == ""
            with events(closed) as another:
                assert next(another)[0] == "hello"
    finally:
        for stranger in strangers:
            stranger.close()


def test_the_empty_page_needs_no_token_and_tells_nothing(closed: PagePanel) -> None:
    for path in PAGE:
        answer = ask(closed, "GET", path)
        assert answer.status == 200
        assert "tractor" not in answer.text and TOKEN not in answer.text  # type: ignore[attr-defined]


def test_the_token_opens(closed: PagePanel) -> None:
    assert command(closed, MARK) == 202
    assert until(closed.commands, "the mark")


def test_the_token_in_the_address_is_no_token(closed: PagePanel) -> None:
    assert ask(closed, "GET", f"/events?token={TOKEN}").status == 401


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "192.0.2.7", ""])
def test_another_name_for_this_machine_is_refused(local: PagePanel, host: str) -> None:
    for path in ("/", "/events"):
        assert ask(local, "GET", path, headers={"Host": f"{host}:{local.port}"}).status == 421
    assert command(local, MARK, Host=f"{host}:{local.port}", Origin=f"http://{host}:{local.port}") == 421
    assert local.commands() == []


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST", "127.0.0.1", "[::1]", "localhost."])
def test_this_machines_own_names_are_taken_whatever_the_port(local: PagePanel, host: str) -> None:
    for name in (f"{host}:{local.port}", f"{host}:9000", host):  # a forwarded port is another one
        assert ask(local, "GET", "/", headers={"Host": name}).status == 200
        assert command(local, MARK, Host=name, Origin=f"http://{name}") == 202


def test_over_the_network_addresses_and_own_names_are_taken_and_no_others(closed: PagePanel) -> None:
    for host in ("10.42.0.1", "[fe80::1]", "logger.local", socket.gethostname()):
        assert ask(closed, "GET", "/", headers={"Host": f"{host}:{closed.port}"}).status == 200, host
    for host in ("evil.example", "local.evil.example", "10.42.0.1.evil.example"):
        assert ask(closed, "GET", "/", headers={"Host": f"{host}:{closed.port}"}).status == 421, host


def test_a_page_that_listens_on_a_name_answers_to_it() -> None:
    assert Rules.of("Logger.Lan", "10.42.0.1", TOKEN).knows_host("logger.lan:8137")


def test_two_host_headers_are_refused(local: PagePanel) -> None:
    request = f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{local.port}\r\nHost: evil.example\r\n\r\n"
    with socket.create_connection(("127.0.0.1", local.port), timeout=PATIENCE_S) as raw:
        raw.sendall(request.encode())
        assert raw.recv(4096).split()[1] in (b"400", b"421")


@pytest.mark.parametrize(
    "origin",
    ["null", "http://evil.example", "http://127.0.0.1", "http://localhost:1", "file://", "http://127.0.0.1:"],
)
def test_a_button_on_another_sites_page_does_nothing(local: PagePanel, origin: str) -> None:
    assert command(local, MARK, Origin=origin) == 403
    assert local.commands() == []


def test_a_program_states_no_origin(local: PagePanel, closed: PagePanel) -> None:
    assert command(local, MARK, Origin="") == command(closed, MARK, Origin="") == 202
    assert command(closed, MARK, Origin="", Authorization="") == 401
    assert command(local, MARK, Origin="", Host=f"evil.example:{local.port}") == 421
    assert command(local, MARK, Origin="", Sec_Fetch_Site="cross-site") == 403


def test_the_documented_commands_of_curl(closed: PagePanel) -> None:
    text = (Path(__file__).parents[2] / "docs/status-page.md").read_text(encoding="utf-8")
    lines = [line for line in text.replace("\\\n", "").splitlines() if line.startswith("curl ")]
    for line in lines:
        line = line.replace("http://127.0.0.1:8100", f"http://127.0.0.1:{closed.port}").replace("$TOKEN", TOKEN)
        subprocess.run([*shlex.split(line)], check=True, capture_output=True, timeout=PATIENCE_S)
    got: list[Command] = []
    until(lambda: got.extend(closed.commands()) or len(got) >= 3, "the commands")
    assert got == [Command("start", "field-7"), Command("mark", "stone under the wheel"), Command("stop")]


def test_a_text_that_is_too_long_is_reported_with_the_limit(local: PagePanel) -> None:
    body = b'{"kind": "start", "text": "' + b"x" * 201 + b'"}'
    answer = ask(local, "POST", "/command", body, {"Content-Type": "application/json"})
    assert (answer.status, "at most 200 characters" in answer.text) == (400, True)  # type: ignore[attr-defined]


def test_another_site_does_not_read_the_stream(local: PagePanel) -> None:
    answer = ask(local, "GET", "/events", headers={"Origin": "http://evil.example"})
    assert answer.status == 403 and "access-control-allow-origin" not in answer.headers


def test_a_preflight_gets_no_leave(local: PagePanel) -> None:
    asked = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    answer = ask(local, "OPTIONS", "/command", headers=asked)
    assert answer.status == 403 and not [name for name in answer.headers if name.startswith("access-control")]


@pytest.mark.parametrize("kind", ["", "text/plain", "application/x-www-form-urlencoded", "multipart/form-data"])
def test_a_form_of_another_site_is_no_command(local: PagePanel, kind: str) -> None:
    assert command(local, MARK, Content_Type=kind) == 415
    assert local.commands() == []


def test_a_body_is_small_and_its_size_stated(local: PagePanel) -> None:
    assert command(local, b" " * (LARGEST_BODY_BYTES + 1)) == 413
    request = (
        f"POST /command HTTP/1.1\r\nHost: 127.0.0.1:{local.port}\r\nOrigin: http://127.0.0.1:{local.port}\r\n"
        "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", local.port), timeout=PATIENCE_S) as raw:
        raw.sendall(request.encode())
        assert raw.recv(4096).split()[1] == b"411"


def test_a_size_that_is_not_the_bodys_is_not_believed(local: PagePanel) -> None:
    """A chunked body may be of any length, whatever Content-Length says beside it."""
    request = (
        f"POST /command HTTP/1.1\r\nHost: 127.0.0.1:{local.port}\r\nOrigin: http://127.0.0.1:{local.port}\r\n"
        "Content-Type: application/json\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
        '1a\r\n{"kind":"mark","text":"x"}\r\n0\r\n\r\n'
    )
    with socket.create_connection(("127.0.0.1", local.port), timeout=PATIENCE_S) as raw:
        raw.sendall(request.encode())
        assert raw.recv(4096).split()[1] == b"411"
    assert local.commands() == []


@pytest.mark.parametrize("site", ["cross-site", "same-site", "none"])
def test_a_picture_on_another_sites_page_takes_no_browsers_place(local: PagePanel, site: str) -> None:
    assert ask(local, "GET", "/events", headers={"Sec-Fetch-Site": site}).status == 403
    assert ask(local, "GET", "/", headers={"Sec-Fetch-Site": site, "Sec-Fetch-Mode": "navigate"}).status == 200


@pytest.mark.parametrize("path", ["/", "/events", "/nothing", "/../../etc/passwd", "/static/page.html"])
def test_every_answer_tells_the_browser_what_it_may_do(closed: PagePanel, path: str) -> None:
    answer = ask(closed, "GET", path)
    policy = dict(part.strip().split(" ", 1) for part in answer.headers["content-security-policy"].split(";"))
    assert policy["default-src"] == "'none'" and policy["frame-ancestors"] == "'none'"
    assert set(policy.values()) <= {"'none'", "'self'"}
    assert answer.headers["x-frame-options"] == "DENY"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cache-control"] == "no-store"
    assert "server" not in answer.headers


@pytest.mark.parametrize(("method", "path"), [("GET", "/command"), ("POST", "/events"), ("PUT", "/command")])
def test_other_methods_are_refused(local: PagePanel, method: str, path: str) -> None:
    headers = {"Origin": f"http://127.0.0.1:{local.port}", "Content-Type": "application/json"}
    assert ask(local, method, path, b"{}", headers).status == 405


def test_nothing_is_loaded_from_elsewhere(local: PagePanel) -> None:
    namespace = "http://www.w3.org/2000/svg"  # a name, not an address
    for path in PAGE:
        text = ask(local, "GET", path).text.replace(namespace, "")  # type: ignore[attr-defined]
        assert "http://" not in text and "https://" not in text
        assert not [line for line in text.splitlines() if "url(" in line or "@import" in line]


def test_the_address_carries_the_token_where_no_server_sees_it(closed: PagePanel) -> None:
    url = urlsplit(closed.address)
    assert url.fragment == TOKEN and TOKEN not in url.path + url.query


def test_of_33_connections_without_the_token_the_oldest_is_closed() -> None:
    async def aborted() -> list[int]:
        config, state = Config(app=Starlette(), log_config=None), ServerState()
        config.load()
        transports = [Mock(asyncio.Transport, get_extra_info=Mock(return_value=None)) for _ in range(33)]
        connections = [Connection(config, state, {}, asyncio.get_running_loop()) for _ in transports]
        counts = []
        for connection, transport in zip(connections, transports, strict=True):
            connection.connection_made(transport)
            counts.append(sum(each.abort.called for each in transports))
        assert transports[0].abort.called
        for connection in connections:
            connection.connection_lost(None)
        return counts

    assert asyncio.run(aborted()) == [0] * 32 + [1]
