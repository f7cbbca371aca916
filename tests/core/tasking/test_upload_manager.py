"""A user would lose vehicles to transfers that crowd each other, or forget what a vehicle was left with."""

import random

import numpy as np
import pytest
from helpers.missions import upload_manager
from helpers.noticed import alarms, noticed
from helpers.plane_double import AUTO, LOITER, MANUAL, S
from helpers.plane_swarm import FRAME, ROUTE, Swarm
from helpers.px4_double import HOLD, Px4

from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.mavlink.fleet.fleet import Fleet
from gcs.mavlink.mission.upload import Upload
from gcs.mavlink.mission.upload_stages import RuleError, Stage
from gcs.model import ControlEvent, NoticeCode, Route, Send, Tick, read_only
from gcs.planning.manoeuvres.landing import ReturnRoute
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.campaign.virtual_run import VirtualRun
from sim_vehicles.world.scenario import load

END_AFTER_ERROR = Upload.end_after_error


def test_uploads_wait_for_the_window_of_their_link_and_all_are_delivered():
    swarm = Swarm(12, most=3)
    for plane in swarm.planes.values():
        plane.ignores.add("MISSION_REQUEST_LIST")  # so that they last
    for vehicle in swarm.planes:
        swarm.task(vehicle)
    assert sorted(swarm.tasking.state.stages.values()).count("waiting") == 9
    swarm.run(1.0)
    for plane in swarm.planes.values():
        plane.ignores.clear()
    swarm.run(30.0)
    assert sorted(report.vehicle for report in swarm.reports() if report.ok) == list(swarm.planes)
    assert swarm.busiest <= 3


def test_an_operators_loiter_is_reported_and_kept_until_an_order():
    swarm = Swarm(1)
    swarm.task(1)
    swarm.run(5.0)
    assert swarm.planes[1].mode == AUTO
    assert swarm.tasking.overrides.modes() == {}
    swarm.planes[1].mode = LOITER
    swarm.run(2.0)
    assert swarm.tasking.overrides.modes() == {1: "LOITER"}
    swarm.tasking.release_override(1, 0)
    assert swarm.tasking.overrides.modes() == {}


def test_a_vehicle_counted_as_lost_in_mid_upload_is_cleared_when_it_is_heard():
    swarm = Swarm(1)
    swarm.task(1)
    swarm.run(5.0)
    plane = swarm.planes[1]
    plane.ignores.add("MISSION_ITEM_INT")
    swarm.task(1, read_only(np.flip(ROUTE, axis=0)))
    swarm.run(3.0)
    swarm.tasking.cancel(1, swarm.t_ns)
    plane.ignores.clear()
    swarm.run(15.0)
    assert plane.store == []
    assert plane.mode == LOITER
    assert without_mission(swarm)


def test_a_firmware_that_is_not_known_gets_no_mission():
    swarm = Swarm(1)
    swarm.fleet._vehicles[1].link.vehicle_type = 0
    swarm.task(1)
    swarm.run(1.0)
    (report,) = swarm.reports()
    assert not report.ok
    assert "firmware" in report.detail
    assert swarm.planes[1].store == []


@pytest.mark.parametrize("mode", [LOITER, MANUAL])
def test_a_reboot_in_mid_upload_starts_it_again_unless_a_pilot_flies(mode):
    swarm = Swarm(1)
    plane = swarm.planes[1]
    plane.ignores.add("MISSION_ITEM_INT")
    swarm.task(1)
    swarm.run(2.0)
    plane.reboot(swarm.t_ns)
    plane.ignores.clear()
    plane.mode = mode
    swarm.fleet._vehicles[1].link.boots += 1
    swarm.run(15.0)
    (report,) = swarm.reports()
    if mode == LOITER:
        assert (len(plane.store), plane.mode, report.ok) == (5, AUTO, True)
    else:
        assert (plane.store, plane.mode) == ([], MANUAL)
        assert "MANUAL was chosen" in report.detail


