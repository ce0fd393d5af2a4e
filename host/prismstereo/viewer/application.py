"""The routes: the page, what it asks for, and the live connection. State changes by POST alone."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from importlib import resources
from typing import Annotated, TypeVar

import msgspec
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp

from prismstereo.viewer.access import Access
from prismstereo.viewer.guard import COOKIE, ENTER, Guard
from prismstereo.viewer.hub import Hub
from prismstereo.viewer.live import Live
from prismstereo_device.protocol.command import Value
from prismstereo_hw.errors import DeviceError, PrismStereoError, UsageError

__all__ = ["application"]

_STATIC = "static"
_API = "/api"
_BODY_S = 10.0
_ENCODER = msgspec.json.Encoder(decimal_format="number")
T = TypeVar("T", bound=msgspec.Struct)

_Text = Annotated[str, msgspec.Meta(max_length=256)]


class _Enter(msgspec.Struct, forbid_unknown_fields=True):
    token: _Text = ""


class _Set(msgspec.Struct, forbid_unknown_fields=True):
    name: _Text
    value: bool | int | float | str | list[int] | None = None


class _Record(msgspec.Struct, forbid_unknown_fields=True):
    on: bool
    raw: bool = False


class _Play(msgspec.Struct, forbid_unknown_fields=True):
    name: _Text
    position_s: Annotated[float, msgspec.Meta(ge=0, le=1e7)] = 0.0


class _Pause(msgspec.Struct, forbid_unknown_fields=True):
    on: bool


class _Nothing(msgspec.Struct, forbid_unknown_fields=True):
    pass


def application(hub: Hub, access: Access, *, secure: bool = False) -> ASGIApp:
    """Make the application that serves a hub; `secure`: it is reached by https."""
    actions = _Actions(hub)
    folder = resources.files("prismstereo.viewer").joinpath(_STATIC)
    pages = StaticFiles(directory=str(folder), html=True, follow_symlink=False)
    live = Live(hub)

    async def enter(request: Request) -> Response:
        asked = await _body(request, _Enter)
        if isinstance(asked, Response):
            return asked
        if not access.opens(asked.token):
            return _json({"error": "that is not the token: open the address that the server printed"}, 401)
        response = _json({"ok": True})
        response.set_cookie(COOKIE, access.entrance, httponly=True, samesite="strict", secure=secure, path="/")
        return response

    asked = [
        Route("/state", _asked(actions.state), methods=["GET"]),
        Route("/records", _asked(actions.records), methods=["GET"]),
    ]
    acted = [
        Route(ENTER.removeprefix(_API), enter, methods=["POST"]),
        Route("/set", _acted(_Set, lambda wish: actions.change(wish.name, wish.value)), methods=["POST"]),
        Route("/record", _acted(_Record, lambda wish: actions.record(on=wish.on, raw=wish.raw)), methods=["POST"]),
        Route("/still", _acted(_Nothing, lambda _: hub.desk.shoot("still")), methods=["POST"]),
        Route("/background", _acted(_Nothing, lambda _: hub.desk.shoot("background")), methods=["POST"]),
        Route("/optics", _acted(_Nothing, lambda _: hub.desk.look()), methods=["POST"]),
        Route("/check", _acted(_Nothing, lambda _: hub.desk.check()), methods=["POST"]),
        Route("/play", _acted(_Play, lambda wish: actions.play(wish.name, wish.position_s)), methods=["POST"]),
        Route("/pause", _acted(_Pause, lambda wish: actions.pause(on=wish.on)), methods=["POST"]),
        Route("/live", _acted(_Nothing, lambda _: actions.go_live()), methods=["POST"]),
    ]
    routes = [
        Mount(_API, routes=[*asked, *acted]),
        Route("/files/{name}/{inside:path}", _file(hub), methods=["GET"]),
        WebSocketRoute("/live", live),
        Mount("/", pages),
    ]
    return Guard(Starlette(routes=routes), access)


class _Actions:
    """What the routes do, in threads: all of it waits for a camera or a disk."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub

    def state(self) -> dict[str, object]:
        return {"details": self._hub.desk.details(), "status": self._hub.desk.status()}

    def records(self) -> dict[str, object]:
        records = self._hub.records
        listed = [
            {"name": one.name, "kind": one.kind, "bytes": one.bytes, "pictures": records.pictures(one)}
            for one in records.listed()
        ]
        return {"records": listed}

    def change(self, name: str, value: Value) -> dict[str, object]:
        return {"name": name, "value": self._hub.desk.change(name, value)}

    def record(self, *, on: bool, raw: bool) -> dict[str, object]:
        desk = self._hub.desk
        ended = desk.tape
        desk.record(on=on, raw=raw)
        return {
            "tape": None if desk.tape is None else desk.tape.told(),
            "ended": ended.told() if ended and not on else None,
        }

    def play(self, name: str, position_s: float) -> dict[str, object]:
        self._hub.play(name, position_s)
        return {"ok": True}

    def pause(self, *, on: bool) -> dict[str, object]:
        self._hub.pause(on=on)
        return {"ok": True}

    def go_live(self) -> dict[str, object]:
        self._hub.go_live()
        return {"ok": True}


def _asked(tell: Callable[[], object]) -> Callable[[Request], Awaitable[Response]]:
    async def answer(request: Request) -> Response:
        del request
        return await _done(tell)

    return answer


def _acted(kind: type[T], act: Callable[[T], object]) -> Callable[[Request], Awaitable[Response]]:
    async def answer(request: Request) -> Response:
        asked = await _body(request, kind)
        return asked if isinstance(asked, Response) else await _done(lambda: act(asked))

    return answer


def _file(hub: Hub) -> Callable[[Request], Awaitable[Response]]:
    async def answer(request: Request) -> Response:
        try:
            path = hub.records.picture(request.path_params["name"], request.path_params["inside"])
        except UsageError as error:
            return _json({"error": str(error)}, 404)
        return FileResponse(path, media_type="image/png")

    return answer


async def _done(act: Callable[[], object]) -> Response:
    try:
        return _json(await run_in_threadpool(act))
    except UsageError as error:
        return _json({"error": str(error)}, 400)
    except DeviceError as error:
        return _json({"error": str(error)}, 503)
    except PrismStereoError as error:
        return _json({"error": str(error)}, 422)


async def _body(request: Request, kind: type[T]) -> T | Response:
    try:
        async with asyncio.timeout(_BODY_S):
            content = await request.body()
        return msgspec.json.decode(content or b"{}", type=kind)
    except (ClientDisconnect, TimeoutError):
        return _json({"error": "the request was cut, or is too large"}, 413)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return _json({"error": f"this request cannot be read: {error}"}, 400)


def _json(content: object, status: int = 200) -> Response:
    return Response(_ENCODER.encode(content), status, media_type="application/json")
