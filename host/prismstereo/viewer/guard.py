"""The gate before every request: rules first, routes after; and the headers that keep a browser in line."""

from __future__ import annotations

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from prismstereo.viewer.access import Access, cookies, header

__all__ = ["ENTER", "Guard"]

ENTER = "/api/enter"  # where a browser shows the token: the only thing that needs none beside the page itself
COOKIE = "prismstereo"
_MOST_BODY = 64 * 1024
_PRIVATE = ("/api/", "/files/", "/live")
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"x-frame-options", b"DENY"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
    (b"permissions-policy", b"camera=(), microphone=(), geolocation=()"),
)


class Guard:
    """Refuses what `Access` does not know, before any of our own code sees it.

    403: a foreign Host, a POST or a websocket of a foreign page. 401: the token is missing. 405: another method than GET,
    HEAD and POST. 413: a body above 64 KiB.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app, self._access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request pass, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        refused = self._refusal(scope)
        if scope["type"] == "websocket":
            if refused is not None:
                await send({"type": "websocket.close", "code": 1008, "reason": refused[1]})
                return
            await self._app(scope, receive, send)
            return
        host = header(scope["headers"], "host") or ""
        sending = _with_headers(send, host if refused is None else "")
        if refused is not None:
            await _say(sending, *refused)
            return
        await self._app(scope, _bounded(receive), sending)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Give status and sentence of a refusal; None where the request may pass."""
        headers, access = scope["headers"], self._access
        host = header(headers, "host")
        if not access.knows_host(host):
            return 403, "this server does not answer to that host name: use the address that it printed"
        live = scope["type"] == "websocket"
        if not live and scope["method"] not in ("GET", "HEAD", "POST"):
            return 405, "give GET, HEAD or POST"
        if (live or scope["method"] == "POST") and not access.knows_origin(header(headers, "origin"), host):
            return 403, "this came from another page than the viewer's own"
        private = scope["path"].startswith(_PRIVATE) and scope["path"] != ENTER
        cookie = cookies(header(headers, "cookie")).get(COOKIE)
        if private and not access.admits(cookie, header(headers, "authorization")):
            return 401, "show the token first: open the address that the server printed, with all that is behind its #"
        length = header(headers, "content-length")
        if length is not None and not (length.isascii() and length.isdigit() and int(length) <= _MOST_BODY):
            return 413, f"a request has at most {_MOST_BODY} bytes"
        return None


def _bounded(receive: Receive) -> Receive:
    """Read no more of a body than it may have, whatever its sender declared; what is beyond is as a connection cut."""
    taken = 0

    async def receive_some() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        return {"type": "http.disconnect"} if taken > _MOST_BODY else message

    return receive_some


def _with_headers(send: Send, host: str) -> Send:
    sockets = f" ws://{host} wss://{host}" if host else ""
    policy = (
        f"default-src 'self'; img-src 'self' blob:; connect-src 'self'{sockets}; object-src 'none'; base-uri 'none'; "
        "frame-ancestors 'none'; form-action 'none'"
    )

    async def send_more(message: Message) -> None:
        if message["type"] == "http.response.start":
            given = {name for name, _ in message.get("headers", ())}
            more = [pair for pair in _HEADERS if pair[0] not in given]
            own = [*message.get("headers", ()), *more, (b"content-security-policy", policy.encode())]
            message = {**message, "headers": own}
        await send(message)

    return send_more


async def _say(send: Send, status: int, text: str) -> None:
    body = text.encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})