def test_a_vehicle_about_to_take_its_next_item_is_not_made_to_hold_for_a_new_mission(monkeypatch):
    """It would turn where no route does; seconds later, past the item, it need not."""
    assert holds_in_flight() <= 1
    monkeypatch.setattr("gcs.core.tasking.upload_manager._MAX_ITEM_WAIT_NS", 0)
    assert holds_in_flight() >= 3


def holds_in_flight():
    """How often vehicles hold in a minute of re-tasks."""
    modes, holds = {}, []

    def on_event(event):
        if isinstance(event, Tick):
            for name, vehicle in run.vehicles.items():
                mode = vehicle.autopilot.mode
                if (modes.get(name), mode) == (Mode.AUTO, Mode.LOITER):
                    holds.append(name)
                modes[name] = mode

    run = VirtualRun(load("random-targets"), 3, on_event)
    run.run(60.0)
    return len(holds)


def test_on_a_lossy_link_a_upload_is_let_end_though_ever_newer_routes_come(monkeypatch):
    """A vehicle would circle for minutes over transfers that all give way to the next one."""
    delivered = sum(report.ok for report in re_tasked_on_a_bad_link().reports())
    monkeypatch.setattr("gcs.core.tasking.upload_pauses._SUPERSEDE_NS", 10**12)
    assert delivered >= 3 * max(1, len(re_tasked_on_a_bad_link().reports()))


def re_tasked_on_a_bad_link():
    swarm, rng = Swarm(1), np.random.default_rng(1)
    plane = swarm.planes[1]
    hear = plane.receive
    plane.receive = lambda data, t_ns: hear(data, t_ns) if rng.random() > 0.8 else []
    for n in range(120):
        swarm.task(1, ROUTE + float(n))
        swarm.run(1.0)
    return swarm


def test_a_route_that_waits_is_not_sent_to_a_vehicle_under_an_override():
    swarm = Swarm(2, most=1)
    swarm.planes[1].ignores.add("MISSION_REQUEST_LIST")  # so that it lasts
    swarm.task(1)
    swarm.task(2)
    assert swarm.tasking.state.stages[2] == "waiting"
    swarm.planes[2].mode = MANUAL
    swarm.run(2.0)
    swarm.planes[1].ignores.clear()
    swarm.run(15.0)
    assert swarm.planes[2].store == []
    (detail,) = [report.detail for report in swarm.reports() if report.vehicle == 2]
    assert detail == "not begun: MANUAL was chosen meanwhile"


def test_a_route_that_is_not_wanted_any_more_waits_no_longer():
    swarm = Swarm(2, most=1)
    swarm.planes[1].ignores.add("MISSION_REQUEST_LIST")  # so that it lasts
    swarm.task(1)
    swarm.task(2)
    assert swarm.tasking.withdraw_except({1}) == [2]
    swarm.planes[1].ignores.clear()
    swarm.run(15.0)
    assert swarm.planes[2].store == []
    assert [report.vehicle for report in swarm.reports()] == [1]


def test_a_route_takes_the_place_of_a_clearing_and_the_link_is_free_afterwards():
    swarm = Swarm(2, most=1)
    swarm.planes[1].ignores.add("MISSION_REQUEST_LIST")
    swarm.task(1)
    swarm.task(2)
    swarm.tasking.mark_inconsistent(2)
    swarm.run(2.0)
    swarm.planes[1].ignores.clear()
    swarm.run(30.0)
    assert sorted(report.vehicle for report in swarm.reports() if report.ok) == [1, 2]
    swarm.task(1, ROUTE + 5.0)  # a place that was lost would keep everybody waiting for ever
    swarm.run(15.0)
    assert [report.vehicle for report in swarm.reports() if report.ok][-1] == 1


def test_after_failures_a_vehicle_is_tasked_again_ever_more_slowly_with_notices():
    swarm = Swarm(1)
    swarm.planes[1].ignores |= {"MISSION_COUNT", "MISSION_CLEAR_ALL"}
    for _ in range(160):
        if not swarm.tasking.state.has_pending(1):
            swarm.task(1)
        swarm.run(2.0)
    failed_s = [report.t_ns / S for report in swarm.reports()]
    assert len(failed_s) >= 4
    failed = noticed(swarm.effects, NoticeCode.UPLOADS_FAILED)
    assert [alarm.parameters["pause_s"] for alarm in failed[:3]] == [5.0, 10.0, 20.0]
    swarm.planes[1].ignores.clear()
    swarm.run(60.0)
    assert swarm.reports()[-1].ok


