"""Server of `gcs foxglove`, by foxglove-sdk: a WebSocket on this machine."""

from __future__ import annotations

import asyncio
import contextlib
import signal
from typing import Any, Final, Self

import msgspec
from rich.console import Console

from gcs.cli.following import frame_of, news_of
from gcs.console.source import Source
from gcs.errors import ConsoleError, GcsError
from gcs.io.recording.schemas import json_schema
from gcs.model import Notice
from gcs.report.export.foxglove import SCHEMAS, FoxgloveMessages, Message, Outline
from gcs.report.export.foxglove_live import LiveMessages

_PERIOD_S: Final = 0.2
_HOST: Final = "127.0.0.1"
_KEPT: Final = ("/map/areas", "/scene/areas", "/map/routes", "/scene/routes", "/notices")
"""Topics whose last message a new subscriber gets."""


def foxglove_sdk() -> Any:
    """Return the module of foxglove-sdk.

    Raises
    ------
    GcsError
        When it is not installed.
    """
    try:
        import foxglove
    except ImportError:
        raise GcsError("gcs foxglove needs foxglove-sdk: pip install 'swarm-gcs[foxglove]'") from None
    return foxglove


class FoxgloveServer:
    """WebSocket that displays connect to.

    Parameters
    ----------
    sdk : module
        That of foxglove-sdk.

    Raises
    ------
    ConsoleError
        When the port is taken.
    """

    def __init__(self, sdk: Any, mission: str, port: int) -> None:
        self._sdk = sdk
        self._context = sdk.Context()
        self._schemas = {
            kind: sdk.Schema(name=f"foxglove.{kind.__name__}", encoding="jsonschema", data=json_schema(kind))
            for kind in SCHEMAS
        }
        self._channels: dict[str, Any] = {}
        self._kept: dict[str, tuple[int, bytes]] = {}
        try:
            self._server = sdk.start_server(
                name=f"swarm-gcs {mission}",
                host=_HOST,
                port=port,
                context=self._context,
                server_listener=self,
            )
        except (OSError, RuntimeError) as error:
            raise ConsoleError(f"gcs foxglove: port {port} cannot be opened ({error})") from None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._server.stop()

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Send the last message of a topic that changes seldom; called on a thread of the SDK."""
        kept = self._kept.get(channel.topic)
        if kept is not None:
            self._channels[channel.topic].log(kept[1], log_time=kept[0], sink_id=client.id)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing."""

    def serve(self, source: Source, console: Console) -> None:
        """Send what a service shows, until Ctrl-C."""
        url = f"ws://localhost:{self._server.port}"
        text = f"{source.mission.name}: in Foxglove open the connection {url}; Ctrl-C ends it"
        console.print(text, highlight=False, markup=False, soft_wrap=True)

        async def run() -> None:
            following = asyncio.create_task(self._follow(source))
            for number in (signal.SIGINT, signal.SIGTERM):
                asyncio.get_running_loop().add_signal_handler(number, following.cancel)
            with contextlib.suppress(asyncio.CancelledError):
                await following

        asyncio.run(run())

    async def _follow(self, source: Source) -> None:
        messages = FoxgloveMessages(frame_of(source.mission))
        fence = [Outline(area.stay_in, area.ring) for area in source.mission.fence]
        live = LiveMessages(messages, fence)
        async for news in news_of(source, _PERIOD_S):
            capture = news.capture
            if capture is not None:
                for message in live.state(capture.t_ns, capture.status, capture.routes, capture.zones):
                    self._log(message)
            pictures = [(picture.t_ns, picture) for picture in news.pictures]
            notices = [(t_ns, effect) for t_ns, effect in news.effects if isinstance(effect, Notice)]
            for t_ns, effect in [*pictures, *notices]:
                for message in messages.effect(t_ns, effect):
                    self._log(message)

    def _log(self, message: Message) -> None:
        topic = message.topic
        if topic not in self._channels:
            self._channels[topic] = self._sdk.Channel(
                topic,
                schema=self._schemas[type(message.value)],
                message_encoding="json",
                context=self._context,
            )
        data = msgspec.json.encode(message.value)
        if topic in _KEPT:
            self._kept[topic] = (message.t_ns, data)
        self._channels[topic].log(data, log_time=message.t_ns)
