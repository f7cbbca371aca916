"""Routes: a command reaches the one vehicle that it is for, telemetry everybody, and nothing goes round."""

from __future__ import annotations

from unittest.mock import patch

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.endpoints import Link, parse_endpoint
from gcs.mavlink.frames.codec import GCS_COMPONENT_ID, GCS_SYSTEM_ID, Encoder, Frame, scan, target_of
from gcs.mavlink.router.router import Router

S = 1_000_000_000
RADIO, WIFI, READ_ONLY, WORK, WIRE = (
    "udpin:0.0.0.0:1",
    "udpin:0.0.0.0:2",
    "udpin:0.0.0.0:3",
    "udpin:0.0.0.0:4",
    "udpout:10.0.0.9:5",
)
LINKS = [
    Link(parse_endpoint(RADIO)),
    Link(parse_endpoint(WIFI)),
    Link(parse_endpoint(READ_ONLY), role="read-only"),
    Link(parse_endpoint(WORK), role="full"),
    Link(parse_endpoint(WIRE), role="full"),
]
WIRED = (WIRE, "10.0.0.9:5")
OWN = (GCS_SYSTEM_ID, GCS_COMPONENT_ID)


def frame(message, system: int, component: int = 1, sequence: int = 0) -> Frame:
    encode = Encoder(system, component)
    for _ in range(sequence):
        encode(message)
    (found,) = scan(encode(message)).frames
    return found


def beat(system: int, component: int = 1, *, ground: bool = False) -> Frame:
    kind = (6, 8) if ground else (1, 3)
    return frame(dialect.MAVLink_heartbeat_message(*kind, 0, 0, 4, 3), system, component)


def attitude(system: int, component: int = 1) -> Frame:
    return frame(dialect.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0), system, component)


def arm(target: int, component: int = 1, sender: int = 255, sender_component: int = 190, sequence=0) -> Frame:
    message = dialect.MAVLink_command_long_message(target, component, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    return frame(message, sender, sender_component, sequence)


def count(target: int, sender: int = 255) -> Frame:
    return frame(dialect.MAVLink_mission_count_message(target, 1, 5, 0), sender, 190)


class Desk:
    """Two vehicles on two links, a read-only ground station, one with full access, and one on a wire."""

    vehicle, other = (RADIO, "10.0.0.1:50"), (WIFI, "10.0.0.2:50")
    onlooker, worker = (READ_ONLY, "10.0.0.3:50"), (WORK, "10.0.0.4:50")

    def __init__(self) -> None:
        self.busy: set[int] = set()
        self.router = Router(LINKS, [1, 2], self.busy.__contains__)
        self.beats(-S)
        self.beats(0)

    def beats(self, t_ns: int) -> None:
        self.router.route_frame(t_ns, self.vehicle, beat(1))
        self.router.route_frame(t_ns, self.other, beat(2))
        self.router.route_frame(t_ns, self.onlooker, beat(254, 190, ground=True))
        self.router.route_frame(t_ns, self.worker, beat(255, 190, ground=True))


def test_telemetry_goes_to_every_station_and_to_no_vehicle():
    desk = Desk()
    to = desk.router.route_frame(S, desk.vehicle, attitude(1)).to
    assert set(to) == {desk.onlooker, desk.worker, WIRED}


def test_a_command_goes_to_its_vehicle_alone_and_the_answer_to_its_sender():
    desk = Desk()
    assert desk.router.route_frame(S, desk.worker, arm(2)).to == (desk.other,)
    ack = frame(dialect.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190), 2)
    assert desk.router.route_frame(S, desk.other, ack).to == (desk.worker,)


def test_answers_to_central_command_go_to_no_other_station():
    desk = Desk()
    ack = frame(dialect.MAVLink_mission_ack_message(*OWN, 0, 0), 1)
    assert desk.router.route_frame(S, desk.vehicle, ack).to == ()


def test_a_component_that_is_not_known_is_reached_through_its_vehicle():
    desk = Desk()
    assert desk.router.route_frame(S, desk.worker, arm(1, component=154)).to == (desk.vehicle,)
    gimbal = (WIFI, "10.0.0.7:50")
    desk.router.route_frame(S, gimbal, beat(1, 154))
    assert desk.router.route_frame(S, desk.worker, arm(1, component=154, sequence=1)).to == (gimbal,)


