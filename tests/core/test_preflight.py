"""A user would take off with a vehicle, or a mission, that should have stayed on the ground."""

import math
from collections import deque
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from helpers.hills import elevation_of, hill, terrain_table
from helpers.planning_desk import replanner
from helpers.staging import track
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse, read_text
from gcs.config.key_overrides import override_keys
from gcs.core.airspace.obstacle_map import mission_map
from gcs.core.preflight.check_codes import CheckCode
from gcs.core.preflight.mission_checks import mission_checks, rehearse, sensor_checks
from gcs.core.preflight.result import Check, CheckRow
from gcs.core.preflight.return_heights import ReturnHeight, return_of, returns_check
from gcs.core.preflight.vehicle_checks import VehicleChecks, envelope_of
from gcs.core.replanning.inputs import PlanningInputs
from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.fleet.fleet import Fleet, FleetSettings
from gcs.mavlink.frames.codec import Encoder, scan
from gcs.mavlink.frames.signing import signed, timestamp_of
from gcs.mavlink.services.preflight_query import PREFLIGHT_MESSAGE_IDS, PreflightQuery
from gcs.model import Datagram, Scan, Send
from sim_vehicles.autopilots.autopilot_traits import Mode
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec
from sim_vehicles.world.scenario import load
from sim_vehicles.world.sensor import make_sensors

S = 1_000_000_000
START_NS = 1_767_225_600 * S
GOOD = {"FS_GCS_ENABL": 1, "FENCE_ENABLE": 1, "FENCE_TYPE": 4, "NAV_DLL_ACT": 2}
KEY = bytes(range(32))
GOOD |= {"BATT_FS_LOW_ACT": 1, "COM_LOW_BAT_ACT": 3}


def mission(*settings):
    return parse(override_keys(read_text("prescribed")[0], settings, "prescribed"), "prescribed")


def inspected(
    config, *, end_s=60.0, until_s=0.0, clock_s=0.0, battery=None, mode=None, signs=False, frame=None, **spec
):
    """Ask vehicle 1 everything, in memory; returns its checks by name."""
    defaults = {
        "system_id": 1, "east_m": 120.0, "north_m": 200.0, "course_rad": 0.0, "alt_rel_m": 100.0,
        "forward_speed_m_s": 15.0, "parameters": GOOD,
    }  # fmt: skip
    plane = SimVehicle(VehicleSpec(**(defaults | spec)), frame or config.local_frame, START_NS)
    if mode is not None:
        plane.autopilot.mode = Mode(mode)
    fleet = Fleet([1], config.local_frame, FleetSettings(extra_ids=PREFLIGHT_MESSAGE_IDS))
    talk = PreflightQuery(1, envelope_of(config, 1), fleet.encoder(1))
    t_ns, to_plane = START_NS, deque()
    while (not talk.is_done or t_ns < START_NS + until_s * S) and t_ns < START_NS + end_s * S:
        for data in [to_plane.popleft() for _ in range(len(to_plane))]:
            plane.receive_datagram(data, t_ns)
        now_ns = t_ns + int(clock_s * S)
        for data in plane.datagrams_to_send(t_ns):
            if signs:
                stamp = timestamp_of(t_ns)
                data = b"".join(signed(frame.data, KEY, 0, stamp) for frame in scan(data).frames)
            for _, message in fleet.receive(Datagram(now_ns, "udp", "plane", data)):
                if battery is not None and message.get_type() == "SYS_STATUS":
                    message.battery_remaining = battery
                to_plane += talk.receive(message, now_ns)
        frames = [send.data for send in fleet.poll(now_ns) if isinstance(send, Send)]
        to_plane += frames + talk.poll(now_ns)
        t_ns += S // 20
    rehearsal = rehearse(config, 1, {})
    ways = [rehearsal.plan.paths_m[1]]
    checks = VehicleChecks(talk, fleet, config, ways, rehearsal.obstacles, now_ns).checks()
    for check in checks:
        assert_is_complete(check)
    return {check.name: check for check in checks}


