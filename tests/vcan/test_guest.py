"""Without a kernel that has vcan, tests skip and say why, unless they must not."""

from __future__ import annotations

import pytest
from vcan import guest


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
