"""The logger's status page: a process of its own that a phone's browser looks at; see docs/status-page.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from wheelsoil.live.panel import PagePanel


def open_page(host: str, port: int, token: str | None, vehicle: str) -> PagePanel:
    """Open the status page.

    Parameters
    ----------
    host : str
        Address to listen on. Anything but this machine's own loopback needs a token.
    port : int
        0 takes a free one.
    token : str or None
        What the page asks for. None: nothing on a loopback address, a new random one elsewhere.
    vehicle : str
        Name that the page shows before the first snapshot.

    Returns
    -------
    PagePanel
        A `daq.panel.Panel`; its ``address`` is what to open, token included.

    Raises
    ------
    HardwareError
        The address cannot be listened on, or the port is taken.
    ConfigError
        The token or the port cannot be used.
    """
    from wheelsoil.live.panel import PagePanel

    return PagePanel(host, port, token, vehicle)
