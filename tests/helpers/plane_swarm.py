"""ArduPlanes and the link side of the engine, in memory on one clock."""

from gcs.geo import LocalFrame
from gcs.mavlink.fleet.fleet import Fleet
from gcs.model import Datagram, Route, Send, UploadReport, read_only
from helpers.missions import upload_manager
from helpers.plane_double import LOITER, Plane, S

FRAME = LocalFrame(-35.3632621, 149.165237, 584.09)
ROUTE = read_only([[0.0, 500.0], [500.0, 500.0], [900.0, 0.0]])


class Swarm:
    """Planes, and the link side of the engine, in memory on one clock."""

    def __init__(self, count, most=32, mode=LOITER):
        self.planes = {n: Plane(n, mode=mode) for n in range(1, count + 1)}
        self.fleet = Fleet(self.planes, FRAME)
        self.tasking = upload_manager(self.fleet, FRAME, self.planes, most)
        self.t_ns, self.effects, self.busiest = 0, [], 0
        self.mute = set()
        self.run(2.0)

    def task(self, vehicle, points_m=ROUTE):
        self.carry(self.tasking.enqueue_upload(Route(vehicle, (0, 0), points_m, 1.0), self.t_ns))

    def carry(self, effects):
        for effect in effects:
            if isinstance(effect, Send):
                plane = self.planes[int(effect.peer)]
                self.hear(plane, plane.receive(effect.data, self.t_ns))
            else:
                self.effects.append(effect)

    def hear(self, plane, frames):
        for frame in frames:
            if plane.system_id in self.mute:
                continue
            for vehicle, message in self.fleet.receive(
                Datagram(self.t_ns, "udp", str(plane.system_id), frame)
            ):
                self.carry(self.tasking.receive(vehicle, message, self.t_ns))

    def run(self, seconds):
        for _ in range(round(seconds / 0.05)):
            self.t_ns += S // 20
            for plane in self.planes.values():
                self.hear(plane, plane.poll(self.t_ns))
            self.carry([*self.fleet.poll(self.t_ns), *self.tasking.poll(self.t_ns)])
            stages = list(self.tasking.state.stages.values())
            self.busiest = max(self.busiest, len(stages) - stages.count("waiting"))

    def reports(self):
        return [effect for effect in self.effects if isinstance(effect, UploadReport)]