def assert_is_complete(check):
    """The words have all their parameters: a dash stands for one that is missing."""
    row = check.row
    assert "–" not in row.name + row.value + row.wanted + row.remedy, row
    assert bool(row.remedy) <= (row.level != "ok"), row


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_nothing_stands_against_a_vehicle_that_is_ready(autopilot):
    rows = inspected(mission(), autopilot=autopilot)
    assert {name for name, row in rows.items() if row.level == "refused"} == set()
    assert {name for name, row in rows.items() if row.level == "warning"} == {"armed"}
    assert (
        rows["firmware"].parameters["firmware"].startswith("ArduPlane" if autopilot == "ardupilot" else "PX4")
    )
    assert rows["mission in fence"].code is CheckCode.MISSION_IN_FENCE


@pytest.mark.parametrize(
    ("parameters", "name", "level"),
    [
        ({"FS_LONG_ACTN": 2}, "FS_LONG_ACTN", "refused"),
        ({"SYSID_MYGCS": 252}, "SYSID_MYGCS", "refused"),
        ({"MIS_RESTART": 1}, "MIS_RESTART", "refused"),
        ({"ROLL_LIMIT_DEG": 20}, "ROLL_LIMIT_DEG", "refused"),
        ({"ARMING_CHECK": 0}, "ARMING_CHECK", "refused"),
        ({"FS_GCS_ENABL": 0}, "FS_GCS_ENABL", "warning"),
        ({"AIRSPEED_CRUISE": 25}, "AIRSPEED_CRUISE", "warning"),
        ({"FENCE_TYPE": 1, "FENCE_ALT_MAX": 185}, "mission in fence", "refused"),
        ({"FENCE_TYPE": 2, "FENCE_RADIUS": 300}, "mission in fence", "refused"),
    ],
)
def test_a_parameter_that_would_lose_a_vehicle_is_found(parameters, name, level):
    rows = inspected(mission(), parameters=GOOD | parameters)
    assert rows[name].level == level
    assert rows[name].row.remedy
    refused = {row.name for row in rows.values() if row.level == "refused"}
    assert refused == ({name} if level == "refused" else set())


def test_a_parameter_that_is_no_number_can_be_read_by_programs():
    check = Check(1, CheckCode.PARAMETER_WRONG, {"parameter": "X", "value": math.nan, "why": "it drifts"})
    assert msgspec.json.decode(msgspec.json.encode(check.row), type=CheckRow).parameters["value"] == "nan"


def test_integers_of_px4_are_not_taken_for_floats():
    rows = inspected(mission(), autopilot="px4", parameters=GOOD | {"MIS_TKO_LAND_REQ": 2})
    required = rows["MIS_TKO_LAND_REQ"]
    assert (required.code, required.parameters["value"]) == (CheckCode.PARAMETER_WRONG, 2.0)
    assert rows["NAV_DLL_ACT"].level == "ok"


@pytest.mark.parametrize(
    ("end", "value", "level"),
    [
        ("loiter", 0, "ok"), ("loiter", 1, "refused"), ("loiter", 2, "refused"),
        ("land", 0, "ok"), ("land", 1, "refused"), ("land", 2, "ok"), ("land", 4, "refused"),
    ],
)  # fmt: skip
def test_a_px4_that_would_reject_a_re_task_in_flight_is_refused(end, value, level):
    parameters = GOOD | {"MIS_TKO_LAND_REQ": value}
    rows = inspected(mission(f"mission.end={end}"), autopilot="px4", parameters=parameters)
    assert rows["MIS_TKO_LAND_REQ"].level == level


