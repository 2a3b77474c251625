"""Every route of the analyst's page against what it must refuse: a clear fault each, and nothing is changed."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from view_client import View, taken_from
from view_in_process import viewing_here

from wheelsoil.cli.options import page_token

ROOT = Path(__file__).parents[2]
TOKEN = "a-token-of-the-test"
GETS = (
    "/api/list",
    "/api/run?campaign=c1&run=r1",
    "/api/signals?campaign=c1&run=r1",
    "/api/signal?campaign=c1&run=r1&name=x",
    "/api/compare?campaign=c1&run=&campaign_b=c1&run_b=r2",
    "/api/parameters?campaign=c1",
    "/api/diagnosis?campaign=c1",
)
POSTS: dict[str, dict[str, Any]] = {
    "/api/curve": {},
    "/api/prediction": {"run": "r1"},
    "/api/cancel": {},
    "/api/selected": {"run": "r1", "kind": "time"},
    "/api/choose": {"choice": {}},
    "/api/fit": {},
    "/api/diagnose": {},
    "/api/save": {"name": "choice.toml"},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return taken_from(ROOT / "recordings" / "clay", tmp_path_factory.mktemp("contract") / "clay", 2)


@pytest.fixture(autouse=True)
def _nothing_changes(view: View, folder: Path) -> Iterator[None]:
    before = (view.campaigns(), sorted(folder.iterdir()), sorted(folder.parent.iterdir()))
    yield
    assert (view.campaigns(), sorted(folder.iterdir()), sorted(folder.parent.iterdir())) == before


@pytest.mark.parametrize("path", POSTS)
@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"{",
        b"[]",
        b"null",
        b'"c1"',
        b'{"campaign": NaN}',
        b'{"campaign": "c1", "load_n": Infinity}',
        b"\xff\xfe",
        b'{"campaign": ' * 5000,
        b'{"campaign": ' + b"9" * 5000 + b"}",
        b"{}",
        b'{"campaign": 1}',
        b'{"campaign": null}',
        b'{"campaign": ["c1"]}',
        b'{"campaign": "c1", "surprise": 1}',
    ],
    ids=lambda body: body[:24].decode("latin-1"),
)
def test_a_body_that_is_wrong_is_a_fault(view: View, path: str, body: bytes) -> None:
    answer = view.ask("POST", path, body)
    assert answer.status == 400, answer.body
    assert answer.faults


@pytest.mark.parametrize("key", ["c2", "", "<script>", "../c1", "\ud800"])
def test_an_unknown_campaign_is_not_found(view: View, key: str) -> None:
    for path, asked in POSTS.items():
        answer = view.ask("POST", path, json.dumps({"campaign": key, **asked}).encode())
        assert answer.status in (400, 404), path
        assert answer.faults and answer.headers["content-type"] == "application/json"
    assert view.tell("/api/fit", campaign="c2").status == 404


@pytest.mark.parametrize("query", ["", "?campaign=c9", "?campaign=c9&run=r1", "?campaign=%3Cscript%3E", "?campaign="])
@pytest.mark.parametrize("path", ["/api/run", "/api/parameters", "/api/diagnosis"])
def test_an_unknown_key_in_the_address_is_not_found(view: View, path: str, query: str) -> None:
    answer = view.ask("GET", path + query)
    assert answer.status in (400, 404)
    assert answer.faults


@pytest.mark.parametrize(
    "query", ["campaign=c1&run=r9", "campaign=c1&run=", "campaign=c1", "campaign=c1&run=r1&run=r2"]
)
def test_an_unknown_run_is_not_found(view: View, query: str) -> None:
    answer = view.ask("GET", f"/api/run?{query}")
    assert answer.status == (404 if query.count("run=") == 1 else 400)
    assert answer.faults


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"effects": ["vasilyev"]}, "vasilyev"),
        ({"effects": ["<script>"]}, "<script>"),
        ({"effects": ["vasilev"], "values": {"H_m": 5.0}}, "out of bounds"),
        ({"effects": ["vasilev"], "values": {"H_m": -1e-9}}, "out of bounds"),
        ({"effects": ["vasilev"], "values": {"H_m": "0.1"}}, "values.H_m"),
        ({"effects": ["vasilev"], "values": {"H_m": True}}, "values.H_m"),
        ({"effects": ["vasilev"], "values": {"H_m": None}}, "values.H_m"),
        ({"effects": [], "values": {"H_m": 0.1}}, "H_m"),
        ({"values": {"radius_m": 0.5}}, "radius_m"),
        ({"soil": {"tan_phi": -0.1}}, "out of bounds"),
        ({"soil": {"tan_fi": 0.1}}, "tan_fi"),
        ({"soil": {"cohesion_pa": 1e300}}, "out of bounds"),
        ({"load_n": 0.0}, "load_n"),
        ({"load_n": -9e3}, "load_n"),
        ({"sinkage": "deep"}, "sinkage"),
        ({"effects": ["vasilev", "vasilev"]}, "parameter"),
        ({"effects": ["vasilev"] * 40}, "effects"),
        ({"values": [0.1]}, "values"),
    ],
    ids=str,
)
def test_a_curve_that_cannot_be_drawn_is_a_fault(view: View, asked: dict[str, Any], said: str) -> None:
    answer = view.tell("/api/curve", campaign="c1", **asked)
    assert answer.status == 400
    assert any(said in fault["what"] for fault in answer.faults), answer.faults


def test_all_faults_of_a_curve_are_reported_at_once(view: View) -> None:
    answer = view.tell("/api/curve", campaign="c1", effects=["nix", "ding"], values={"n1": 99, "m1": 0}, soil={"x": 1})
    assert len(answer.faults) == 4


@pytest.mark.parametrize(
    "choice",
    [
        {"schema": "wheelsoil/choice/2"},
        {"slip_threshold": 1.0},
        {"slip_threshold": "0.1"},
        {"cutoff_hz": 0},
        {"cutoff_hz": 50.0},
        {"min_speed_mps": -1.0},
        {"channels": []},
        {"channels": ["x"]},
        {"sinkage": "deep"},
        {"effects": ["nix"]},
        {"run": {}},
        {"run": [{"id": "run-9"}]},
        {"run": [{"id": "run-1"}, {"id": "run-1"}]},
        {"run": [{"use": False}]},
        {"run": [{"id": "run-1", "use": False}, {"id": "run-2", "use": False}]},
        {"run": [{"id": "run-1", "keep": []}]},
        {"run": [{"id": "run-1", "keep": [[5, 5]]}]},
        {"run": [{"id": "run-1", "keep": [[0, 10], [5, 20]]}]},
        {"run": [{"id": "run-1", "keep": [[0, 1000]]}]},
        {"run": [{"id": "run-1", "keep": [[-5, 10]]}]},
        {"run": [{"id": "run-1", "sha256": "abc"}]},
        {"surprise": 1},
    ],
    ids=str,
)
def test_a_choice_that_does_not_fit_changes_nothing(view: View, choice: dict[str, Any]) -> None:
    answer = view.tell("/api/choose", campaign="c1", choice=choice)
    assert answer.status == 400
    assert answer.faults


@pytest.mark.parametrize(
    "name",
    [
        "",
        " ",
        ".toml",
        "..",
        "../choice.toml",
        "../../choice.toml",
        "/tmp/choice.toml",
        "a/choice.toml",
        "a\\choice.toml",
        "choice.toml/",
        "choice.txt",
        "choice",
        ".choice.toml",
        "choice\n.toml",
        "choice\0.toml",
        "\ud800.toml",
        "x" * 300 + ".toml",
        "x" * 119 + "é.toml",
        "vehicle.toml",
        "TERRAIN.toml",
        "runs.toml",
        "zero.toml",
        "manifest.toml",
    ],
    ids=ascii,
)
@pytest.mark.parametrize("over", [False, True])
def test_only_a_plain_name_is_written(view: View, name: str, over: bool) -> None:
    answer = view.tell("/api/save", campaign="c1", name=name, replace=over)
    assert answer.status == 400
    assert answer.faults


def test_another_file_of_the_folder_is_not_replaced_by_a_link(view: View, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text("kept")
    link = folder / "link.toml"
    link.symlink_to(other)
    assert view.tell("/api/save", campaign="c1", name="link.toml").status == 400
    assert other.read_text() == "kept"
    link.unlink()


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/api/curve", 405),
        ("POST", "/api/list", 405),
        ("GET", "/api/nothing", 404),
        ("GET", "/../wheelsoil/view/server.py", 404),
        ("GET", "/static/page.html", 404),
        ("PUT", "/api/save", 405),
    ],
)
def test_other_paths_and_methods_are_refused(view: View, method: str, path: str, status: int) -> None:
    body = b"{}" if method == "POST" else None
    assert view.ask(method, path, body).status == status


def test_the_guard_of_the_loggers_page_stands_before_every_route(view: View) -> None:
    for path in GETS:
        assert view.ask("GET", path, Host="evil.example").status == 421
        assert view.ask("GET", path, Sec_Fetch_Site="cross-site").status == 403
        assert view.ask("GET", path, Origin="http://evil.example").status == 403
    for path, asked in POSTS.items():
        body = json.dumps({"campaign": "c1", **asked}).encode()
        assert view.ask("POST", path, body, Origin="http://evil.example").status == 403
        assert view.ask("POST", path, body, Content_Type="text/plain").status == 415
        assert view.ask("POST", path, b" " * (1 << 19)).status == 413


def test_a_browser_may_load_nothing_from_elsewhere(view: View) -> None:
    for path in ("/", "/page.js", "/api/list"):
        answer = view.ask("GET", path)
        assert answer.status == 200
        policy = answer.headers["content-security-policy"]
        assert "default-src 'none'" in policy and "script-src 'self';" in policy and "http" not in policy
    assert b"http" not in view.ask("GET", "/").body


def test_without_the_token_nothing_is_answered_or_done(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_PAGE_TOKEN", TOKEN)
    with viewing_here(folder, host="0.0.0.0", token=page_token(None)) as view:
        assert TOKEN not in "".join(view.said)  # a token that people know has no business in a journal
        for given in ("", "Bearer wrong", f"Bearer {TOKEN}x"):
            for path in GETS:
                answer = view.ask("GET", path, Authorization=given)
                assert answer.status == 401 and b"clay" not in answer.body
            for path, asked in POSTS.items():
                body = json.dumps({"campaign": "c1", **asked}).encode()
                assert view.ask("POST", path, body, Authorization=given).status == 401
        assert view.ask("GET", f"/api/list?token={TOKEN}").status == 401
        assert view.ask("GET", "/api/list", Authorization=f"Bearer {TOKEN}").status == 200
        assert b"clay" not in view.ask("GET", "/").body


def test_a_token_is_made_where_others_can_reach_the_page(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_PAGE_TOKEN", "")
    with viewing_here(folder, host="0.0.0.0", token=page_token(None)) as view:
        assert len(view.token) > 16
        assert view.ask("GET", "/api/list").status == 200
        assert view.ask("GET", "/api/list", Authorization="").status == 401
