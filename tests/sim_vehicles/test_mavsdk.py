"""MAVSDK takes the vehicle for a real ArduPlane: health, mission up and down, start, progress, position."""

from __future__ import annotations

import asyncio
import math
import socket

from mavsdk import asyncio as mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mission_raw import MissionRawAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.mission_raw import MissionItem

from gcs.geo import LocalFrame
from sim_vehicles.vehicle.vehicle import VehicleSpec

FRAME = LocalFrame(33.2, -87.6, 70.0)


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def first(stream, wanted):
    async for value in stream:
        if wanted(value):
            return value
    return None


def mission_items(places):
    items = []
    for seq, (east_m, north_m) in enumerate([(0.0, 0.0), *places]):
        lat, lon = FRAME.to_geodetic(east_m, north_m)
        items.append(
            MissionItem(
                seq=seq,
                frame=6,
                command=16,
                current=int(seq == 0),
                autocontinue=1,
                param1=0.0,
                param2=10.0,
                param3=0.0,
                param4=math.nan,
                x=round(lat * 1e7),
                y=round(lon * 1e7),
                z=100.0,
                mission_type=0,
            )
        )
    return items


async def fly_a_mission(port: int) -> None:
    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    async with mavsdk.Mavsdk(configuration) as client:
        await client.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await client.first_autopilot(timeout_s=10.0)
        assert system is not None, "MAVSDK did not discover the vehicle"
        telemetry, mission = TelemetryAsync(system), MissionRawAsync(system)
        health = await first(
            telemetry.subscribe_health(),
            lambda h: h.is_global_position_ok and h.is_home_position_ok and h.is_armable,
        )
        assert health is not None

        sent = mission_items([(250.0, 200.0), (400.0, 250.0)])
        await mission.upload_mission(sent)
        back = await mission.download_mission()
        assert [(m.seq, m.x, m.y) for m in back[1:]] == [(m.seq, m.x, m.y) for m in sent[1:]]

        progress = mission.subscribe_mission_progress()
        await mission.set_current_mission_item(1)
        await mission.start_mission()
        await first(progress, lambda p: p.current >= 2 and p.total >= 2)

        position = await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 90.0)
        east_m, north_m = FRAME.to_local(position.latitude_deg, position.longitude_deg)
        assert math.dist((east_m, north_m), (250.0, 200.0)) < 80.0
        await ActionAsync(system).hold()


def test_a_mission_from_connect_to_progress(start_process):
    port = free_port()
    start_process(port, VehicleSpec(7, 100.0, 200.0, math.pi / 2, 100.0, 15.0), speed=4.0)
    asyncio.run(asyncio.wait_for(fly_a_mission(port), 40.0))
