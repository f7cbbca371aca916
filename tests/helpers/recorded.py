"""A run with every kind of record, and its recording."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.io.record_json import encode
from gcs.io.recording.folder import Run
from gcs.io.recording.reader import Damage, Record
from gcs.io.recording.recorder import DiskBudget, Recorder
from gcs.io.recording.topics import Recordable
from gcs.model import (
    NS_PER_S,
    AgentStatus,
    BadInput,
    ClockStep,
    Datagram,
    LaggedPicture,
    LinkNews,
    MissionEnded,
    NoFlyZone,
    Notice,
    NoticeCode,
    Order,
    OrderAnswer,
    Picture,
    Plan,
    Proposal,
    Resumed,
    Route,
    Scan,
    Send,
    Sensor,
    Snapshot,
    SwarmStatus,
    Tick,
    Track,
    Truth,
    TruthObject,
    UploadReport,
    read_only,
)

T0_NS = 1_767_225_600 * NS_PER_S
CONFIG = 'name = "demo"  # ünïcode\n'
VERSIONS = {"swarm-gcs": "0.1.0", "numpy": "2.0"}
EVENTS = (Datagram, Scan, Tick, BadInput, LinkNews, ClockStep, Order, Resumed)


def frames(system_id: int, count: int, first: int = 0) -> bytes:
    packer = mavlink.MAVLink(None, srcSystem=system_id)
    data = b""
    for number in range(first, first + count):
        packer.seq = number % 256
        data += mavlink.MAVLink_attitude_message(number, 0.1, 0.2, 0.3, 0, 0, 0).pack(packer)
    return data


def a_run(seconds: int) -> Iterator[tuple[int, Recordable]]:
    """Every kind of record, in an order that times alone would not give back."""
    rng = np.random.default_rng(7)
    sensor = Sensor("radar", 0.98, 5e-6, read_only(np.eye(2) * 10), (0.0, 0.0, 2000.0, 2000.0))
    for second in range(seconds):
        t_ns = T0_NS + second * NS_PER_S
        yield t_ns, Tick(t_ns)
        yield t_ns - 5, Datagram(t_ns - 5, "udp", "127.0.0.1:5000", frames(1, 3, second))
        yield t_ns, BadInput(t_ns, "udp", 'not "MAVLink"')
        yield (
            t_ns,
            LinkNews(
                Notice(t_ns, NoticeCode.LINK_FAILED, "tcp:10.0.0.1:5760", {"problem": "connection lost"})
            ),
        )
        yield t_ns, ClockStep(t_ns, -20 * NS_PER_S)
        yield t_ns, Truth(t_ns, (TruthObject("agents", 1, float(second), 0.1, second % 2 == 0),))
        yield t_ns, Scan(t_ns, t_ns - 9, sensor, read_only(rng.normal(size=(second % 4, 2))))
        for kind in ("agents", "targets"):
            track = Track((0, second), read_only(rng.normal(size=4)), read_only(rng.normal(size=(4, 4))), 0.9)
            yield t_ns, Picture(t_ns, t_ns, kind, (track,), read_only(rng.dirichlet([1, 1])))
        yield t_ns, LaggedPicture(t_ns, t_ns - NS_PER_S, "targets", ())
        yield (
            t_ns,
            Plan(t_ns, t_ns, (Route(1, (0, 1), read_only([[1.0, 2.0]]), 3.0),), (2,), ((0, 3),), "why", (1,)),
        )
        yield t_ns, Send("udp", "127.0.0.1:5000", frames(255, 1, second))
        yield t_ns, UploadReport(t_ns, 1, 4, 9, True, "verified", 0.25, 1)
        yield t_ns, Notice(t_ns, NoticeCode.NO_LAYER_LEFT, None, {"note": "älarm", "vehicles": (1, 2)})
        area = NoFlyZone("fire", None, ((0.0, 0.1), (1.0, 0.0), (1.0, 1.0)))
        yield t_ns, Order(t_ns, f"o-{second}", "no-fly-zone", None, None, area, "operator")
        yield t_ns, Snapshot(t_ns, bytes(range(second % 256)))
        yield t_ns, Resumed(t_ns, t_ns - second)
        yield t_ns, OrderAnswer(t_ns, f"o-{second}", "no-fly-zone", "done", "so it is", None, ())
        yield t_ns, SwarmStatus(t_ns, f"s-{second}", (), (), (), None, False)
        yield t_ns, Proposal(t_ns, second + 1, (Route(1, (0, 1), read_only([[1.0, 2.0]]), 3.0),), "why")
        yield t_ns, AgentStatus(t_ns, 1, "lost", None, (1.0, 2.0))
    yield t_ns, MissionEnded(t_ns, (1,), (2,))


def record(recorder: Recorder, run: Iterator[tuple[int, Recordable]]) -> list[Recordable]:
    values = []
    for t_ns, value in run:
        if isinstance(value, EVENTS):
            recorder.record_event(value)
        elif isinstance(value, Truth):
            recorder.record_truth(value)
        elif isinstance(value, Snapshot):
            recorder.record_snapshot(value)
        else:
            recorder.record_effect(t_ns, value)
        values.append(value)
        if isinstance(value, AgentStatus):
            recorder.flush()
    return values


def texts(values: list[Recordable]) -> list[bytes]:
    """Records hold arrays, which `==` cannot compare; their JSON is exact."""
    return [encode(value) for value in values]


def whole(records: list[Record]) -> list[Recordable]:
    return [r.value for r in records if not isinstance(r.value, Damage)]


def in_parts(folder: Path, seconds: int, rotate_bytes: int) -> list[Recordable]:
    with Recorder(folder, CONFIG, VERSIONS, Run("demo", 5), DiskBudget(rotate_bytes)) as recorder:
        return record(recorder, a_run(seconds))
