"""The live connection with one browser: messages out as fast as it takes them, acknowledgements and wishes in."""

from __future__ import annotations

import asyncio
from typing import Annotated

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from prismstereo.viewer.hub import Hub
from prismstereo.viewer.mailbox import Mailbox
from prismstereo.viewer.switches import SHOWN

__all__ = ["Live"]

_IDLE_S = 30.0
_TRY_AGAIN_LATER = 1013
_BAD_DATA = 1007


class _Word(msgspec.Struct, forbid_unknown_fields=True):
    """What a page says: which kinds it has got, and what it shows now."""

    ack: Annotated[list[int], msgspec.Meta(max_length=16)] = []
    show: Annotated[list[Annotated[str, msgspec.Meta(max_length=16)]], msgspec.Meta(max_length=16)] | None = None


class Live:
    """Serves websockets; a browser that says nothing for 30 s, or what cannot be read, is let go."""

    def __init__(self, hub: Hub, *, idle_s: float = _IDLE_S) -> None:
        self._hub, self._idle_s = hub, idle_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one browser until it goes, or is let go."""
        websocket = WebSocket(scope, receive, send)
        loop, ready = asyncio.get_running_loop(), asyncio.Event()
        mailbox = self._hub.join(lambda: _wake(loop, ready))
        await websocket.accept()
        if mailbox is None:
            await websocket.close(_TRY_AGAIN_LATER, "too many browsers watch already")
            return
        try:
            await self._converse(websocket, mailbox, ready)
        finally:
            self._hub.leave(mailbox)

    async def _converse(self, websocket: WebSocket, mailbox: Mailbox, ready: asyncio.Event) -> None:
        sending = asyncio.create_task(_send(websocket, mailbox, ready))
        try:
            await self._listen(websocket, mailbox)
        finally:
            sending.cancel()
            await asyncio.gather(sending, return_exceptions=True)

    async def _listen(self, websocket: WebSocket, mailbox: Mailbox) -> None:
        try:
            while True:
                async with asyncio.timeout(self._idle_s):
                    message = await websocket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                self._hear(msgspec.json.decode(message.get("text") or b"", type=_Word), mailbox)
        except TimeoutError:
            await websocket.close(_TRY_AGAIN_LATER, "nothing was heard for a while")
        except (msgspec.MsgspecError, UnicodeError, RecursionError):
            await websocket.close(_BAD_DATA, "this cannot be read")
        except WebSocketDisconnect:
            return

    def _hear(self, word: _Word, mailbox: Mailbox) -> None:
        for kind in word.ack:
            mailbox.acknowledge(kind)
        if word.show is not None:
            shown = frozenset(SHOWN).intersection(word.show)
            if shown != mailbox.shown:
                mailbox.shown = shown
                self._hub.look()


async def _send(websocket: WebSocket, mailbox: Mailbox, ready: asyncio.Event) -> None:
    """Send what waits, one message after the other; a browser that reads slowly is waited for here, and nowhere else."""
    try:
        while True:
            ready.clear()
            for word in mailbox.words():
                await websocket.send_text(word)
            while (waiting := mailbox.next()) is not None:
                kind, message = waiting
                data = await run_in_threadpool(message.data)
                if data:
                    await websocket.send_bytes(data)
                else:
                    mailbox.acknowledge(kind)
            await ready.wait()
    except (WebSocketDisconnect, RuntimeError, OSError):
        return  # it is gone: the listening side hears the same


def _wake(loop: asyncio.AbstractEventLoop, ready: asyncio.Event) -> None:
    if not loop.is_closed():
        loop.call_soon_threadsafe(ready.set)