def test_a_vehicle_that_keeps_its_inconsistent_mission_is_given_up_with_an_alarm():
    """It acknowledged each clearing; MISSION_CLEAR_ALL was sent ten times a second for ever."""
    swarm, clearings = Swarm(1), []
    plane = swarm.planes[1]
    swarm.task(1)
    swarm.run(5.0)

    def deaf(_message, sender, t_ns):
        clearings.append(t_ns)
        return [plane._ack(0, sender)]

    obeys, plane._on_mission_clear_all = plane._on_mission_clear_all, deaf
    swarm.tasking.mark_inconsistent(1)
    swarm.run(300.0)
    assert len(clearings) <= 40
    codes = (NoticeCode.CLEARING_FAILED, NoticeCode.CLEARING_GIVEN_UP)
    *failed, given_up = noticed(swarm.effects, *codes)
    assert [alarm.parameters["pause_s"] for alarm in failed[:2]] == [5.0, 10.0]
    assert [alarm.code for alarm in (*failed, given_up)] == [codes[0]] * 4 + [codes[1]]
    plane._on_mission_clear_all = obeys
    swarm.tasking.release_override(1, swarm.t_ns)
    swarm.run(10.0)
    assert plane.store == []


@pytest.mark.parametrize(("mode", "is_cleared"), [(LOITER, False), (AUTO, True)])
def test_an_inconsistent_mission_of_a_vehicle_of_two_services_is_cleared_only_where_it_would_be_flown(
    mode, is_cleared
):
    """Nothing else is sent before an operator decides."""
    swarm = Swarm(1)
    swarm.task(1)
    swarm.run(5.0)
    plane, claims = swarm.planes[1], swarm.tasking._agents[1].claims
    swarm.carry(swarm.tasking.yield_up(1, "another service", swarm.t_ns))
    claims.apply(ControlEvent.COMMANDED_ELSEWHERE, swarm.t_ns)
    swarm.tasking.mark_inconsistent(1)
    swarm.tasking.overrides.of(1).note_command("LOITER")
    plane.mode = mode
    swarm.run(10.0)
    assert (plane.store == []) is is_cleared
    assert plane.mode == LOITER
    claims.apply(ControlEvent.RESUME, swarm.t_ns)
    swarm.run(10.0)
    assert plane.store == []


def px4_swarm(**options):
    swarm = Swarm(0)
    swarm.planes = {1: Px4(1, **options)}
    swarm.fleet = Fleet(swarm.planes, FRAME)
    swarm.tasking = upload_manager(swarm.fleet, FRAME, swarm.planes)
    swarm.run(2.0)
    return swarm


def without_mission(swarm):
    """Return why vehicles were left without a mission."""
    told = noticed(swarm.effects, NoticeCode.WITHOUT_MISSION)
    return [
        one.parameters["detail"] for one in told if one.parameters["state"] == "has no onboard mission now"
    ]


def test_a_refused_mission_that_is_cleared_from_a_px4_is_reported():
    swarm = px4_swarm(tamper=lambda fields: (*fields[:5], fields[5] + 1.0, *fields[6:]))
    swarm.task(1)
    swarm.run(60.0)
    assert swarm.planes[1].store == []
    assert any(detail.startswith("read-back differs") for detail in without_mission(swarm))


def test_a_newer_route_takes_the_place_of_the_upload_after_a_rejected_one():
    """The time for that began with the rejected upload: the outdated mission was uploaded to its end."""
    swarm = px4_swarm(rejects=True)
    swarm.task(1)
    swarm.run(15.0)
    plane = swarm.planes[1]
    assert swarm.reports()
    plane.rejects, plane._on_mission_item_int = False, lambda _message, _sender: []
    for shift_m in (5.0, 10.0):
        swarm.task(1, ROUTE + shift_m)
        swarm.run(1.0)
        assert swarm.tasking.state.uploads[1].onboard.route.points_m[0, 0] == shift_m


