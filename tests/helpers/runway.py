"""Virtual flights of one vehicle, or two side by side, that take off."""

from dataclasses import replace

from gcs.mavlink.frames.codec import decode
from gcs.model import Order, OrderAnswer, Send
from helpers.areas import AUSTRALIA
from helpers.noticed import alarms, noticed
from helpers.staging import S
from sim_vehicles.campaign.virtual_run import START_T_NS, VirtualRun
from sim_vehicles.vehicle.vehicle import SimVehicle
from sim_vehicles.world.scenario import parse_scenario
from sim_vehicles.world.vehicle_specs import vehicle_specs

# The field of a flight with ArduPlane: it flew 45 m deep through the box ahead of the runway.
FIELD = (
    'name = "runway"\n'
    + AUSTRALIA
    + """\
boxes_m = [[1410.0, 1240.0, 1510.0, 1340.0]]
[[agents]]
system_id = 1
east_m = 1500.0
north_m = 1000.0
course_deg = 353.0
[[births]]
east_m = 2600.0
north_m = 2500.0
[airframe]
speed_m_s = 22.0
bank_deg = 35.0
[planning]
clearance_m = 60.0
shape = "flyable"
[mission]
altitude_rel_m = 90.0
layers = 1
accept_radius_m = 30.0
loiter_radius_m = 80.0
[simulation]
forward_speed_m_s = 22.0
parameters = { ARMING_DELAY_S = 1.0 }
[[simulation.targets]]
east_m = 2600.0
north_m = 2500.0
"""
)

BOX = "boxes_m = [[1410.0, 1240.0, 1510.0, 1340.0]]"

ORDERS = ((3.0, "hold"), (6.0, "resume"), (15.0, "arm"))


class Flight:
    """A virtual flight of one vehicle from the ground."""

    def __init__(self, tables="", orders=ORDERS, *, px4=False, place_m=None, boxes=BOX, field=FIELD):
        scenario = parse_scenario(field.replace(BOX, boxes) + tables, "runway.toml")
        self.effects, self.way = [], []
        orders = [
            Order(START_T_NS + round(at * S), f"{what}-{at}", what, None, None, *area)
            for at, what, *area in orders
        ]
        self.run_ = VirtualRun(
            scenario, 1, None, lambda _, effect: self.effects.append(effect), orders=orders
        )
        (spec,) = vehicle_specs(scenario, 1)
        spec = replace(spec, airborne=False, autopilot="px4" if px4 else "ardupilot")
        if place_m is not None:
            spec = replace(spec, east_m=place_m[0], north_m=place_m[1])
        self.plane = SimVehicle(spec, scenario.frame, START_T_NS)
        self.run_.vehicles = {"vehicle:1": self.plane}

    def run(self, until_s):
        while self.run_.t_ns < START_T_NS + until_s * S:
            self.run_.run((self.run_.t_ns - START_T_NS) / S + 0.2)
            self.way.append((self.plane.east_m, self.plane.north_m, self.plane.alt_rel_m))
        return self

    def all(self, kind):
        return [effect for effect in self.effects if isinstance(effect, kind)]

    def items(self):
        """Mission items that were sent, by upload."""
        sent = [m for effect in self.all(Send) for m in decode(effect.data)[0]]
        return [m for m in sent if m.get_type() == "MISSION_ITEM_INT"]

    def alarms(self):
        return alarms(self.effects)


SECOND = """
[[agents]]
system_id = 2
east_m = 1530.0
north_m = 1000.0
course_deg = 353.0
[[births]]
east_m = 600.0
north_m = 2500.0
[[simulation.targets]]
east_m = 600.0
north_m = 2500.0
"""

READY = ((3.0, "hold"), (6.0, "resume"))


class Field:
    """A virtual flight of two vehicles that stand 30 m apart."""

    def __init__(self, *orders, ready=READY):
        scenario = parse_scenario(
            FIELD.replace(BOX, "").replace("layers = 1", "layers = 2") + SECOND, "pair.toml"
        )
        self.effects, self.low_together = [], 0
        given = [
            Order(START_T_NS + round(t_s * S), f"{what}-{t_s}", what, tuple(who) or None)
            for t_s, what, *who in (*ready, *orders)
        ]
        self.run_ = VirtualRun(scenario, 1, None, lambda _, effect: self.effects.append(effect), orders=given)
        self.planes = [
            SimVehicle(replace(spec, airborne=False), scenario.frame, START_T_NS)
            for spec in vehicle_specs(scenario, 1)
        ]
        self.run_.vehicles = {f"vehicle:{number}": plane for number, plane in enumerate(self.planes, 1)}

    def run(self, until_s):
        while self.run_.t_ns < START_T_NS + until_s * S:
            self.run_.run((self.run_.t_ns - START_T_NS) / S + 0.2)
            self.low_together += all(1.0 < plane.alt_rel_m < 75.0 for plane in self.planes)
        return self

    def heights_m(self):
        return [plane.alt_rel_m for plane in self.planes]

    def noticed(self, code):
        return noticed(self.effects, code)

    def answers(self, order_id):
        found = [e for e in self.effects if isinstance(e, OrderAnswer) and e.order_id == order_id]
        return {answer.vehicle: (answer.state, answer.detail) for answer in found if answer.vehicle}