@pytest.mark.parametrize(
    ("autopilot", "parameters", "rally_m", "level"),
    [
        ("px4", {"RTL_RETURN_ALT": 100}, 90, "refused"),  # returned at 190 m, through a ceiling of 140 m
        ("px4", {"RTL_RETURN_ALT": 100}, 20, "ok"),
        ("px4", {"RTL_RETURN_ALT": 100, "GF_ACTION": 2, "GF_MAX_VER_DIST": 120}, 20, "refused"),
        ("ardupilot", {"RTL_ALTITUDE": 100}, 90, "ok"),
        ("ardupilot", {"RTL_ALTITUDE": 135}, 90, "refused"),
        ("ardupilot", {"RTL_ALTITUDE": -1}, 90, "ok"),
        ("ardupilot", {"RTL_ALTITUDE": 100}, 150, "refused"),
    ],
)
def test_a_return_that_would_climb_through_the_ceiling_is_refused(autopilot, parameters, rally_m, level):
    config = mission(
        "fence.max_alt_rel_m=140",
        "mission.layers=1",
        f"rally=[{{lat_deg=33.202, lon_deg=-87.598, alt_rel_m={rally_m}}}]",
    )
    rows = inspected(config, autopilot=autopilot, parameters=GOOD | parameters)
    assert rows["return height"].level == level


def test_a_failsafe_that_continues_is_explained_outside_auto():
    check = inspected(mission(), parameters=GOOD | {"FS_LONG_ACTN": 0})["FS_LONG_ACTN"]
    assert "LOITER, MANUAL and all other modes go to RTL" in check.parameters["meaning"]


@pytest.mark.parametrize(("mode", "code"), [(11, CheckCode.RTL_ON_GROUND), (10, CheckCode.AUTO_ON_GROUND)])
def test_a_mode_on_the_ground_that_is_not_ours_is_a_warning(mode, code):
    check = inspected(mission(), airborne=False, mode=mode)["mode"]
    assert (check.code, check.level) == (code, "warning")


def test_the_reason_of_a_failed_pre_arm_check_is_printed():
    rows = inspected(mission(), airborne=False, arming_delay_s=40.0, until_s=22.0, end_s=25.0)
    assert rows["sensors"].code is CheckCode.SENSORS_UNHEALTHY_EXPLAINED
    assert rows["sensors"].parameters == {"sensors": "pre-arm check"}
    assert rows["message"].parameters == {"text": "PreArm: Gyros inconsistent"}


def test_a_vehicle_that_signs_without_a_key_here_is_refused():
    assert inspected(mission())["signing"].level == "ok"
    assert inspected(mission(), signs=True)["signing"].code is CheckCode.NO_KEY


def test_a_vehicle_without_fix_home_and_checks_is_refused_until_it_has_them():
    ground = {"airborne": False, "arming_delay_s": 40.0}
    rows = inspected(mission(), **ground, end_s=15.0)
    for name in ("GPS", "position", "home", "sensors"):
        assert rows[name].level == "refused", name
    rows = inspected(mission(), **ground, until_s=45.0, end_s=80.0)
    assert {name for name, row in rows.items() if row.level == "refused"} == set()
    assert (rows["armed"].level, rows["mode"].level) == ("ok", "warning")


def test_clocks_that_differ_and_batteries_that_are_low_are_reported():
    clock = inspected(mission(), clock_s=7.0)["clock"]
    assert clock.code is CheckCode.CLOCK_OFF
    assert clock.parameters["off_s"] == pytest.approx(-7.0, abs=0.05)
    levels = [inspected(mission(), battery=percent)["battery"].level for percent in (80, 40, 10, -1)]
    assert levels == ["ok", "warning", "refused", "warning"]


def test_a_missing_vehicle_is_refused_with_one_row():
    config = mission()
    fleet = Fleet([a.vehicle for a in config.agents], config.local_frame)
    talk = PreflightQuery(1, envelope_of(config, 1), Encoder())
    assert talk.poll(START_NS) == []
    (row,) = VehicleChecks(talk, fleet, config, (), mission_map(config, 1), START_NS).checks()
    assert (row.level, row.code) == ("refused", CheckCode.NOT_HEARD)


def test_a_fence_of_the_mission_file_must_be_on_the_vehicle():
    config = mission(
        "fence.max_alt_rel_m=250", 'fence.areas=[{kind="exclusion", circle=[33.2, -87.57, 50.0]}]'
    )
    rows = inspected(config)
    assert rows["fence"].level == rows["ceiling"].level == "refused"
    assert rows["fence"].code is CheckCode.FENCE_DIFFERS


