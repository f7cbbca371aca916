"""MAVSDK mission uploads in a process of their own, since MAVSDK's library may abort its process.

``python -m gcs.io.mavsdk.process PORT`` connects MAVSDK to a UDP port on loopback, where the service forwards
frames in both directions. A JSON line on standard input requests an upload, ``{"vehicle": 1, "mission_id": 7,
"frames": "<base64 of MISSION_ITEM_INT frames>"}``. A JSON line on standard output answers, ``{"vehicle": 1,
"mission_id": 7, "ok": true, "detail": ""}``. The process ends when standard input closes.

``python -m gcs.io.mavsdk.process --check`` starts and ends MAVSDK; exit code 0 if that works.
"""

from __future__ import annotations

import asyncio
import base64
import json
import sys
from typing import Any, Final

import mavsdk
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.plugins.mission_raw import MissionItem

from gcs.mavlink.frames.codec import decode

SYSTEM_ID: Final = 245
"""MAVSDK's own: vehicles answer it and not us."""
COMPONENT_ID: Final = 190
_DISCOVERY_S: Final = 10.0


async def _system(client: Any, vehicle: int) -> Any:
    for _ in range(round(_DISCOVERY_S / 0.1)):
        for system in await client.get_systems():
            if await system.get_system_id() == vehicle:
                return system
        await asyncio.sleep(0.1)
    raise TimeoutError(f"MAVSDK did not discover vehicle {vehicle}")


async def _upload(client: Any, request: dict[str, Any]) -> None:
    ok, detail = True, ""
    try:
        messages = decode(base64.b64decode(request["frames"]))[0]
        marked = next((m.seq for m in messages if m.current), 0)  # MAVSDK insists on exactly one
        items = [
            MissionItem(
                seq=m.seq,
                frame=m.frame,
                command=m.command,
                current=int(m.seq == marked),
                autocontinue=m.autocontinue,
                param1=m.param1,
                param2=m.param2,
                param3=m.param3,
                param4=m.param4,
                x=m.x,
                y=m.y,
                z=m.z,
                mission_type=m.mission_type,
            )
            for m in messages
        ]
        system = await _system(client, request["vehicle"])
        await MissionRawAsync(system).upload_mission(items)
    except Exception as error:
        ok, detail = False, f"MAVSDK: {getattr(getattr(error, 'result', None), 'name', error)}"
    answer = {"vehicle": request["vehicle"], "mission_id": request["mission_id"], "ok": ok, "detail": detail}
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def _client() -> Any:
    return Mavsdk(mavsdk.Configuration.create_manual(SYSTEM_ID, COMPONENT_ID, True))


async def _check() -> None:
    async with _client():
        pass


async def _serve(port: int) -> None:
    loop = asyncio.get_running_loop()
    lines = asyncio.StreamReader()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    async with _client() as client:
        await client.add_any_connection(f"udpout://127.0.0.1:{port}")
        tasks: set[asyncio.Task[None]] = set()
        while line := await lines.readline():
            task = loop.create_task(_upload(client, json.loads(line)))
            tasks.add(task)
            task.add_done_callback(tasks.discard)


if __name__ == "__main__":
    asyncio.run(_check() if sys.argv[1] == "--check" else _serve(int(sys.argv[1])))
