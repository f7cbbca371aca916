"""Links of flights with real firmware: a relay that loses datagrams of one vehicle, and a second station."""

import contextlib
import random
import selectors
import socket
import threading
from collections.abc import Collection

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.frames.codec import scan
from sim_vehicles.autopilots.firmware_faults import injection_messages
from sim_vehicles.vehicle.faults import FaultKind

PX4_PORT = 18570
MODES = {
    "arduplane": {"rtl": (11, 0), "auto": (10, 0), "loiter": (12, 0), "manual": (0, 0), "fbwa": (5, 0)},
    "px4": {"rtl": (4, 5), "auto": (4, 4), "loiter": (4, 3), "manual": (1, 0), "fbwa": (7, 0)},
}
"""Mode and submode of DO_SET_MODE."""


class Relay(threading.Thread):
    """Passes datagrams between the vehicles and central command, and loses those of one vehicle."""

    def __init__(self, port: int, service: int) -> None:
        super().__init__(daemon=True)
        self.lost = dict[int, float]()
        """Probability of a loss by vehicle, both ways."""
        self._rng = random.Random(1)
        self._service = ("127.0.0.1", service)
        self._vehicles = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicles.bind(("127.0.0.1", port))
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._vehicles, selectors.EVENT_READ)
        self._towards = dict[tuple, socket.socket]()
        self._vehicle = dict[tuple, int]()

    def inject(self, vehicle: int, message: mavlink.MAVLink_message) -> None:
        """Pass on a message of an ADS-B receiver of a vehicle."""
        encoder = mavlink.MAVLink(None, srcSystem=vehicle, srcComponent=mavlink.MAV_COMP_ID_ADSB)
        address = next(address for address, one in self._vehicle.items() if one == vehicle)
        self._towards[address].send(message.pack(encoder))

    def run(self) -> None:
        while True:
            for key, _ in self._selector.select():
                with contextlib.suppress(ConnectionError, BlockingIOError):  # central command is not there
                    self._pass_on(key.fileobj, key.data)

    def _pass_on(self, receiver: socket.socket, address: tuple | None) -> None:
        data, sender = receiver.recvfrom(4096)
        address = address or sender
        if address not in self._towards:
            self._towards[address] = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._towards[address].connect(self._service)
            self._towards[address].setblocking(False)  # an error may be gone when it is read
            self._selector.register(self._towards[address], selectors.EVENT_READ, address)
        for frame in scan(data).frames if receiver is self._vehicles else ():
            self._vehicle.setdefault(address, frame.system_id)
        if self._rng.random() < self.lost.get(self._vehicle.get(address, 0), 0.0):
            return
        if receiver is self._vehicles:
            self._towards[address].send(data)
        else:
            self._vehicles.sendto(data, address)


class Station:
    """A second ground station: links of its own to the vehicles."""

    def __init__(self, firmware: str, vehicles: Collection[int], first_port: int) -> None:
        self.firmware = firmware
        self.encoder = mavlink.MAVLink(None, srcSystem=250, srcComponent=190)
        self.sockets = {vehicle: socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for vehicle in vehicles}
        self.addresses = {v: ("127.0.0.1", PX4_PORT + n) for n, v in enumerate(vehicles)}
        for number, (vehicle, one) in enumerate(self.sockets.items()):
            one.setblocking(False)
            if firmware == "arduplane":
                one.bind(("127.0.0.1", first_port + number))
                self.addresses.pop(vehicle)

    def send(self, vehicle: int, message: mavlink.MAVLink_message) -> None:
        """Send a message, twice: a datagram may be lost."""
        while True:
            try:
                _, self.addresses[vehicle] = self.sockets[vehicle].recvfrom(2048)
            except BlockingIOError:
                break
        for _ in range(2):
            self.sockets[vehicle].sendto(message.pack(self.encoder), self.addresses[vehicle])

    def command_mode(self, vehicle: int, mode: str) -> None:
        words = (1.0, *map(float, MODES[self.firmware][mode]), 0.0, 0.0, 0.0, 0.0)
        command = mavlink.MAVLink_command_long_message(vehicle, 1, mavlink.MAV_CMD_DO_SET_MODE, 0, *words)
        self.send(vehicle, command)

    def inject(self, vehicle: int, kind: FaultKind, *, begins: bool) -> None:
        for message in injection_messages(vehicle, self.firmware == "px4", kind, begins):
            self.send(vehicle, message)