TOWER = "map.obstacles=[{disc_m=[900.0, 1900.0, 20.0], height_m=70.0}]"


def test_a_home_at_another_height_than_the_mission_files_is_refused_if_heights_count_from_there():
    higher = LocalFrame(33.2, -87.6, 95.0)
    assert inspected(mission(), frame=higher)["home"].level == "ok"
    row = inspected(mission(TOWER), frame=higher)["home"]
    assert (row.code, row.level) == (CheckCode.HOME_HEIGHT_OFF, "refused")
    assert row.parameters["wanted_msl_m"] == 70.0
    assert inspected(mission(TOWER))["home"].code is CheckCode.HOME
    assert inspected(mission("fence.max_alt_msl_m=300"), frame=higher)["home"].level == "refused"


def test_a_return_below_an_obstacle_of_known_height_is_a_warning():
    rows = [
        inspected(mission(TOWER), parameters=GOOD | {"RTL_ALTITUDE": height_m})["return height"]
        for height_m in (89.0, 90.0)
    ]
    assert [row.code for row in rows] == [CheckCode.RETURN_LOW, CheckCode.RETURN_HEIGHT]
    assert rows[0].parameters["min_height_m"] == 90.0


def over_a_hill():
    """Return a mission with a hill of 150 m between the first start and the first target."""
    ground = terrain_table(elevation_of(hill(900.0, 230.0, 150.0, 150.0, 70.0), 2000.0))
    return parse(read_text("prescribed")[0] + ground, "hill.toml")


def test_a_straight_return_into_a_hill_is_refused():
    config = over_a_hill()
    codes = [
        inspected(config, parameters=GOOD | {"ALT_SLOPE_MIN": 1, "RTL_ALTITUDE": height_m})[
            "return height"
        ].code
        for height_m in (100.0, 250.0)
    ]
    assert codes == [CheckCode.RETURN_INTO_GROUND, CheckCode.RETURN_HEIGHT]


def test_an_arduplane_that_flies_small_changes_of_height_at_once_is_refused_over_terrain():
    config = over_a_hill()
    levels = [
        inspected(config, parameters=GOOD | {"ALT_SLOPE_MIN": value})["ALT_SLOPE_MIN"].level
        for value in (0, 1, 15)
    ]
    assert levels == ["refused", "ok", "refused"]
    assert "ALT_SLOPE_MIN" not in inspected(mission())


def test_a_px4_whose_return_ends_in_a_circle_into_a_hill_beside_home_is_refused():
    ground = terrain_table(elevation_of(hill(220.0, 200.0, 60.0, 40.0, 70.0), 2000.0))
    config = parse(read_text("prescribed")[0] + ground, "hill.toml")
    name = "return circle"
    low = GOOD | {"RTL_RETURN_ALT": 150.0, "RTL_DESCEND_ALT": 30.0}
    found = inspected(config, autopilot="px4", parameters=low)[name]
    assert (found.level, found.parameters["parameter"]) == ("refused", "RTL_DESCEND_ALT")
    high = GOOD | {"RTL_RETURN_ALT": 150.0, "RTL_DESCEND_ALT": found.parameters["min_height_m"]}
    assert name not in inspected(config, autopilot="px4", parameters=high)
    assert name not in inspected(config, parameters=GOOD)


def test_an_arduplane_that_circles_at_home_into_a_hill_is_refused():
    """The straight return was checked, and the circle at its end was not."""
    text = read_text("prescribed")[0] + terrain_table(
        elevation_of(hill(160.0, 80.0, 90.0, 40.0, 70.0), 2000.0)
    )
    config = parse(text, "hill.toml")
    low = GOOD | {"RTL_ALTITUDE": 60.0, "WP_LOITER_RAD": 90.0}
    found = inspected(config, parameters=low)["return height"]
    assert (found.code, found.level) == (CheckCode.RETURN_INTO_GROUND, "refused")
    high = low | {"RTL_ALTITUDE": float(found.parameters["min_height_m"])}
    assert inspected(config, parameters=high)["return height"].code is CheckCode.RETURN_HEIGHT


