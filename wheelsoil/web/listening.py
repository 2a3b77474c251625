"""Address of a page: its listening socket, its URLs and its token."""

from __future__ import annotations

import errno
import ipaddress
import secrets
import socket
import struct
import time
from urllib.parse import quote

from daq import ConfigError, Fault, HardwareError

PATIENCE_S = 1.0
"""How long a taken port is retried: the page of a logger that was killed may not have ended yet."""

_SHORTEST_TOKEN = 8
_SIOCGIFADDR = 0x8915
_OWN_PORT = getattr(socket, "SO_EXCLUSIVEADDRUSE", socket.SO_REUSEADDR)
"""Windows has the first: there SO_REUSEADDR would give two programs the same port."""
_DEAF_MS = 15_000
"""Time limit for a phone out of reach; by default TCP would keep its connection for a quarter of an hour."""


class PortTakenError(HardwareError):
    """Another program listens on the port."""


def listen(
    host: str,
    port: int,
    patience_s: float = PATIENCE_S,
    *,
    page: str = "status page",
    other: str = "a second logger",
) -> socket.socket:
    """Return a listening socket; `page` is the name of the page in messages, `other` what may have taken its port.

    `PortTakenError` where the port is taken, `HardwareError` where the address is not this machine's or the port is not
    allowed, `ConfigError` where there is no such port.
    """
    if not 0 <= port <= 0xFFFF:
        raise ConfigError.of("there is no such port", page, str(port), "1 to 65535")
    until = time.monotonic() + patience_s
    while True:
        try:
            return _listening(host, port)
        except OSError as error:
            taken = error.errno == errno.EADDRINUSE
            if not taken or time.monotonic() >= until:
                kind = PortTakenError if taken else HardwareError
                raise kind(_fault(error, host, port, page, other)) from None
            time.sleep(0.05)


def is_loopback(host: str) -> bool:
    """Return whether an IP address is reachable from this machine only."""
    return ipaddress.ip_address(host.split("%")[0]).is_loopback


def checked_token(token: str | None, host: str) -> str | None:
    """Return the token required on a bound address: the given one, a new one, or None if none is needed.

    `ConfigError` if the given token is too short or has characters that a header cannot carry.
    """
    if token is None:
        return None if is_loopback(host) else secrets.token_urlsafe(16)
    if len(token) < _SHORTEST_TOKEN or not token.isascii() or not token.isprintable() or " " in token:
        raise ConfigError.of(
            "the page's token cannot be used",
            expected=f"at least {_SHORTEST_TOKEN} ASCII characters without spaces",
            next_step="omit it: a random one is created and printed",
        )
    return token


def page_addresses(listening: socket.socket, token: str | None) -> tuple[str, ...]:
    """Return the URLs that open the page, the most useful first.

    The token follows ``#``: this part of a URL stays in the browser and does not appear in the log of a server.
    """
    host, port = listening.getsockname()[:2]
    own = ipaddress.ip_address(host.split("%")[0])
    hosts = (_interface_addresses() or ("127.0.0.1",)) if own.is_unspecified else (host,)
    fragment = f"#{quote(token, safe='')}" if token else ""
    return tuple(f"http://{f'[{name}]' if ':' in name else name}:{port}/{fragment}" for name in hosts)


def _listening(host: str, port: int) -> socket.socket:
    family, kind, protocol, _, address = socket.getaddrinfo(
        host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    )[0]
    listening = socket.socket(family, kind, protocol)
    try:
        listening.setsockopt(socket.SOL_SOCKET, _OWN_PORT, 1)
        if hasattr(socket, "TCP_USER_TIMEOUT"):  # Linux
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _DEAF_MS)
        listening.bind(address)
        listening.listen(32)
    except OSError:
        listening.close()
        raise
    listening.setblocking(False)
    return listening


def _fault(error: OSError, host: str, port: int, page: str, other: str) -> Fault:
    where = f"{page} on {host}:{port}"
    if error.errno == errno.EADDRINUSE:
        return Fault(
            f"port {port} is taken",
            where,
            next_step="choose another port, or end the program that listens there (`ss -ltnp` names it); "
            f"it may be {other}",
        )
    if error.errno == errno.EACCES:
        return Fault(f"port {port} is not allowed", where, str(error.strerror), next_step="choose a port above 1023")
    return Fault(
        f"the {page} cannot listen on this address",
        where,
        error.strerror or str(error),
        "an address of this machine",
        "use 127.0.0.1 for this machine only, 0.0.0.0 for every network it is in (`ip address` lists the addresses)",
    )


def _interface_addresses() -> tuple[str, ...]:
    """Return this machine's IPv4 addresses, the loopback address last; none on a system without `fcntl` (Windows)."""
    try:
        import fcntl
    except ImportError:
        return ()
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        for _, name in socket.if_nameindex():
            request = struct.pack("256s", name.encode()[:15])
            try:
                answer = fcntl.ioctl(probe.fileno(), _SIOCGIFADDR, request)
            except OSError:  # an interface without an IPv4 address, as every CAN interface is
                continue
            found.append(socket.inet_ntoa(answer[20:24]))
    return tuple(sorted(found, key=is_loopback))
