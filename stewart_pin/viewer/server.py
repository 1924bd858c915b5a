"""A server for one's own browser: on this machine alone unless asked, for pages of its own alone, without a tunnel."""

from __future__ import annotations

import contextlib
import functools
import ipaddress
import socket
import threading
from collections.abc import Iterator
from typing import Any

from stewart_pin.errors import InputError, MissingExtraError

LOOPBACK = "127.0.0.1"
_starting = threading.Lock()


def start_server(host: str = LOOPBACK, port: int | None = None, *, label: str = "stewart_pin") -> Any:
    """Start a viser server.

    Parameters
    ----------
    host
        Address to listen on.
    port
        Port; default: one that is free.
    label
        Title above the controls.

    Returns
    -------
    viser.ViserServer
        Running in threads of its own.

    Raises
    ------
    MissingExtraError
        If viser is not installed.
    InputError
        If the address cannot be had, or the port is taken.
    """
    try:
        import viser  # noqa: PLC0415 - optional and slow
    except ImportError:
        raise MissingExtraError("viser", "viewer") from None
    port = _free_port(host, port)

    class LocalServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> None:
            """Open no tunnel to the public, whoever asks: a page may ask even where the button is hidden."""

    with _starting, _only_from(_own_origins(host, port)), _silent():
        server = LocalServer(host=host, port=port, label=label, verbose=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
    return server


def stop_server(server: Any) -> None:
    """Stop a server, in silence: it would print so.

    Parameters
    ----------
    server
        Of `start_server`.
    """
    with _silent():
        server.stop()


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    import rich  # noqa: PLC0415 - comes with viser

    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


def is_loopback(host: str) -> bool:
    """Tell whether an address is reached from this machine alone.

    Parameters
    ----------
    host
        Address or name.

    Returns
    -------
    bool
        True of 127.0.0.0/8, ::1 and localhost.
    """
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _free_port(host: str, port: int | None) -> int:
    """Refuse a port that is taken: viser would take the next one in silence."""
    if not isinstance(host, str):
        raise InputError(f"host must be an address or a name, as '{LOOPBACK}', got {host!r}")
    if port is not None and (isinstance(port, bool) or not isinstance(port, int) or not 0 < port < 65536):
        raise InputError(f"port must be from 1 to 65535, got {port!r}")
    try:
        family = socket.getaddrinfo(host, port or 0, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port or 0))
            return probe.getsockname()[1]
    except OSError as error:
        what = f"port {port} of {host}" if port else f"the address {host}"
        raise InputError(f"{what} cannot be had: {error.strerror or error}; pass another one") from None


def _own_origins(host: str, port: int) -> list[str | None]:
    """Where pages that may talk to the server come from; programs outside browsers name no origin."""
    names = {host}
    if is_loopback(host) or host in ("", "0.0.0.0", "::"):
        names |= {"127.0.0.1", "localhost", "[::1]"}
    if not is_loopback(host):
        with contextlib.suppress(OSError):
            names |= {
                socket.gethostname(),
                socket.getfqdn(),
                *socket.gethostbyname_ex(socket.gethostname())[2],
            }
    return [*(f"http://{name}:{port}" for name in sorted(names)), None]


@contextlib.contextmanager
def _only_from(origins: list[str | None]) -> Iterator[None]:
    """Let the server that is started meanwhile refuse pages from elsewhere.

    Any page that a browser has open may connect to a server on this machine; only the origin tells it from ours. viser
    hands no list of origins on to websockets, which knows how to refuse.
    """
    from websockets.asyncio import server as websockets  # noqa: PLC0415 - comes with viser

    serve = websockets.serve
    websockets.serve = functools.partial(serve, origins=origins)  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        websockets.serve = serve  # type: ignore[misc]
