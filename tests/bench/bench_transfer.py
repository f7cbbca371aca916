"""Mission transfers over a bad link: how many end as they should, and what a vehicle is left with.

``python tests/bench/bench_transfer.py [--trials 100] [--loss 0 0.1 0.3 0.5]`` flies a scripted ArduPlane
along an old mission of forty legs while a new one of 30 items is uploaded, on virtual time over two lossy
channels (datagrams lost, delayed by 10-100 ms, 5 % doubled), and prints a row for each loss. "Mixture flown"
is a leg that began with an item taken from a store that was neither mission: during the task, and in ten
minutes after it. ``--short`` uploads 8 items to simulated vehicles of both firmwares that wait, over a link
of 20 ms round trip, on virtual time with the service's tick of 50 ms, until they are read back, selected
and in AUTO.
"""

import argparse

import numpy as np
from helpers.plane_double import AUTO, Channel, Joined, OfPlane, Plane, S, upload_task

from gcs.geo import LocalFrame
from gcs.mavlink.autopilots import ARDUPLANE, PX4
from gcs.mavlink.fleet.fleet_state import ModeRecord
from gcs.mavlink.fleet.mode_authority import ModeAuthority
from gcs.mavlink.frames.codec import Encoder, decode
from gcs.mavlink.mission.item_builder import build_items
from gcs.mavlink.mission.items import Home
from gcs.model import Mission, Waypoint

HOME = Home(-35.3632621, 149.165237, 584.09)
LEG_S = 12.0


def mission(points: int, shift_deg: float = 0.0, vehicle: int = 1) -> Mission:
    route = (Waypoint(-35.36 + n * 1e-3 + shift_deg, 149.16, 100.0, 10.0) for n in range(points))
    return Mission(1, vehicle, tuple(route))


def trial(seed: int, loss: float) -> tuple[str, float, int, int, bool]:
    """Outcome, seconds, mixed legs during and after the task, whether it was held."""
    plane = Plane(mode=AUTO, leg_s=LEG_S)
    old = build_items(ARDUPLANE, mission(40, 0.1), HOME)
    plane.load(old, current=2)
    task = upload_task(
        mission(28), HOME, Encoder(), authority=ModeAuthority(ModeRecord("AUTO", tasked=True)), old=old,
        policy=OfPlane(plane), current=2,
    )  # fmt: skip
    plane.mean(task.items)
    way = {"loss": loss, "doubles": 0.05, "delay_s": (0.01, 0.1)}
    link = Joined(task, plane, Channel(2 * seed, **way), Channel(2 * seed + 1, **way))
    plane._leg_t_ns = -int(np.random.default_rng(seed).uniform(0, LEG_S) * 1e9)
    result = link.run(1000.0)
    during = len(plane.mixed_legs)
    for _ in range(12_000):
        link.step()
    if result is None:
        return "no end", 1000.0, during, 0, False
    if result.ok:
        assert plane.holds(task.items)
    return (
        ("equal" if result.ok else result.onboard),
        result.duration_s,
        during,
        len(plane.mixed_legs) - during,
        result.was_held,
    )


def table(losses: list[float], trials: int) -> None:
    heads = [
        "loss each way",
        "equal",
        "old kept",
        "cleared",
        "other",
        "s, median / 95 % / worst",
        "ordered to hold",
    ]
    heads += ["mixture flown during / after"]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for loss in losses:
        rows = [trial(1000 + seed, loss) for seed in range(trials)]
        ends = [end for end, *_ in rows]
        times_s = np.array([s for _, s, *_ in rows])
        known = [ends.count(end) for end in ("equal", "old", "cleared")]
        quantiles = f"{np.median(times_s):.1f} / {np.quantile(times_s, 0.95):.1f} / {times_s.max():.1f}"
        cells = [f"{loss:.0%}", f"{known[0]} / {trials}", *known[1:], trials - sum(known), quantiles]
        cells += [sum(held for *_, held in rows), f"{sum(r[2] for r in rows)} / {sum(r[3] for r in rows)}"]
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)


# ---------------------------------------------------------------- short missions, short round trips


def short(autopilot: str, seed: int, loss: float, delay_s: float = 0.01) -> tuple[bool, float, int]:
    """Whether 8 items were delivered, after how many seconds, and messages sent again."""
    from sim_vehicles.vehicle.vehicle import SimVehicle, VehicleSpec

    spec = VehicleSpec(7, 0.0, 0.0, 0.0, 100.0, 15.0, autopilot=autopilot)
    vehicle, profile = SimVehicle(spec, LocalFrame(*HOME), 0), {"ardupilot": ARDUPLANE, "px4": PX4}[autopilot]
    points = 8 - profile.home_items - 1  # the circle at the end is one more
    task = upload_task(
        mission(points, vehicle=7),
        HOME,
        Encoder(),
        profile=profile,
        authority=ModeAuthority(ModeRecord("LOITER")),
        round_trip_s=2.0 * delay_s,  # measured on contact
    )
    assert len(task.items) == 8
    way = {"loss": loss, "delay_s": (delay_s, delay_s)}
    up, down, t_ns = Channel(2 * seed, **way), Channel(2 * seed + 1, **way), S
    up.put(task.start(t_ns), t_ns)
    while task.result is None:
        t_ns += S // 200
        for data in up.get(t_ns):
            vehicle.receive_datagram(data, t_ns)
        down.put(vehicle.datagrams_to_send(t_ns), t_ns)
        for data in down.get(t_ns):
            for message in decode(data)[0]:
                up.put(task.receive(message, t_ns), t_ns)
        if t_ns % (S // 20) == 0:
            up.put(task.poll(t_ns), t_ns)
    return task.result.ok, task.result.duration_s, task.result.retries


def shorts(losses: list[float], trials: int) -> None:
    heads = [
        "firmware",
        "loss each way",
        "delivered",
        "s, median / 95 % / worst",
        "within 3 s",
        "repeats, median",
    ]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for autopilot in ("ardupilot", "px4"):
        for loss in losses:
            rows = [short(autopilot, 1000 + seed, loss) for seed in range(trials)]
            times_s = np.array([s for _, s, _ in rows])
            quantiles = f"{np.median(times_s):.2f} / {np.quantile(times_s, 0.95):.2f} / {times_s.max():.2f}"
            delivered = f"{sum(ok for ok, *_ in rows)} / {trials}"
            cells = [autopilot, f"{loss:.0%}", delivered, quantiles, f"{np.mean(times_s <= 3.0):.0%}"]
            print("| " + " | ".join([*cells, f"{np.median([r for *_, r in rows]):.0f}"]) + " |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--loss", type=float, nargs="*", default=[0.0, 0.1, 0.2, 0.3, 0.5])
    parser.add_argument("--short", action="store_true")
    arguments = parser.parse_args()
    (shorts if arguments.short else table)(arguments.loss, arguments.trials)


if __name__ == "__main__":
    main()
