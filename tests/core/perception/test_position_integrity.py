"""A user would believe a vehicle that is led astray: what it reports is held against what sensors see."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.config.schema import TelemetryTable
from gcs.core.perception.detection_gate import GATE_CHI2, near
from gcs.core.perception.mahalanobis import squared_distances
from gcs.core.perception.position_integrity import PositionIntegrityMonitor
from gcs.core.state import State
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.model import NS_PER_S, Notice, NoticeCode, Scan, Sensor, Track, VehicleState, read_only
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.world.scenario import load

S = NS_PER_S


def sensor(p_d=0.95, clutter_per_m2=4e-6, field=(0.0, 0.0, 2000.0, 2000.0)):
    return Sensor("radar", p_d, clutter_per_m2, read_only(np.eye(2) * 10.0), field)


def state(t_s, east_m=1000.0, *, armed=True):
    return VehicleState(1, round(t_s * S), east_m, 1000.0, 170.0, 15.0, math.pi / 2, "AUTO", armed, 1)


def track(label, east_m, north_m=1000.0):
    return Track(label, read_only([east_m, north_m, 15.0, 0.0]), read_only(np.eye(4) * 9.0), 1.0, True)


def alarms_of(detections, *, seconds=10, seer=None, armed=True, agents=None, targets=(), reports=None):
    """Notices with their times; `detections` takes the second and returns places."""
    known = State.initial([1]).agents
    known[1].perception.association.label = (0, 1)
    monitor, notices = PositionIntegrityMonitor(known, TelemetryTable()), []
    for t_s in range(seconds):
        z = np.reshape(detections(t_s), (-1, 2))
        scan = Scan(t_s * S, t_s * S, seer or sensor(), read_only(z))
        states = [state(t_s - 0.1, *([] if reports is None else [reports(t_s)]), armed=armed)]
        found = monitor.update(scan, states, agents or {}, targets)
        notices += [(t_s, notice) for notice in found]
    return notices


def there(_t_s):
    return [(1001.5, 1000.0)]


def nowhere(_t_s):
    return []


def test_a_vehicle_that_is_seen_at_its_report_gets_no_warning():
    assert alarms_of(there, seconds=100) == []
    rng = np.random.default_rng(3)
    assert alarms_of(lambda _t: there(0) if rng.random() < 0.95 else [], seconds=500) == []


def test_one_that_is_not_seen_is_an_alarm_within_seconds_and_an_all_clear_after_as_many():
    notices = alarms_of(lambda t: nowhere(t) if t < 10 else there(t), seconds=20)
    told = [(t, notice.code) for t, notice in notices]
    assert told == [(3, NoticeCode.NOT_SEEN_THERE), (13, NoticeCode.SEEN_THERE)]


def test_a_single_miss_or_two_raise_nothing():
    assert alarms_of(lambda t: nowhere(t) if t % 4 == 3 else there(t), seconds=60) == []


@pytest.mark.parametrize("settings", [{"seer": sensor(field=(0, 0, 900, 2000))}, {"armed": False}])
def test_out_of_view_and_on_the_ground_there_is_no_warning(settings):
    assert alarms_of(nowhere, **settings) == []


def test_a_weak_sensor_needs_longer_and_a_crowd_clears_no_vehicle():
    weak = alarms_of(nowhere, seer=sensor(p_d=0.5), seconds=20)
    assert weak[0][0] > 10
    neighbours = [track((5, 0), 1005.0)]
    notices = alarms_of(lambda t: nowhere(t) if t < 6 else there(t), targets=neighbours, seconds=30)
    assert [notice.level for _, notice in notices] == ["alarm"], "what is seen there may be the other object"


def test_the_alarm_names_the_seen_place():
    def reports(t_s):
        return 1000.0 if t_s < 5 else 1400.0

    notices = alarms_of(there, reports=reports, agents={(0, 1): track((0, 1), 1001.0)}, seconds=15)
    ((_, notice),) = notices
    assert notice.code is NoticeCode.SEEN_ELSEWHERE
    assert notice.parameters["distance_m"] == pytest.approx(400.0, abs=0.5)


# ---------------------------------------------------------------- on a hostile link


class Hostile:
    """Changes what every vehicle says, each in a way of its own, from 12 s to 32 s."""

    def __init__(self, changes) -> None:
        self._changes = changes
        self._encoders = {vehicle: Encoder(vehicle, 1) for vehicle in changes}
        self.kept = None

    def __call__(self, t_ns, peer, data):
        t_s, vehicle = (t_ns - START_T_NS) / S, int(peer.removeprefix("vehicle:"))
        if vehicle not in self._changes or not 12.0 <= t_s < 32.0:
            return [(peer, data)]
        change, is_twin = self._changes[vehicle]
        messages, _ = decode(data)
        for message in messages:
            if message.get_type() == "GLOBAL_POSITION_INT":
                change(self, t_s, message)
        changed = b"".join(self._encoders[vehicle](message) for message in messages)
        return [(peer, data), (is_twin or peer, changed)] if is_twin is not None else [(peer, changed)]


def freeze(hostile, _t_s, message):
    hostile.kept = hostile.kept or (message.lat, message.lon)
    message.lat, message.lon = hostile.kept


def lead_astray(_hostile, t_s, message):
    """Pull it away slowly, as who captures a receiver does."""
    message.lon += round(min(12.0 * (t_s - 12.0), 200.0) / 93_000 * 1e7)


def be_another(_hostile, _t_s, message):
    message.lat += 90_000
    message.time_boot_ms += 77_000


HOSTILE = {
    1: (lambda *_: None, "elsewhere"),  # an impostor neighbours it
    2: (freeze, None),
    3: (lead_astray, None),
    4: (be_another, ""),  # a twin behind the same radio
}


def notices_of(changes, seconds=50.0):
    notices = []
    run = VirtualRun(
        load("prescribed"),
        1,
        tamper=Hostile(changes),
        on_effect=lambda _t, effect: notices.append(effect) if isinstance(effect, Notice) else None,
    )
    run.run(seconds)
    return run, [((notice.t_ns - START_T_NS) / S, notice) for notice in notices]


def test_hostile_links_are_an_alarm_each_on_the_right_vehicle_and_have_their_all_clear():
    _, notices = notices_of(HOSTILE)
    codes = NoticeCode
    for vehicle, begin, end, within_s in (
        (1, {codes.ID_CONFLICT}, codes.ID_CONFLICT_OVER, 1.0),
        (2, {codes.POSITION_FROZEN}, codes.POSITION_MOVES, 6.0),
        (3, {codes.NOT_SEEN_THERE, codes.SEEN_ELSEWHERE}, codes.SEEN_THERE, 15.0),
        (4, {codes.DUPLICATE_ID}, codes.DUPLICATE_ID_OVER, 4.0),
    ):
        alarms = [(t, one.vehicle) for t, one in notices if one.code in begin]
        clears = [(t, one.vehicle) for t, one in notices if one.code is end]
        # One that is frozen is not where it reports to be either.
        assert {v for _, v in alarms} - ({2} if vehicle == 3 else set()) == {vehicle}, begin
        assert 12.0 <= alarms[0][0] < 12.0 + within_s, begin
        assert [v for _, v in clears] == [vehicle], begin
        assert 32.0 < clears[0][0] < 45.0, begin


def test_an_honest_flight_raises_no_alarm():
    run, notices = notices_of({})
    assert [notice for _, notice in notices if notice.level == "alarm"] == []
    assert not any(one.perception.integrity.is_alarmed for one in run.engine.state.agents.values())


@pytest.mark.parametrize("seed", range(5))
def test_the_tree_finds_the_pairs_that_all_distances_show(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(0, 60, 2)
    places, points = rng.uniform(0, 300, (n, 2)), rng.uniform(0, 300, (m, 2))
    points[rng.random(m) < 0.1] = np.nan
    roots = rng.normal(0.0, 8.0, (n, 2, 2))
    S = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2)
    rows, columns = near(places, S, points)
    wanted = np.argwhere(squared_distances(points, places, S).T <= GATE_CHI2)
    assert sorted(zip(rows.tolist(), columns.tolist(), strict=True)) == [
        tuple(pair) for pair in wanted.tolist()
    ]
