"""MAVSDK as mission uploader: the service's side, with its process and the loopback link.

All vehicles' frames go to MAVSDK. Of its frames, only the mission protocol and message requests go to the
targeted vehicle: it can upload, and neither arm nor command. The service reads each upload back.

A process that ends is restarted with growing waits; its uploads are answered as failed.
"""

from __future__ import annotations

import asyncio
import base64
import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import Callable
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.errors import LinkError
from gcs.mavlink.frames.codec import Message, decode
from gcs.model import Upload, UploadAnswer

_MISSION_MESSAGES: Final = frozenset(
    {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_ACK", "MISSION_REQUEST_LIST"}
)
_REQUEST_COMMANDS: Final = frozenset(
    {dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES}
)
_CHECK_S: Final = 30.0
_FIRST_WAIT_S: Final = 1.0
_MAX_WAIT_S: Final = 30.0
_STABLE_S: Final = 60.0
_MAX_DATAGRAM_BYTES: Final = 65_535
REMEDY: Final = "pip install 'mavsdk>=4', or set mission.uploader = \"own\""


def mavsdk_problem() -> str:
    """Start and end MAVSDK; return why that fails, empty if it works."""
    command = [sys.executable, "-P", "-m", "gcs.io.mavsdk.process", "--check"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_CHECK_S, check=False)  # noqa: S603
    except subprocess.TimeoutExpired:
        return f"did not start within {_CHECK_S:.0f} s"
    if done.returncode == 0:
        return ""
    lines = done.stderr.strip().splitlines()
    if done.returncode < 0:
        return f"cannot start: its library ended the process with signal {-done.returncode}"
    return f"cannot start: {lines[-1] if lines else f'exit code {done.returncode}'}"


class MavsdkUploader:
    """Keeps MAVSDK's process running during `run`.

    Parameters
    ----------
    send : callable
        Called with a vehicle's system id and a frame for it.
    answer : callable
        Called with the result of an upload.
    notify : callable
        Called with an operator notice.
    now_ns : callable
        Clock of the run.

    Raises
    ------
    LinkError
        MAVSDK cannot be started.
    """

    def __init__(
        self,
        send: Callable[[int, bytes], None],
        answer: Callable[[UploadAnswer], object],
        notify: Callable[[str], None],
        now_ns: Callable[[], int],
    ) -> None:
        if problem := mavsdk_problem():
            raise LinkError("mavsdk", f"{problem}: {REMEDY}")
        self._send, self._answer, self._notify, self._now_ns = send, answer, notify, now_ns
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind(("127.0.0.1", 0))
        self._peer: tuple[str, int] | None = None
        self._pipe: asyncio.StreamWriter | None = None
        self._pending: dict[int, Upload] = {}
        self._begun: set[int] = set()
        """Vehicles whose pending upload has sent its MISSION_COUNT."""
        self.process_id: int | None = None

    async def run(self) -> None:
        """Keep the process running until cancelled."""
        loop = asyncio.get_running_loop()
        loop.add_reader(self._socket.fileno(), self._drain)
        wait_s = _FIRST_WAIT_S
        try:
            while True:
                began_s = loop.time()
                code = await self._run_process()
                wait_s = _FIRST_WAIT_S if loop.time() - began_s > _STABLE_S else min(2 * wait_s, _MAX_WAIT_S)
                self._notify(f"MAVSDK's process ended with {code}; it is started again in {wait_s:.0f} s")
                for vehicle in list(self._pending):
                    self._settle(vehicle, ok=False, detail=f"MAVSDK's process ended with {code}")
                await asyncio.sleep(wait_s)
        finally:
            loop.remove_reader(self._socket.fileno())
            self._socket.close()

    async def _run_process(self) -> int:
        """Run the process once; return its exit code."""
        port = self._socket.getsockname()[1]
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-m", "gcs.io.mavsdk.process", str(port),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.DEVNULL,
        )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        self._pipe, self.process_id = process.stdin, process.pid
        try:
            while line := await process.stdout.readline():
                self._on_answer(line)
            return await process.wait()
        finally:
            self._pipe = self._peer = self.process_id = None
            if process.returncode is None:
                process.kill()
                await process.wait()

    def upload(self, request: Upload) -> None:
        """Start a mission upload."""
        self._pending[request.vehicle] = request
        self._begun.discard(request.vehicle)
        if self._pipe is None or self._pipe.is_closing():
            self._settle(request.vehicle, ok=False, detail="MAVSDK's process is not running")
            return
        frames = base64.b64encode(request.frames).decode("ascii")
        line = {"vehicle": request.vehicle, "mission_id": request.mission_id, "frames": frames}
        self._pipe.write(json.dumps(line).encode() + b"\n")

    def forward(self, data: bytes) -> None:
        """Forward vehicles' frames to MAVSDK."""
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._peer)

    def _on_answer(self, line: bytes) -> None:
        try:
            raw = json.loads(line)
            vehicle, mission_id = int(raw["vehicle"]), int(raw["mission_id"])
        except (ValueError, KeyError, TypeError):
            return  # MAVSDK's library writes its log there as well
        pending = self._pending.get(vehicle)
        if pending is not None and pending.mission_id == mission_id:
            self._settle(vehicle, ok=bool(raw["ok"]), detail=str(raw["detail"]))

    def _settle(self, vehicle: int, *, ok: bool, detail: str) -> None:
        request = self._pending.pop(vehicle)
        begun = vehicle in self._begun
        self._answer(UploadAnswer(self._now_ns(), vehicle, request.mission_id, ok, begun, detail))

    def _drain(self) -> None:
        while True:
            try:
                data, self._peer = self._socket.recvfrom(_MAX_DATAGRAM_BYTES)
            except (BlockingIOError, InterruptedError):
                return
            except OSError:
                continue
            for message in decode(data)[0]:
                self._pass_on(message)

    def _pass_on(self, message: Message) -> None:
        name, vehicle = message.get_type(), getattr(message, "target_system", 0)
        question = name == "COMMAND_LONG" and message.command in _REQUEST_COMMANDS
        if vehicle not in self._pending or not (question or name in _MISSION_MESSAGES):
            return
        if name == "MISSION_COUNT":
            self._begun.add(vehicle)
        self._send(vehicle, bytes(message.get_msgbuf()))
