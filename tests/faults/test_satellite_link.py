"""A user would lose a vehicle whose radio ends in flight, or task it over a satellite."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from helpers.noticed import noticed

from gcs.mavlink.frames.codec import Encoder, decode
from gcs.model import NS_PER_S, AgentStatus, Effect, NoticeCode, Plan, Send, UploadReport
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.telemetry import Telemetry
from sim_vehicles.world.scenario import load

PERIOD_NS = 5 * NS_PER_S
RADIO_ENDS_NS = START_T_NS + 12 * NS_PER_S


def flown(seconds: float, radio_again_s: float) -> list[tuple[int, Effect]]:
    """Fly a mission in which vehicle 1 has HIGH_LATENCY2 alone for a while; return all effects."""
    effects: list[tuple[int, Effect]] = []
    encode = Encoder(1, 1)
    sent_ns = [RADIO_ENDS_NS]

    def tamper(t_ns: int, peer: str, data: bytes) -> Iterable[tuple[str, bytes]]:
        is_gone = RADIO_ENDS_NS <= t_ns < START_T_NS + radio_again_s * NS_PER_S
        if peer != "vehicle:1" or not is_gone:
            return [(peer, data)]
        if t_ns - sent_ns[0] < PERIOD_NS:
            return []
        sent_ns[0] = t_ns
        return [("satellite", encode(telemetry.high_latency2(t_ns)))]

    run = VirtualRun(load("prescribed"), 3, tamper=tamper, on_effect=lambda *one: effects.append(one))
    telemetry = Telemetry(run.vehicles["vehicle:1"].autopilot, 1.0, np.random.default_rng(1))
    run.run(seconds)
    return effects


def test_a_vehicle_on_its_satellite_link_is_tracked_and_left_to_its_mission() -> None:
    effects = flown(70.0, 45.0)
    only = [effect for _, effect in effects]
    codes = (NoticeCode.HIGH_LATENCY, NoticeCode.HIGH_LATENCY_OVER, NoticeCode.ID_CONFLICT)
    told = [one for one in noticed(only, *codes) if one.vehicle == 1]
    assert [one.code for one in told] == ["high-latency", "high-latency-over"]
    begin_ns, end_ns = told[0].t_ns, told[1].t_ns
    assert begin_ns - RADIO_ENDS_NS <= 12 * NS_PER_S
    assert not [
        one for one in only if isinstance(one, AgentStatus) and one.vehicle == 1 and one.status == "lost"
    ]
    down = [one for one in noticed(only, NoticeCode.LINK_STALE, NoticeCode.LINK_DOWN) if one.vehicle == 1]
    assert all(one.t_ns <= begin_ns for one in down)
    sent = [s for t_ns, s in effects if isinstance(s, Send) and s.peer == "satellite" and t_ns > begin_ns]
    names = {message.get_type() for one in sent for message in decode(one.data)[0]}
    assert not names, "no requests, no heartbeats, no missions"
    assert any(isinstance(one, Plan) for one in only)
    uploads = [one for one in only if isinstance(one, UploadReport) and one.vehicle == 1]
    assert not [one for one in uploads if begin_ns < one.t_ns < end_ns]
    read_back = [one for one in noticed(only, NoticeCode.ONBOARD_VERIFIED) if one.vehicle == 1]
    assert read_back, "by radio"
    assert all(one.t_ns > end_ns for one in read_back)