def rally_at(config, *places_m, alt_rel_m=60):
    """Return settings of rally points at places, east and north."""
    points = [config.local_frame.to_geodetic(*place_m) for place_m in places_m]
    rows = ", ".join(f"{{lat_deg={lat}, lon_deg={lon}, alt_rel_m={alt_rel_m}}}" for lat, lon in points)
    return f"rally=[{rows}]"


@pytest.mark.parametrize(("autopilot", "lowest_m"), [("ardupilot", 60.0), ("px4", 90.0)])
def test_a_rally_point_whose_circle_leads_into_a_hill_is_refused(autopilot, lowest_m):
    """The return route was checked, and the circle at its end was not."""
    text = read_text("prescribed")[0]
    text += terrain_table(elevation_of(hill(220.0, 200.0, 90.0, 40.0, 70.0), 2000.0))
    flat = parse(text, "hill.toml")
    rally = rally_at(flat, (300.0, 1300.0), (180.0, 260.0))
    config = parse(override_keys(text, [rally], "hill.toml"), "hill.toml")
    parameters = GOOD | {"RTL_RETURN_ALT": 150.0, "RTL_DESCEND_ALT": 30.0}
    rows = inspected(config, autopilot=autopilot, parameters=parameters)
    assert rows["rally point 1"].code is CheckCode.RALLY_CIRCLE
    found = rows["rally point 2"]
    assert (found.code, found.level) == (CheckCode.RALLY_INTO_GROUND, "refused")
    assert found.parameters["height_m"] == lowest_m
    assert found.parameters["above_m"] == pytest.approx(lowest_m - 90.0, abs=10.0)
    raised = rally_at(flat, (300.0, 1300.0), (180.0, 260.0), alt_rel_m=found.parameters["min_alt_rel_m"])
    config = parse(override_keys(text, [raised], "hill.toml"), "hill.toml")
    assert inspected(config, autopilot=autopilot, parameters=parameters)["rally point 2"].level == "ok"


def test_a_rally_point_whose_circle_crosses_the_fence_is_refused():
    area = "fence.areas=[{kind='exclusion', circle=[33.21, -87.58, 50.0]}]"
    config = mission(area)
    middle_m = np.array(config.local_frame.to_local(33.21, -87.58))
    for east_m, code in ((120.0, CheckCode.RALLY_BEYOND_FENCE), (260.0, CheckCode.RALLY_CIRCLE)):
        row = inspected(mission(area, rally_at(config, middle_m + np.array((east_m, 0.0)))))["rally point 1"]
        assert row.code is code


@pytest.mark.parametrize(
    ("autopilot", "names"),
    [("ardupilot", ("WP_LOITER_RAD", "RTL_RADIUS")), ("px4", ("NAV_LOITER_RAD", "RTL_LOITER_RAD"))],
)
def test_the_circle_at_a_rally_point_has_the_radius_of_the_return(autopilot, names):
    """On ArduPlane RTL_RADIUS was not asked for, and circles wider than 80 m crossed the fence unnoticed."""
    area = "fence.areas=[{kind='exclusion', circle=[33.21, -87.58, 50.0]}]"
    middle_m = np.array(mission().local_frame.to_local(33.21, -87.58))
    config = mission(area, rally_at(mission(), middle_m + np.array((400.0, 0.0))))
    for return_m, code in ((100.0, CheckCode.RALLY_CIRCLE), (-300.0, CheckCode.RALLY_BEYOND_FENCE)):
        radii = dict(zip(names, (60.0, return_m), strict=True))
        row = inspected(config, autopilot=autopilot, parameters=GOOD | radii)["rally point 1"]
        assert (row.code, row.parameters["radius_m"]) == (code, abs(return_m))