def test_a_mission_that_is_rejected_and_may_not_be_cleared_is_no_verified_one():
    """It was read back equal; the answers to its clearing were lost, and the vehicle was armed with it."""
    swarm = px4_swarm()
    plane = swarm.planes[1]
    select = plane._on_mission_set_current

    def rejects(message, sender):
        plane.valid = False
        return select(message, sender)

    plane._on_mission_set_current = rejects
    plane._on_mission_clear_all = lambda _message, _sender: []
    swarm.task(1)
    swarm.run(60.0)
    (report,) = swarm.reports()
    assert "navigator rejects" in report.detail
    assert swarm.tasking._agents[1].tasking.onboard is None


def test_a_hold_at_the_number_of_the_old_missions_end_is_an_operators_during_an_upload():
    """The number was that of an item of the new mission: it was commanded back to AUTO at once."""
    swarm = px4_swarm()
    plane = swarm.planes[1]
    swarm.task(1, ROUTE[:2])
    swarm.run(5.0)
    read_back = plane._on_mission_request_list
    plane._on_mission_request_list = lambda message, sender: []
    swarm.task(1, read_only([*ROUTE.tolist(), [1200.0, 0.0], [1500.0, 100.0]]))
    swarm.run(2.0)
    plane.current = 2  # of seven
    swarm.run(1.5)
    assert swarm.tasking.state.stages == {1: Stage.VERIFY}
    plane.choose(HOLD)
    plane.modes_sent.clear()
    swarm.run(2.5)
    plane._on_mission_request_list = read_back
    swarm.run(5.0)
    assert (plane.mode, plane.modes_sent) == (HOLD, [])
    assert swarm.tasking.overrides.modes() == {1: "LOITER"}


def test_a_mission_that_a_px4_rejects_later_on_is_no_operators_hold():
    """Its fence or home changed: it is in Hold by itself, and must not be left alone there for ever."""
    swarm = px4_swarm()
    swarm.task(1)
    swarm.run(5.0)
    px4 = swarm.planes[1]
    assert swarm.reports()[-1].ok
    px4.valid, px4.mode = False, HOLD
    swarm.run(3.0)
    assert swarm.tasking.overrides.modes() == {}
    assert not swarm.reports()[-1].ok
    assert noticed(swarm.effects, NoticeCode.MISSION_REJECTED)


def test_a_px4_that_another_station_holds_and_clears_is_overridden():
    swarm = px4_swarm()
    swarm.task(1)
    swarm.run(5.0)
    px4 = swarm.planes[1]
    px4.mode = HOLD
    swarm.run(2.0)
    px4.store, px4.valid = [], False
    swarm.run(3.0)
    assert 1 in swarm.tasking.overrides.modes()


def test_a_px4_gets_no_false_notice():
    """It refuses a rate for MISSION_CURRENT but sends it; its onboard mission is never inconsistent."""
    swarm = px4_swarm()
    swarm.run(10.0)
    assert not noticed(swarm.fleet.notices(), NoticeCode.MESSAGE_REFUSED)
    swarm.mute = {1}
    swarm.task(1)
    assert swarm.tasking.state.stages
    assert not swarm.tasking.may_be_inconsistent(1)
    swarm.mute = set()
    swarm.tasking.mark_inconsistent(1)  # as after a restart, before it is heard
    swarm.run(5.0)
    assert alarms(swarm.effects) == []
    assert swarm.planes[1].store