def test_a_read_only_station_may_request_and_not_command():
    desk = Desk()

    def ask(message):
        return desk.router.route_frame(S, desk.onlooker, frame(message, 254, 190))

    assert ask(dialect.MAVLink_param_request_list_message(1, 1)).to == (desk.vehicle,)
    assert ask(dialect.MAVLink_mission_request_list_message(1, 1, 0)).to == (desk.vehicle,)
    assert ask(dialect.MAVLink_command_long_message(1, 1, 512, 0, 148, 0, 0, 0, 0, 0, 0)).to == (
        desk.vehicle,
    )
    for message in (
        dialect.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_long_message(1, 1, 511, 0, 33, 1e5, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, 0, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_set_mode_message(1, 1, 10),
        dialect.MAVLink_param_set_message(1, 1, b"X", 1.0, 9),
        dialect.MAVLink_mission_count_message(1, 1, 3, 0),
        dialect.MAVLink_mission_clear_all_message(1, 1, 0),
        dialect.MAVLink_mission_set_current_message(1, 1, 3),
        dialect.MAVLink_manual_control_message(1, 0, 0, 0, 0, 0),
        dialect.MAVLink_rc_channels_override_message(1, 1, *[1500] * 8),
        dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251),
        dialect.MAVLink_gps_rtcm_data_message(0, 4, [0] * 180),
        dialect.MAVLink_setup_signing_message(1, 1, [1] * 32, 5),
    ):
        routed = ask(message)
        assert (routed.to, routed.refusal) == ((), "read-only"), message
    assert desk.router.counters[READ_ONLY].refused["read-only"] == 13


def test_no_station_writes_a_mission_during_our_upload_to_that_vehicle():
    desk = Desk()
    desk.busy.add(1)
    assert desk.router.route_frame(S, desk.worker, count(1)).refusal == "mission transfer under way"
    assert desk.router.route_frame(S, desk.worker, arm(1)).to == (desk.vehicle,)
    assert desk.router.route_frame(S, desk.worker, count(2)).to == (desk.other,)
    desk.busy.clear()
    assert desk.router.route_frame(S, desk.worker, count(1)).to == (desk.vehicle,)


def test_a_mission_for_all_vehicles_reaches_none():
    desk = Desk()
    routed = desk.router.route_frame(S, desk.worker, count(0))
    assert (routed.to, routed.refusal) == ((), "mission message for all vehicles")


def test_the_heartbeat_of_another_station_stays_here():
    desk = Desk()
    assert desk.router.route_frame(S, desk.worker, beat(255, 190, ground=True)).to == ()


def test_loops_and_impostors_among_stations_are_kept_out():
    desk = Desk()
    assert desk.router.route_frame(S, desk.worker, attitude(1)).to == ()
    assert desk.router.route_frame(S, desk.worker, arm(2, sender=1, sender_component=1)).to == ()
    assert desk.router.route_frame(S, desk.worker, arm(2, sender=OWN[0], sender_component=OWN[1])).to == ()


def test_the_same_command_by_two_ways_is_done_once_and_a_repeat_again():
    desk = Desk()
    again = (WORK, "10.0.0.5:50")
    assert desk.router.route_frame(S, desk.worker, arm(1)).to == (desk.vehicle,)
    assert desk.router.route_frame(S, again, arm(1)).refusal == "duplicate"
    assert desk.router.route_frame(S, desk.worker, arm(1)).to == (desk.vehicle,)
    assert desk.router.route_frame(9 * S, again, arm(1, sequence=1)).refusal != "duplicate"


def test_a_payload_with_the_component_id_of_the_autopilot_is_not_the_vehicle():
    router = Router(LINKS, [1])
    payload = (RADIO, "10.6.6.6:50")
    assert router.route_frame(0, payload, beat(1, ground=True)).refusal == "no heartbeat"
    assert router.vehicles_heard(S) == ()


def test_a_vehicle_keeps_its_address_while_it_is_heard_and_moves_after_a_timeout():
    desk = Desk()
    impostor = (RADIO, "10.6.6.6:50")
    assert desk.router.route_frame(S, impostor, beat(1)).refusal == "heard elsewhere"
    assert desk.router.route_frame(S, impostor, attitude(1)).to == ()
    assert desk.router.route_frame(8 * S, impostor, attitude(1)).refusal == "no heartbeat"
    assert desk.router.route_frame(8 * S, impostor, beat(1)).to
    assert desk.router.route_frame(8 * S, desk.worker, arm(1)).to == (impostor,)