@pytest.mark.parametrize(("alt_rel_m", "code"), [(70, "rally-near-obstacle"), (110, "rally-circle")])
def test_a_rally_point_whose_circle_meets_an_obstacle_at_its_height_is_refused(alt_rel_m, code):
    rally = rally_at(mission(), (830.0, 1850.0), alt_rel_m=alt_rel_m)
    row = inspected(mission(TOWER, rally), until_s=1.0)["rally point 1"]
    assert row.code.value == code
    if code == "rally-near-obstacle":
        assert row.parameters["away_m"] == pytest.approx(50.0, abs=25.0)


@pytest.mark.parametrize(
    ("autopilot", "good", "bad", "level"),
    [
        ("ardupilot", {"TECS_CLMB_MAX": 2.5}, {"TECS_CLMB_MAX": 2.0}, "refused"),
        ("ardupilot", {"TECS_SINK_MAX": 2.0}, {"TECS_SINK_MAX": 1.5}, "warning"),
        ("px4", {"FW_T_CLMB_R_SP": 2.5}, {"FW_T_CLMB_R_SP": 2.0}, "refused"),
        ("px4", {"FW_T_SINK_R_SP": 2.0}, {"FW_T_SINK_R_SP": 1.5}, "warning"),
        ("px4", {"FW_T_HRATE_FF": 1.0}, {"FW_T_HRATE_FF": 0.3}, "warning"),
    ],
)
def test_a_vehicle_that_climbs_slower_or_later_than_routes_over_terrain_is_found(autopilot, good, bad, level):
    config = over_a_hill()
    (name,) = good
    levels = [
        inspected(config, autopilot=autopilot, parameters=GOOD | value)[name].level for value in (good, bad)
    ]
    assert levels == ["ok", level]
    assert name not in inspected(mission(), autopilot=autopilot, parameters=GOOD | bad)


def test_a_px4_that_started_a_short_time_ago_on_high_ground_is_refused():
    high = mission("frame.alt_msl_m=1500")
    code = "altitude control"
    on_ground = {"autopilot": "px4", "airborne": False, "until_s": 15.0, "mode": Mode.LOITER}
    early = inspected(high, **on_ground)[code]
    assert (early.code, early.level) == (CheckCode.ALTITUDE_CONTROL_LOW, "refused")
    assert early.parameters["needed_s"] == 500
    assert early.parameters["wait_s"] == pytest.approx(500 - early.parameters["runs_s"], abs=1.0)
    faster = GOOD | {"FW_T_CLMB_R_SP": 150.0}
    assert inspected(high, parameters=faster, **on_ground)[code].level == "ok"
    assert inspected(high, **(on_ground | {"mode": Mode.MANUAL}))[code].level == "ok"
    assert code not in inspected(high, autopilot="px4"), "in the air"
    assert code not in inspected(high, airborne=False, until_s=15.0), "an ArduPlane"


def test_areas_that_vehicles_cannot_hold_are_said():
    area = '{kind="exclusion", circle=[33.21, -87.58, 50.0], height_m=40.0}'
    config = mission(f"fence.areas=[{area}]")
    (row,) = [
        row for row in mission_checks(config, rehearse(config, 1, {})) if row.code is CheckCode.AREAS_NOT_HELD
    ]
    assert_is_complete(row)
    assert (row.level, row.parameters["count"]) == ("warning", 1)
    assert inspected(config)["fence"].code is CheckCode.NO_FENCE_WANTED


def test_starts_beyond_the_fence_and_routes_that_meet_are_found():
    config = mission('fence.areas=[{kind="exclusion", circle=[33.2018, -87.5987, 60.0]}]')
    rows = {row.name: row for row in mission_checks(config, rehearse(config, 1, {}))}
    assert rows["fence"].level == "refused"
    assert "1: " in rows["fence"].parameters["distances"]


def test_vehicles_that_would_come_near_each_other_at_one_altitude_are_reported():
    together = {1: (300.0, 900.0), 2: (300.0, 930.0), 3: (300.0, 960.0), 4: (300.0, 990.0)}

    def separation(*settings):
        config = mission(*settings)
        return {row.name: row for row in mission_checks(config, rehearse(config, 1, together))}["separation"]

    assert separation().level == "ok"
    crowded = separation("mission.layers=1")
    assert crowded.level == "warning"
    assert "1 and 2" in crowded.parameters["pairs"]