@pytest.mark.parametrize("broken", [Stage.UPLOAD, Stage.VERIFY, Stage.SELECT, Stage.MODE])
def test_after_a_program_error_the_vehicle_is_cleared_and_can_be_tasked_again(monkeypatch, broken):
    """An error of our own neither ends the service nor leaves a mission that may be half."""
    swarm = Swarm(1, mode=AUTO)
    plane, enter, errors = swarm.planes[1], Upload._enter, []

    def fail_once(task, stage, t_ns):
        if stage is broken and not errors:
            errors.append(stage)
            raise RuleError(stage, None)
        enter(task, stage, t_ns)

    monkeypatch.setattr(Upload, "_enter", fail_once)
    monkeypatch.setattr(Upload, "end_after_error", END_AFTER_ERROR)
    swarm.task(1)
    swarm.run(20.0)
    assert len(noticed(swarm.effects, NoticeCode.UPLOAD_ERROR)) == 1
    (report,) = swarm.reports()
    assert not report.ok
    assert f"in {broken}" in report.detail
    assert (plane.mode, plane.store) == (LOITER, [])
    swarm.task(1)
    swarm.run(20.0)
    assert swarm.reports()[-1].ok
    assert plane.mode == AUTO


@pytest.mark.parametrize(("shift_m", "begins"), [(5.0, True), (200.0, False)])
def test_a_mission_whose_return_route_leads_to_another_home_is_planned_again(shift_m, begins):
    swarm = Swarm(1)
    home = swarm.fleet.home(1)
    east_m, north_m = FRAME.to_local(home.lat_deg, home.lon_deg)
    points_m = read_only([[east_m + 500.0, north_m], [east_m + shift_m, north_m]])
    route, return_route = Route(1, (0, 0), ROUTE, 1.0), ReturnRoute(points_m, is_straight=True)
    swarm.carry(swarm.tasking.enqueue_upload(route, swarm.t_ns, return_route))
    swarm.run(10.0)
    (report,) = swarm.reports()
    assert report.ok is begins
    assert begins or "home moved" in report.detail
    assert begins or not swarm.planes[1].requests


class Lossy(Swarm):
    """Planes and a PX4 over a link that loses every fourth frame; snapshots may replace the state."""

    def __init__(self, *, restarts):
        self.rng, self.sent = random.Random(1), []
        self.restarts = False
        super().__init__(4, most=3)
        self.planes[5] = Px4(5)
        self.fleet = Fleet(self.planes, FRAME)
        self.tasking = upload_manager(self.fleet, FRAME, self.planes, 3)
        self.run(3.0)
        self.restarts = restarts

    def carry(self, effects):
        self.sent += effects
        super().carry([one for one in effects if not isinstance(one, Send) or self.rng.random() > 0.25])

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            super().run(0.05)
            if self.restarts:
                self.restart()

    def restart(self):
        """Continue with what a snapshot holds of the uploads."""
        agents, tasking = self.tasking._agents, self.tasking.state
        kept = decode_state("test", encode_state(State(agents, tasking=tasking)))
        for vehicle, agent in agents.items():
            agent.tasking = kept.agents[vehicle].tasking
        for before, after in (
            (tasking.queue, kept.tasking.queue),
            (tasking.uploads, kept.tasking.uploads),
            (tasking.first_legs, kept.tasking.first_legs),
            (tasking.windows, kept.tasking.windows),
        ):
            before.clear()
            before.update(after)


def test_uploads_continue_from_a_snapshot_as_if_there_had_been_no_restart():
    flights = [Lossy(restarts=False), Lossy(restarts=True)]
    for swarm in flights:
        for vehicle in swarm.planes:
            swarm.task(vehicle)
        swarm.run(20.0)
        swarm.planes[1].mode = AUTO
        swarm.tasking.mark_inconsistent(2)
        for vehicle in swarm.planes:
            swarm.task(vehicle, ROUTE + 30.0)
        swarm.run(60.0)
    assert flights[0].sent == flights[1].sent
    assert {report.vehicle for report in flights[1].reports() if report.ok} == {1, 2, 3, 4, 5}


def test_a_px4_that_rejects_its_mission_is_noted_until_one_is_verified():
    """`gcs order arm` says it; nobody knew why the vehicle did not arm."""
    swarm = px4_swarm(rejects=True)
    swarm.task(1)
    swarm.run(30.0)
    tasking = swarm.tasking._agents[1].tasking
    assert tasking.rejections.count == 1
    assert tasking.onboard is None
    swarm.planes[1].rejects = False
    swarm.task(1)
    swarm.run(30.0)
    assert (tasking.rejections.count, tasking.onboard is not None) == (0, True)
