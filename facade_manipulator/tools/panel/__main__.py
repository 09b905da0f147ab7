"""Show manipulators in a browser, read only, until Ctrl-C."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
import signal
import sys
import time
from typing import Any

from aiohttp import web
import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from facade_manipulator.blackbox import BlackBoxSettings
from facade_manipulator.errors import exit_status
from facade_manipulator.interfaces import DRIVER, IK, PANEL, RECORDER
from facade_manipulator.kinematics import Geometry
from facade_manipulator.maintenance import ServiceSettings
from facade_manipulator.nodes.monitor import Observer
from facade_manipulator.nodes.overview import Seen
from facade_manipulator.nodes.settings import LinkageSettings
from facade_manipulator.parameter_file import ALL_NODES, read_settings
from facade_manipulator.resources import config_path, written_folder
from facade_manipulator.ros import ManipulatorClient, ROSError, USAGE_ERROR
from facade_manipulator.tools.doctor import computer, folders, rivals, stop_topics
from facade_manipulator.tools.panel.server import Access, Server
from facade_manipulator.tools.panel.view import gondolas, PERIOD, recordings, View

LAST_PORT = 65535
LISTING, EXAMINING = 5.0, 60.0  # s between looks at the black box's folder, at the computer


class Panel:
    """Look at all gondolas there are, or at those that are asked for."""

    def __init__(self, client: ManipulatorClient, options: argparse.Namespace) -> None:
        self._client, self._options = client, options
        self._names: list[str] = []
        self._views: dict[str, View] = {}
        self._slow: dict[str, Any] = {'doctor': [], 'files': []}  # what is looked up now and then
        self._black_box = read_settings(options.parameters, RECORDER, '', BlackBoxSettings)
        self._folder = written_folder(self._black_box.folder)
        self._server = Server(
            Access(options.host, options.token_file.read_text('utf-8').strip()
                   if options.token_file else ''),
            lambda: recordings(self._folder),
            lambda: {name or '/': one.past for name, one in self._views.items()})

    async def run(self) -> None:
        """Serve until cancelled."""
        runner = web.AppRunner(self._server.application(), access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        examining = asyncio.create_task(self._examine())
        try:
            await web.TCPSite(runner, self._options.host, self._options.port).start()
            print(f'panel: http://{self._options.host}:{self._options.port}/\npanel: files of '
                  f'{self._folder}{"" if recordings(self._folder) else ": there are none"}',
                  flush=True)
            due = time.monotonic()
            while True:
                self._look()
                due = max(due + PERIOD, now := time.monotonic())
                await asyncio.sleep(due - now)
        finally:
            examining.cancel()
            await runner.cleanup()

    def _look(self) -> None:
        """Take what came and show it."""
        self._client.spin(0.0)
        self._names, more = gondolas(self._client.gondolas, self._options.namespace, self._names)
        self._views = {name: self._views.get(name) or self._view(name)
                       for name in self._names or ['']}
        now = time.monotonic()
        self._server.show({**self._slow, 'more': more,
                           'gondolas': [one.look(now) for one in self._views.values()]})

    def _view(self, name: str) -> View:
        try:
            seen = Observer(self._client, name).seen
        except ROSError:  # whoever publishes its diagnostics is no node of ours
            seen = Seen(name, self._client.gondolas)
        files, full = self._options.parameters, f'/{name}'
        return View(seen, read_settings(files, ALL_NODES, 'geometry', Geometry, full),
                    read_settings(files, IK, 'linkage', LinkageSettings, full).wall_distance)

    async def _examine(self) -> None:
        """Look at computer and files now and then; none of it holds the view up."""
        files, stops = self._options.parameters, stop_topics(self._options.parameters)
        service = read_settings(files, DRIVER, 'service', ServiceSettings)
        while True:
            found = await asyncio.to_thread(lambda: [
                *computer(), *folders(service, self._black_box)])
            for _ in range(round(EXAMINING / LISTING)):
                self._slow = {
                    'doctor': [*found, ('publishers', rivals(self._client.node, stops))],
                    'files': [(name, path.stat().st_size)
                              for name, path in recordings(self._folder).items()]}
                await asyncio.sleep(LISTING)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C; return the exit status."""
    words = remove_ros_args(args=sys.argv if arguments is None else ['panel', *arguments])[1:]
    parser = argparse.ArgumentParser(prog='panel', description=__doc__.strip())
    parser.add_argument('--namespace', action='append', default=[], type=lambda it: it.strip('/'),
                        help='of a gondola, again for more; without it all there are')
    parser.add_argument('--host', default='127.0.0.1', help='address to be reached at')
    parser.add_argument('--port', type=int, default=8088)
    parser.add_argument('--token-file', type=Path,
                        help='with the password, which an address of the network needs')
    parser.add_argument('--params-file', type=Path, action='append', dest='parameters',
                        help='parameter file of the machine')
    options = parser.parse_args(words)
    if not 0 <= options.port <= LAST_PORT:
        parser.error(f'--port {options.port} is not within 0 to {LAST_PORT}')
    options.parameters = options.parameters or [config_path('manipulator.yaml')]
    return exit_status('panel', lambda: _serve(options, arguments), USAGE_ERROR)


def _serve(options: argparse.Namespace, arguments: Sequence[str] | None) -> None:
    rclpy.init(args=None if arguments is None else list(arguments),
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        named = options.namespace[0] if len(options.namespace) == 1 else ''
        with ManipulatorClient(named, PANEL, enable_rosout=False,
                               start_parameter_services=False) as client:
            asyncio.run(_until_signal(Panel(client, options)))
    finally:
        rclpy.try_shutdown()


async def _until_signal(panel: Panel) -> None:
    task = asyncio.ensure_future(panel.run())
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with suppress(asyncio.CancelledError):
        await task


if __name__ == '__main__':
    raise SystemExit(main())
