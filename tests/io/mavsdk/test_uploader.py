"""A user would lose the service to MAVSDK's crash, or a vehicle to what MAVSDK may command."""

import asyncio
import os
import signal
import time

import pytest

from gcs.errors import LinkError
from gcs.geo import LocalFrame
from gcs.io.mavsdk.uploader import MavsdkUploader, mavsdk_problem
from gcs.mavlink.autopilots import ARDUPLANE
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Mission, Upload, Waypoint
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

HOME = Home(33.2, -87.6, 70.0)
ROUTE = tuple(Waypoint(33.2 + n * 1e-3, -87.6, 100.0, 10.0) for n in range(6))
ITEMS = build_items(ARDUPLANE, Mission(1, 7, ROUTE), HOME)
FRAMES = b"".join(map(Encoder(), (item.message(seq, 7, 1) for seq, item in enumerate(ITEMS))))


@pytest.mark.parametrize(
    ("library", "words"),
    [
        ("", "No module named 'mavsdk.asyncio'"),  # MAVSDK 3
        ("import os; os.abort()", "signal 6"),
    ],
)
def test_a_mavsdk_that_cannot_start_is_found_before_the_flight(tmp_path, monkeypatch, library, words):
    (tmp_path / "mavsdk").mkdir()
    (tmp_path / "mavsdk" / "__init__.py").write_text(library)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert words in mavsdk_problem()
    with pytest.raises(LinkError, match=r"mavsdk>=4.*uploader"):
        MavsdkUploader(print, print, print, time.time_ns)


def test_a_mavsdk_that_starts_is_no_problem():
    assert mavsdk_problem() == ""


async def scene():
    """One vehicle behind the uploader; its process is killed between two uploads."""
    vehicle = SimVehicle(VehicleSpec(7, 0.0, 0.0, 0.0, 100.0, 15.0), LocalFrame(*HOME), time.time_ns())
    sent, answers, notices = set(), [], []

    def send(system_id, frame):
        sent.update((system_id, message.get_type()) for message in decode(frame)[0])
        vehicle.receive_datagram(frame, time.time_ns())

    uploader = MavsdkUploader(send, answers.append, notices.append, time.time_ns)
    running = asyncio.create_task(uploader.run())

    async def until(condition):
        while not condition():
            await asyncio.sleep(0.01)
            for data in vehicle.datagrams_to_send(time.time_ns()):
                uploader.forward(data)

    uploader.upload(Upload(7, 1, FRAMES))
    await until(lambda: uploader.process_id is not None)
    uploader.upload(Upload(7, 2, FRAMES))
    await until(lambda: len(answers) == 2)
    first = uploader.process_id
    os.kill(first, signal.SIGKILL)
    uploader.upload(Upload(7, 3, FRAMES))
    await until(lambda: uploader.process_id not in (None, first))
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)
    return vehicle, sent, answers, notices


def test_it_uploads_commands_nothing_and_survives_the_death_of_its_process():
    vehicle, sent, answers, notices = asyncio.run(asyncio.wait_for(scene(), 60.0))
    early, good, killed = answers
    assert (early.ok, early.begun, early.detail) == (False, False, "MAVSDK's process is not running")
    assert (good.ok, good.begun, good.mission_id) == (True, True, 2)
    assert (killed.ok, killed.begun, killed.mission_id) == (False, False, 3)
    assert "-9" in notices[0]
    assert "started again" in notices[0]
    assert ARDUPLANE.difference(ITEMS, [*ITEMS[:1], *_held(vehicle)]) == ""
    assert {name for _, name in sent} <= {"MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_ACK", "COMMAND_LONG"}
    assert vehicle.autopilot.mode.name == "LOITER"


def _held(vehicle):
    from gcs.mavlink.mission.items import Item

    stored = list(vehicle.autopilot.mission)[1:]
    return [Item(i.command, i.frame, i.x, i.y, i.z, i.param1, i.param2, i.param3, i.param4) for i in stored]