@pytest.mark.parametrize("setting", ["mission.layers=5", "mission.layers=3", "mission.layer_step_m=0"])
def test_the_layers_shown_before_the_flight_are_those_that_are_flown(setting):
    config = mission(setting, "planning.shape=pulled")
    rehearsal = rehearse(config, 1, {})
    starts = {agent.vehicle: (agent.east_m, agent.north_m) for agent in config.agents}
    tracks = {vehicle: track((0, vehicle), place) for vehicle, place in starts.items()}
    targets = {(0, n): track((0, n), (one.east_m, one.north_m)) for n, one in enumerate(config.births)}
    plan = replanner(config).check(PlanningInputs(START_NS, START_NS, tracks, targets, frozenset()))
    altitudes = {config.mission.altitude_rel_m + r.layer * config.mission.layer_step_m for r in plan.routes}
    row = {row.name: row for row in mission_checks(config, rehearsal)}["separation"]
    shown = row.parameters["heights"].split(", ")
    assert [float(altitude) for altitude in shown] == sorted(altitudes)


def test_no_route_leads_through_a_closed_map():
    config = mission("map.boxes_m=[[600, 0, 700, 2000]]")
    rows = {row.name: row for row in mission_checks(config, rehearse(config, 1, {}))}
    assert rows["routes"].level == "refused"


