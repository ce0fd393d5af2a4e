"""The server: listens where it was told and nowhere else, keeps few connections, and drops those that say nothing."""

from __future__ import annotations

import asyncio
import ipaddress
import socket
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self, cast

import uvicorn
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

from prismstereo.viewer.access import Access, is_loopback
from prismstereo.viewer.application import application
from prismstereo.viewer.hub import Hub
from prismstereo_hw.errors import DeviceError, UsageError

__all__ = ["ViewerServer"]

_MOST_CONNECTIONS = 96
_FIRST_REQUEST_S = 10.0
_MOST_MESSAGE = 4096
_START_S = 20.0
_PING_S = 20.0


class _PatientProtocol(H11Protocol):
    """Closes a connection whose first request does not come in time, and the oldest of those where there are too many."""

    _waiting: asyncio.TimerHandle | None = None
    _since_s = 0.0

    @property
    def _asked(self) -> bool:
        return getattr(self, "cycle", None) is not None

    @property
    def _open(self) -> bool:
        return not self.transport.is_closing()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Begin to wait for a request."""
        super().connection_made(cast("asyncio.Transport", transport))
        self._since_s = self.loop.time()
        self._waiting = self.loop.call_later(_FIRST_REQUEST_S, self._close_silent)
        there = [one for one in self.connections if not isinstance(one, _PatientProtocol) or one._open]
        if len(there) > _MOST_CONNECTIONS:
            silent = [one for one in there if isinstance(one, _PatientProtocol) and not one._asked]
            min(silent, key=lambda one: one._since_s, default=self).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing any more."""
        self._stop_waiting()
        super().connection_lost(exc)

    def handle_websocket_upgrade(self, event: Any) -> None:
        """Leave the connection to whoever speaks websocket; that one has its own limits."""
        self._stop_waiting()
        super().handle_websocket_upgrade(event)

    def _close_silent(self) -> None:
        if self._open and not self._asked:
            self.transport.abort()

    def _stop_waiting(self) -> None:
        if self._waiting is not None:
            self._waiting.cancel()


class ViewerServer:
    """Serves a hub on an address from a thread of its own; a context manager, `url` is what a person opens.

    `port` 0 takes any that is free. `UsageError` for an address that is not this machine's or is taken, and for a certificate
    that cannot be read.
    """

    def __init__(
        self,
        hub: Hub,
        *,
        address: str = "127.0.0.1",
        port: int = 0,
        certificate: Path | None = None,
        key: Path | None = None,
    ) -> None:
        self.access = Access.to(address)
        self._secure = certificate is not None
        app = application(hub, self.access, secure=self._secure)
        self._socket = _bound(address, port)
        self.port: int = self._socket.getsockname()[1]
        try:
            self._server = uvicorn.Server(_settings(app, certificate, key))
            self._server.config.load()
        except (OSError, ValueError) as error:
            self._socket.close()
            raise UsageError(f"the certificate {certificate} or its key cannot be used: {error}") from error
        self._thread = threading.Thread(target=self._run, name="prismstereo-server", daemon=True)
        self._thread.start()
        self._wait()

    @property
    def address(self) -> tuple[str, int]:
        """Where it really listens."""
        host, port = self._socket.getsockname()[:2]
        return str(host), int(port)

    @property
    def url(self) -> str:
        """The address for a browser; the token is behind the #, which browsers do not send and logs do not hold."""
        host = self.access.address
        shown = socket.gethostname() if _is_any(host) else host
        number = f"[{shown}]" if ":" in shown else shown
        token = "" if self.access.token is None else f"#token={self.access.token}"
        return f"{'https' if self._secure else 'http'}://{number}:{self.port}/{token}"

    def close(self) -> None:
        """Stop serving; browsers are told."""
        self._server.should_exit = True
        self._thread.join()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        self._server.run(sockets=[self._socket])

    def _wait(self) -> None:
        deadline_s = time.monotonic() + _START_S
        while not self._server.started:
            if not self._thread.is_alive() or time.monotonic() > deadline_s:
                raise DeviceError(f"the viewer's server did not start on {self.access.address}:{self.port}")
            time.sleep(0.01)


def _settings(app: ASGIApp, certificate: Path | None, key: Path | None) -> uvicorn.Config:
    return uvicorn.Config(
        app,
        http=_PatientProtocol,
        ws="websockets-sansio",
        ws_max_size=_MOST_MESSAGE,
        ws_ping_interval=_PING_S,
        ws_ping_timeout=_PING_S,
        ws_per_message_deflate=False,  # what is large is packed already
        lifespan="off",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=2,
        ssl_certfile=certificate,
        ssl_keyfile=key,
    )


def _is_any(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_unspecified
    except ValueError:
        return False


def _bound(address: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, where = socket.getaddrinfo(
            "127.0.0.1" if is_loopback(address) and ":" not in address and not address[:1].isdigit() else address,
            port,
            type=socket.SOCK_STREAM,
            flags=socket.AI_PASSIVE,
        )[0]
        bound = socket.socket(family, kind, protocol)
    except OSError as error:
        raise UsageError(f"cannot listen on {address}: {error.strerror}: give an address of this machine") from error
    try:
        if hasattr(socket, "SO_REUSEADDR"):
            bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.bind(where)
        bound.listen(128)
    except OSError as error:
        bound.close()
        raise UsageError(
            f"cannot listen on {address} port {port}: {error.strerror}: give another one with --host or --port"
        ) from error
    return bound