def test_what_is_for_a_silent_vehicle_goes_nowhere():
    desk = Desk()
    routed = desk.router.route_frame(6 * S, desk.worker, arm(1))
    assert (routed.to, routed.refusal) == ((), "for a vehicle that is not heard")


def test_silent_stations_are_forgotten_and_wired_ones_are_not():
    desk = Desk()
    assert set(desk.router.clients(9 * S)) == {desk.onlooker, desk.worker, WIRED}
    assert set(desk.router.clients(11 * S)) == {WIRED}
    connected = (WORK, "10.0.0.8:50")
    desk.router.add_connection(12 * S, connected)
    assert set(desk.router.clients(100 * S)) == {WIRED, connected}
    desk.router.remove_connection(connected)
    desk.router.remove_connection(WIRED)
    assert set(desk.router.clients(100 * S)) == {WIRED}


def test_targets_are_found_as_the_dialect_unpacks_them():
    for message_id, definition in dialect.mavlink_map.items():
        if "target_system" not in definition.fieldnames:
            continue
        lengths = dict(zip(definition.ordered_fieldnames, definition.array_lengths, strict=True))
        ids = {"target_system": 77, "target_component": 88}
        values = []
        for name, kind in zip(definition.fieldnames, definition.fieldtypes, strict=True):
            value = b"ab" if kind == "char" else ids.get(name, 1)
            values.append([value] * lengths[name] if lengths[name] and kind != "char" else value)
        found = frame(definition(*values), 1)
        assert found.message_id == message_id
        expected = (77, 88 if "target_component" in definition.fieldnames else 0)
        assert target_of(found) == expected, definition.msgname


# ---------------------------------------------------------------- whatever comes

ADDRESSES = [
    *((link, f"10.0.{i}.{j}:9") for i, link in enumerate((RADIO, WIFI, READ_ONLY, WORK)) for j in range(4)),
    WIRED,
    ("udpin:9.9.9.9:9", "x"),
]
MESSAGES = st.sampled_from([beat, attitude]) | st.integers(0, 4).map(
    lambda target: lambda system, component: arm(target, 1, system, component)
)
STEPS = st.lists(
    st.tuples(
        st.integers(0, 4 * S),
        st.sampled_from(ADDRESSES),
        st.sampled_from([1, 2, 3, 200, 254, 255]),
        st.sampled_from([1, 154, 190, GCS_COMPONENT_ID]),
        MESSAGES,
    ),
    max_size=60,
)


@patch("gcs.mavlink.router.router._MAX_CLIENTS", 3)
@patch("gcs.mavlink.router.router._MAX_IDS", 2)
@settings(max_examples=150)
@given(STEPS)
def test_routes_hold_whatever_comes(steps):
    """Never an echo, never twice, a target's frame at its known place alone, stations never to stations."""
    router, t_ns = Router(LINKS, [1, 2]), 0
    roles = {link.name: link.role for link in LINKS}
    heard: dict[tuple[int, int], tuple[tuple[str, str], int]] = {}
    for later_ns, address, system, component, make in steps:
        t_ns += later_ns
        sent = make(system, component)
        to = router.route_frame(t_ns, address, sent).to
        from_vehicles = roles.get(address[0]) == "vehicles"
        if from_vehicles and system in (1, 2):
            place = heard.get((system, component))
            free = place is None or t_ns - place[1] > 5 * S
            if (place is not None and place[0] == address) or (free and sent.message_id == 0):
                heard[system, component] = (address, t_ns)
        assert address not in to
        assert len(set(to)) == len(to)
        sides = {roles[link] == "vehicles" for link, _ in to}
        target = target_of(sent)
        if to and target is not None and target[0]:
            places = {
                place for id_, (place, at) in heard.items() if id_[0] == target[0] and t_ns - at <= 5 * S
            }
            is_answer = from_vehicles and target[0] not in (1, 2)
            assert sides == {False} if is_answer else set(to) <= places
        elif to and from_vehicles:
            assert sides == {False}
        if to and not from_vehicles:
            assert sides == {True}
            assert roles[address[0]] == "full"
        stations = router.clients(t_ns)
        for link in (READ_ONLY, WORK):
            assert sum(station[0] == link for station in stations) <= 3
        assert all(len(ids) <= 2 for ids in stations.values())
