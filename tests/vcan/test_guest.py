"""Without a kernel that has vcan, or a tool, tests skip and say why, unless they must not."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from vcan import guest
from vcan.disks import disk


@pytest.fixture
def no_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    def none() -> None:
        raise guest.NoGuestError("user-mode-linux is not installed")

    monkeypatch.setattr(guest, "_in_own_namespace", lambda: ())
    monkeypatch.setattr(guest, "_user_mode_linux", none)


@pytest.mark.usefixtures("no_kernel")
def test_a_missing_kernel_skips_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WHEELSOIL_REQUIRE_VCAN", raising=False)
    with pytest.raises(pytest.skip.Exception, match="user-mode-linux is not installed"):
        guest.run_or_skip("true")


@pytest.mark.usefixtures("no_kernel")
def test_a_missing_kernel_fails_where_it_is_demanded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WHEELSOIL_REQUIRE_VCAN", "1")
    with pytest.raises(pytest.fail.Exception, match="WHEELSOIL_REQUIRE_VCAN=1, but user-mode-linux"):
        guest.run_or_skip("true")


@pytest.fixture(params=sorted(guest.TOOLS))
def missing(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A tool that is not there, where all others are."""
    (tmp_path / "bin").mkdir()
    for name in {"sh", "mount", *guest.TOOLS} - {request.param}:
        found = shutil.which(name, path=guest._PATH)
        (tmp_path / "bin" / name).symlink_to(found or "/bin/true")
    monkeypatch.setattr(guest, "_PATH", str(tmp_path / "bin"))
    monkeypatch.setattr(guest, "_in_own_namespace", lambda: ())
    monkeypatch.setattr(guest, "_run_guest", lambda *_: pytest.fail("it was begun"))
    return str(request.param)


SCRIPT = "insmod x.ko; mke2fs -q x; e2fsck x; debugfs x; cansend vcan0 123#01 && curl --silent http://127.0.0.1"


@pytest.mark.parametrize("run", [guest.run_or_skip, guest.guest_or_skip])
def test_a_missing_tool_skips_with_its_name_and_package(missing: str, run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WHEELSOIL_REQUIRE_VCAN", raising=False)
    said = f"not installed: {missing}; on Debian: apt-get install {guest.TOOLS[missing]}"
    with pytest.raises(pytest.skip.Exception, match=f"^{said}$"):
        run(SCRIPT)
    monkeypatch.setenv("WHEELSOIL_REQUIRE_VCAN", "1")
    with pytest.raises(pytest.fail.Exception, match=f"WHEELSOIL_REQUIRE_VCAN=1, but {said}"):
        run(SCRIPT)


@pytest.mark.parametrize("missing", ["mke2fs"], indirect=True)
def test_without_the_tool_there_is_no_disk(missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WHEELSOIL_REQUIRE_VCAN", raising=False)
    with pytest.raises(pytest.skip.Exception, match=f"not installed: {missing}"):
        disk(tmp_path / "disk.img")


def test_only_what_a_script_runs_is_asked_for() -> None:
    assert guest.tools_of("sh x.sh; ./curl; echo curl-like; cansender; zip x") == []
