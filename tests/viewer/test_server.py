"""The server: on this machine alone, for its own pages, without a tunnel."""

from __future__ import annotations

import asyncio
import socket

import pytest

import stewart_pin as stp

viser = pytest.importorskip("viser", reason="viser is not installed")
websockets = pytest.importorskip("websockets")


@pytest.fixture
def viewer():
    with stp.view(stp.load("four_bar")) as viewer:
        yield viewer


def connect(url: str, origin: str | None) -> bool:
    """Whether a page of that origin gets a connection."""

    async def attempt() -> bool:
        try:
            async with websockets.connect(
                url.replace("http", "ws"), origin=origin, subprotocols=[f"viser-v{viser.__version__}"]
            ):
                return True
        except websockets.exceptions.InvalidStatus as error:
            assert error.response.status_code == 403
            return False

    return asyncio.run(attempt())


def test_pages_from_elsewhere_are_refused(viewer):
    assert viewer.url.startswith("http://127.0.0.1:")
    assert connect(viewer.url, viewer.url)
    port = viewer.url.rsplit(":", 1)[1]
    assert connect(viewer.url, f"http://localhost:{port}")
    assert not connect(viewer.url, "http://example.org")
    assert not connect(viewer.url, f"http://example.org:{port}")
    assert not connect(viewer.url, "http://127.0.0.1:1")
    assert not connect(viewer.url, "null")


def test_it_listens_on_this_machine_alone(viewer):
    port = int(viewer.url.rsplit(":", 1)[1])
    with socket.create_connection(("127.0.0.1", port), timeout=2):
        pass
    own = socket.gethostbyname(socket.gethostname())
    if own.startswith("127."):
        pytest.skip("this machine has no other address")
    with pytest.raises(OSError), socket.create_connection((own, port), timeout=2):
        pass


def test_no_tunnel_is_opened(viewer):
    assert viewer.page.server.request_share_url() is None


def test_a_port_that_is_taken_is_refused(viewer):
    port = int(viewer.url.rsplit(":", 1)[1])
    with pytest.raises(stp.errors.InputError, match=f"port {port} of 127.0.0.1 cannot be had"):
        stp.view(stp.load("four_bar"), port=port)
    for wrong in (0, 65536, True, 1.5, "80"):
        with pytest.raises(stp.errors.InputError, match=f"port must be from 1 to 65535, got {wrong!r}"):
            stp.view(stp.load("four_bar"), port=wrong)  # type: ignore[arg-type]
    with pytest.raises(stp.errors.InputError, match="host must be an address or a name"):
        stp.view(stp.load("four_bar"), host=None)  # type: ignore[arg-type]


def test_what_is_no_chain_is_refused():
    with pytest.raises(stp.errors.InputError, match="ClosedChain"):
        stp.view("stewart")  # type: ignore[arg-type]


def test_the_server_ends_in_silence(capsys):
    stp.view(stp.load("four_bar")).close()
    assert capsys.readouterr().out == ""
