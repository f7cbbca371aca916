"""A user would trust a failsafe that is not set."""

import struct
from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.geo import LocalFrame
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.services.parameter_protocol import (
    ParameterReader,
    ParameterSetter,
    decode_value,
    encode_value,
    is_bytewise,
    value_problem,
)
from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

S = 1_000_000_000
FRAME = LocalFrame(33.2, -87.6, 70.0)


def said(value, kind):
    """A PARAM_VALUE as it comes over the wire."""
    message = dialect.MAVLink_param_value_message(b"NAME", value, kind, 1, 0)
    return decode(Encoder(7, 1)(message))[0][0]


@given(st.integers(-(2**31), 2**31 - 1))
def test_every_integer_survives_its_bytes(value):
    frame = bytearray(Encoder(7, 1)(dialect.MAVLink_param_value_message(b"NAME", 1.0, 6, 1, 0)))
    frame[10:14] = struct.pack("<i", value)
    message = dialect.MAVLink_param_value_message(b"NAME", 0.0, 6, 1, 0)
    message._msgbuf = frame
    assert decode_value(message, bytewise=True) == value


@pytest.mark.parametrize("kind", [1, 2, 3, 4, 5, 6, 9])
def test_both_ways_to_carry_a_number_are_read_as_they_are_meant(kind):
    assert decode_value(said(encode_value(42, kind, True), kind), True) == 42
    assert decode_value(said(42.0, kind), False) == 42
    assert (decode_value(said(42.0, kind), True) == 42) is (kind == 9)


def test_capabilities_come_before_the_firmwares_usual_encoding():
    bytewise = dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    assert is_bytewise(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, bytewise)
    assert not is_bytewise(dialect.MAV_AUTOPILOT_PX4, dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST)
    assert is_bytewise(dialect.MAV_AUTOPILOT_PX4, None)
    assert not is_bytewise(dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0)


def talk(task, plane, ended, *, loss=0.0, seed=0):
    rng, t_ns, to_plane = np.random.default_rng(seed), S, deque()
    while not ended() and t_ns < 120 * S:
        for data in [to_plane.popleft() for _ in range(len(to_plane))]:
            plane.receive_datagram(data, t_ns)
        for data in plane.datagrams_to_send(t_ns):
            for message in decode(data)[0]:
                if rng.random() >= loss:
                    task.receive(message)
        to_plane += [frame for frame in task.poll(t_ns) if rng.random() >= loss]
        t_ns += S // 20
    assert ended(), "it never ended"
    return t_ns / S


def vehicle(autopilot="ardupilot", **parameters):
    spec = VehicleSpec(7, 0.0, 0.0, 0.0, 100.0, 15.0, autopilot=autopilot, parameters=parameters)
    return SimVehicle(spec, FRAME, 0)


@pytest.mark.parametrize(
    ("autopilot", "name", "value"), [("ardupilot", "FS_LONG_ACTN", 2), ("px4", "NAV_DLL_ACT", -1)]
)
def test_parameters_are_read_over_a_lossy_link_in_either_encoding(autopilot, name, value):
    plane = vehicle(autopilot, **{name: value})
    names = [(name,), ("NOT_THERE",), ("RTL_RETURN_ALT", "RTL_ALTITUDE"), ("FENCE_ENABLE",)]
    reading = ParameterReader(7, names, autopilot == "px4", Encoder())
    talk(reading, plane, lambda: reading.is_done, loss=0.3, seed=4)
    assert reading.values[name] == value
    assert "NOT_THERE" not in reading.values
    assert len({"RTL_RETURN_ALT", "RTL_ALTITUDE"} & reading.values.keys()) == 1


def test_an_older_name_without_an_answer_costs_no_time():
    plane = vehicle()
    reading = ParameterReader(7, [("MAV_GCS_SYSID", "SYSID_MYGCS")], False, Encoder())
    assert talk(reading, plane, lambda: reading.is_done) < 2.0


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_a_parameter_counts_as_set_when_it_comes_back_so(autopilot):
    plane = vehicle(autopilot)
    name = "GF_ACTION" if autopilot == "px4" else "FENCE_ENABLE"
    setting = ParameterSetter(7, name, 1.0, autopilot == "px4", Encoder())
    talk(setting, plane, lambda: setting.outcome is not None, loss=0.2, seed=1)
    assert setting.outcome == (True, f"{name} = 1")
    assert plane.autopilot.parameters[name] == 1
    stubborn = ParameterSetter(7, "FORMAT_VERSION", 3.0, autopilot == "px4", Encoder())
    talk(stubborn, plane, lambda: stubborn.outcome is not None)
    assert stubborn.outcome == (False, "FORMAT_VERSION stays 13: it could not be set to 3")


def test_a_value_that_does_not_fit_its_type_is_never_sent():
    plane = vehicle()
    setting = ParameterSetter(7, "FS_LONG_ACTN", 1.5, False, Encoder())
    talk(setting, plane, lambda: setting.outcome is not None)
    assert setting.outcome == (
        False,
        "FS_LONG_ACTN stays 0: 1.5 does not fit: it is a whole number of -128 ... 127",
    )
    assert value_problem(300, dialect.MAV_PARAM_TYPE_INT8)
    assert not value_problem(255, dialect.MAV_PARAM_TYPE_UINT8)
    assert not value_problem(1.5, dialect.MAV_PARAM_TYPE_REAL32)
