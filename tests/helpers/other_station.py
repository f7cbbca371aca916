"""An engine with a vehicle, and another ground station at a forward endpoint."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from gcs.config import parse
from gcs.core.engine import Engine
from gcs.mavlink.frames.codec import Encoder
from gcs.model import Datagram, Order, Tick

S = 1_000_000_000
AIR, SEAT, PEER = "udpin:0.0.0.0:14550", "udpin:0.0.0.0:14551", "10.0.0.5:50"
MISSION = f"""
name = "x"
[frame]
lat_deg = 33.0
lon_deg = -87.0
alt_msl_m = 70.0
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
[[agents]]
system_id = 1
network = 2
east_m = 100.0
north_m = 300.0
[links]
mavlink = ["{AIR}", {{ endpoint = "udpin:0.0.0.0:14560", network = 2 }}]
[[links.forward]]
endpoint = "{SEAT}"
access = "full"
"""


class Stage:
    """An engine, a vehicle that is heard, and another ground station."""

    def __init__(self) -> None:
        self.engine, self.t_ns = Engine(parse(MISSION, "x"), 1), S
        self.effects: list = []
        self.say(AIR, dialect.MAVLink_heartbeat_message(1, 3, 217, 10, 4, 3), 1, 1)

    def say(self, link: str, message, system: int = 254, component: int = 190, peer: str = PEER) -> list:
        data = Encoder(system, component)(message)
        return self.step(Datagram(self.t_ns, link, peer, data))

    def step(self, event) -> list:
        found = self.engine.step(event)
        self.effects += found
        return found

    def wait(self, seconds: float) -> list:
        self.t_ns += int(seconds * S)
        return self.step(Tick(self.t_ns))

    def order(self, action: str) -> list:
        return self.step(Order(self.t_ns, f"{action}-{self.t_ns}", action, None))
