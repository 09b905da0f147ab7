"""Hand the page, its views as server-sent events and files to browsers; nothing can be set."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
import hmac
from ipaddress import ip_address
import json
from pathlib import Path
import re
from typing import Any

from aiohttp import BasicAuth, hdrs, web

from facade_manipulator.errors import ParameterError
from facade_manipulator.resources import config_path

MOST_VIEWERS = 20
PATIENCE = 2.0  # s for a browser that takes nothing
SHORTEST_TOKEN = 16  # characters
LOOPBACK = re.compile(r'(localhost|127(\.\d+){3}|\[::1\])(:\d+)?')  # Host: of a browser there
HEADERS = {
    'Content-Security-Policy': "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff', 'Referrer-Policy': 'no-referrer',
    'Cache-Control': 'no-store'}
PAGE = {'/': ('index.html', 'text/html'), '/panel.js': ('panel.js', 'text/javascript'),
        '/panel.css': ('panel.css', 'text/css')}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True)
class Access:
    """Who may look: who is at this computer, or whoever has the token."""

    host: str
    token: str = ''

    def __post_init__(self) -> None:
        if not self.is_local and len(self.token) < SHORTEST_TOKEN:
            raise ParameterError(
                f'--host {self.host} is open to the network: the token has {len(self.token)} '
                f'characters, bound {SHORTEST_TOKEN}; next: --token-file FILE')

    @property
    def is_local(self) -> bool:
        """Return whether nobody but this computer reaches it: a name may be anybody's."""
        with suppress(ValueError):
            return ip_address(self.host).is_loopback
        return self.host == 'localhost'

    def rejection(self, host: str, authorization: str) -> web.Response | None:
        """Return what answers a request that may not look, by two of its headers."""
        if self.is_local and not LOOPBACK.fullmatch(host):  # a name that a foreign page gave us
            return web.Response(status=403, text='ask for localhost')
        if self.token and not self._knows(authorization):
            return web.Response(status=401, text='the token, as the password', headers={
                hdrs.WWW_AUTHENTICATE: 'Basic realm="panel", charset="UTF-8"'})
        return None

    def _knows(self, authorization: str) -> bool:
        try:
            given = BasicAuth.decode(authorization, 'utf-8').password
        except ValueError:
            return False
        return hmac.compare_digest(given.encode(), self.token.encode())


class Server:
    """
    Show the newest view to a bounded number of browsers.

    Nothing waits for a browser: who is slow misses views, who takes nothing is left.

    Parameters
    ----------
    access : Access
    files : callable
        Returns the files to download, by name.
    past : callable
        Returns what who comes is to know before the first view.

    """

    def __init__(
        self, access: Access, files: Callable[[], Mapping[str, Path]], past: Callable[[], Any],
    ) -> None:
        self._access, self._files, self._past = access, files, past
        self._view, self._viewers = b'', 0
        self._news = asyncio.Event()

    def show(self, view: Any) -> None:
        """Show a view to all who look."""
        self._view = _event('view', view)
        self._news, news = asyncio.Event(), self._news
        news.set()

    def application(self) -> web.Application:
        """Return it with its pages; whatever else is asked is not found."""
        @web.middleware
        async def guard(request: web.Request, handler: Handler) -> web.StreamResponse:
            try:
                response = self._access.rejection(
                    request.host, request.headers.get(hdrs.AUTHORIZATION, '')
                ) or await handler(request)
            except web.HTTPException as error:
                response = web.Response(status=error.status, text=error.reason)
            if not response.prepared:
                response.headers.update(HEADERS)
            return response

        application = web.Application(middlewares=[guard], client_max_size=0)
        for path, (name, kind) in PAGE.items():
            application.router.add_get(path, _page(config_path(f'panel/{name}'), kind))
        application.router.add_get('/events', self._events)
        application.router.add_get('/files/{name}', self._file)
        return application

    async def _events(self, request: web.Request) -> web.StreamResponse:
        if self._viewers >= MOST_VIEWERS:
            return web.Response(status=503, text=f'{self._viewers} browsers look already')
        self._viewers += 1
        try:
            return await self._stream(request)
        finally:
            self._viewers -= 1

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        response = web.StreamResponse(headers={
            **HEADERS, hdrs.CONTENT_TYPE: 'text/event-stream', 'X-Accel-Buffering': 'no'})
        await response.prepare(request)
        text, transport = _event('past', self._past()), request.transport
        with suppress(ConnectionError):
            while transport is not None:
                patience = asyncio.get_running_loop().call_later(PATIENCE, transport.abort)
                await response.write(text)
                patience.cancel()
                await self._news.wait()
                text = self._view
        return response

    async def _file(self, request: web.Request) -> web.StreamResponse:
        path = self._files().get(request.match_info['name'])
        if path is None:
            raise web.HTTPNotFound
        return web.FileResponse(path, headers={
            hdrs.CONTENT_DISPOSITION: f'attachment; filename="{path.name}"',
            hdrs.CONTENT_TYPE: 'application/octet-stream'})


def _event(kind: str, data: Any) -> bytes:
    text = json.dumps(data, default=vars, allow_nan=False, separators=(',', ':'))
    return f'event: {kind}\ndata: {text}\n\n'.encode()


def _page(path: Path, kind: str) -> Handler:
    body = path.read_bytes()

    async def answer(_: web.Request) -> web.Response:
        return web.Response(body=body, content_type=kind, charset='utf-8')

    return answer