def test_central_command_is_not_sent_up_blind_or_with_scans_of_another_time():
    scenario = load("prescribed")
    scan = Scan(10 * S, 10 * S - S // 5, make_sensors(scenario)[0], np.zeros((3, 2)))
    assert sensor_checks([], [], 5.0)[0].level == "refused"
    assert sensor_checks([scan], [], 5.0)[0].level == "ok"
    assert sensor_checks([replace(scan, measured_t_ns=3 * S)], [], 5.0)[0].level == "refused"
    assert sensor_checks([], ["no JSON"], 5.0)[0].parameters == {"problem": "no JSON"}


def test_an_inspection_changes_nothing_on_the_vehicle():
    config = mission()
    asked = []

    class Ear(PreflightQuery):
        pass

    fleet = Fleet([1], config.local_frame, FleetSettings(extra_ids=PREFLIGHT_MESSAGE_IDS))
    plane = SimVehicle(
        VehicleSpec(1, 120.0, 200.0, 0.0, 100.0, 15.0, parameters=GOOD), config.local_frame, START_NS
    )
    talk = Ear(1, envelope_of(config, 1), lambda message: asked.append(message) or b"")
    for data in plane.datagrams_to_send(START_NS):
        for _, message in fleet.receive(Datagram(START_NS, "udp", "plane", data)):
            talk.receive(message, START_NS)
    for second in range(200):
        talk.poll(START_NS + second * S // 4)
    harmless = {"PARAM_REQUEST_READ", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_ACK"}
    for message in asked:
        is_request = (
            message.get_type() == "COMMAND_LONG" and message.command == dialect.MAV_CMD_REQUEST_MESSAGE
        )
        assert is_request or message.get_type() in harmless
    assert {message.get_type() for message in asked} >= {"COMMAND_LONG", "PARAM_REQUEST_READ"}


def test_a_take_off_into_an_obstacle_is_refused_before_it_is_flown():
    """A vehicle on the ground climbs along the runway first, whatever the route says."""
    config = mission("planning.clearance_m=40")
    for course_deg, level in ((90.0, "ok"), (180.0, "refused")):
        fleet = grounded(config, math.radians(course_deg))
        rows = [row for row in mission_checks(config, rehearse(config, 1, {}, fleet)) if row.vehicle == 1]
        assert [(row.name, row.level) for row in rows] == [("take-off", level)]
        assert rows[0].parameters["heading_deg"] == pytest.approx(course_deg, abs=0.5)
        assert rows[0].parameters["altitude_m"] == 100.0
    assert rows[0].parameters["obstruction"] == "outside-map"
    assert_is_complete(rows[0])


def grounded(config, course_rad):
    """A fleet whose vehicle 1 stands, and reports, at its place in the mission file."""
    agent = config.agents[0]
    spec = VehicleSpec(
        system_id=1, east_m=agent.east_m, north_m=agent.north_m, course_rad=course_rad, alt_rel_m=0.0,
        forward_speed_m_s=15.0, airborne=False, gps_noise_std_m=0.0,
    )  # fmt: skip
    plane, fleet = (
        SimVehicle(spec, config.local_frame, START_NS),
        Fleet([a.vehicle for a in config.agents], config.local_frame),
    )
    for step in range(1000):
        t_ns = START_NS + step * S // 20
        for data in plane.datagrams_to_send(t_ns):
            list(fleet.receive(Datagram(t_ns, "udp", "plane", data)))
        for send in fleet.poll(t_ns):
            if isinstance(send, Send):
                plane.receive_datagram(send.data, t_ns)
    return fleet


def returned(profile, heights, rally_m=(), step_m=20.0):
    """Checks of the return heights of vehicles 1, 2, ... that have these values of their parameter."""
    name = "RTL_ALTITUDE" if profile is ARDUPLANE else "RTL_RETURN_ALT"
    found = [return_of(v, profile, {name: value}, rally_m) for v, value in enumerate(heights, 1)]
    return list(returns_check([one for one in found if one is not None], step_m))


def test_vehicles_that_would_return_at_one_height_are_named_with_the_setting():
    (row,) = returned(ARDUPLANE, [100, 100, 140])
    assert (row.code, row.level) == (CheckCode.RETURNS_NEAR, "warning")
    assert row.parameters["heights"] == "1 at 100 m (RTL_ALTITUDE), 2 at 100 m (RTL_ALTITUDE)"
    assert row.parameters["commands"] == "gcs param set CONFIG RTL_ALTITUDE 120 -v 2"
    (row,) = returned(PX4, [100, 110], rally_m=[20.0])
    assert "2 at 130 m (rally point 20 m + RTL_RETURN_ALT 110 m)" in row.parameters["heights"]
    assert row.parameters["commands"] == "gcs param set CONFIG RTL_RETURN_ALT 120 -v 2"


def test_the_setting_that_is_advised_is_a_layer_from_vehicles_that_are_apart_already():
    (row,) = returned(ARDUPLANE, [100, 120, 100])
    assert row.parameters["commands"] == "gcs param set CONFIG RTL_ALTITUDE 140 -v 3"
    (row,) = returned(ARDUPLANE, [100, 120, 100, 100, 160])
    assert row.parameters["commands"] == (
        "gcs param set CONFIG RTL_ALTITUDE 140 -v 3, gcs param set CONFIG RTL_ALTITUDE 180 -v 4"
    )


def test_no_return_height_above_the_ceiling_is_advised():
    heights = [ReturnHeight(v, 100.0, "RTL_ALTITUDE", "RTL_ALTITUDE", 100.0) for v in (1, 2, 3)]
    (row,) = returns_check(heights, 20.0, 155.0)
    assert "RTL_ALTITUDE 140 -v 3" in row.parameters["commands"]
    (row,) = returns_check(heights, 20.0, 150.0)
    assert row.code is CheckCode.RETURNS_NEAR_UNDER_CEILING
    reached = [row.parameters[name] for name in ("lowest_m", "highest_m", "max_height_m")]
    assert reached == [100.0, 140.0, 135.0]


def test_arduplanes_with_a_rally_point_return_at_its_height_whatever_their_parameters_say():
    (row,) = returned(ARDUPLANE, [100, 140], rally_m=[90.0])
    assert (row.code, row.level) == (CheckCode.RETURNS_NEAR_BY_RALLY, "warning")


def test_return_heights_a_layer_apart_are_fine_and_are_not_checked_without_layers():
    assert [row.level for row in returned(ARDUPLANE, [100, 140, 120])] == ["ok"]
    assert returned(ARDUPLANE, [100, 100], step_m=0.0) == []
    assert returned(ARDUPLANE, [100]) == []
