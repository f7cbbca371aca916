"""What aiming ahead is worth: missions against targets of rising speed, flown by both ways to aim.

``python tests/bench/bench_intercept.py [--runs 20]`` prints a table: four agents at 15 m/s and four targets
that cross a 4 km x 4 km area, each towards a random place in its middle. A target that was not reached within
400 s, or left the area before, got away.

With ``--terrain`` the area is the Davos tile of `terrain_pairs`, and the targets begin in its valleys.
"""

import argparse

import numpy as np
from terrain_missions import DAVOS, mission_text, read_site
from terrain_pairs import TILE

from gcs.config import read_text
from gcs.config.key_overrides import override_keys
from sim_vehicles.campaign.campaign import Job, fly, warm_up

SPEED_M_S = 15.0
PLACES_M = [(2600.0, 900.0), (2000.0, 1700.0), (2600.0, 2500.0), (2000.0, 3200.0)]


def job(aim: str, share: float, seed: int) -> Job:
    text, source = read_text("random-targets")
    rng = np.random.default_rng([seed, round(100 * share)])
    targets = []
    for east_m, north_m in PLACES_M:
        towards = rng.uniform(1000.0, 3000.0, 2) - (east_m, north_m)
        velocity = share * SPEED_M_S * towards / np.hypot(*towards)
        targets.append(
            f"{{east_m = {east_m}, north_m = {north_m}, v_east_m_s = {velocity[0]:.3f}, "
            f"v_north_m_s = {velocity[1]:.3f}}}"
        )
    births = [
        f"{{east_m = {east}, north_m = {north}, std_m = 20.0, speed_std_m_s = {max(3.0, share * 10.0)}}}"
        for east, north in PLACES_M
    ]
    agents = [f"{{system_id = {i + 1}, east_m = 600.0, north_m = {700.0 + 850.0 * i}}}" for i in range(4)]
    settings = [
        "map.width_m=4000.0", "map.height_m=4000.0", "map.nodes_east=101", "map.nodes_north=101",
        "map.random_threshold=0.01", f"planning.aim={aim}", f"births=[{', '.join(births)}]",
        f"agents=[{', '.join(agents)}]", f"simulation.targets=[{', '.join(targets)}]",
        "simulation.death.survival_probability=1.0", f"mission.max_duration_s={400.0}",
        "simulation.sensor.clutter_per_scan=40.0",
    ]  # fmt: skip
    text = text[: text.index("[simulation.gaussian_targets]")]
    return Job(override_keys(text, settings, source), source, "", seed, "own", 0.0)


def job_over_terrain(aim: str, share: float, seed: int) -> Job:
    """Return a mission over the Davos tile, without a loss."""
    text = mission_text(DAVOS, read_site(DAVOS, TILE), len(PLACES_M), 0.0, seed)
    begin = text.index("[simulation.death]")
    text = text[:begin] + text[text.index("[simulation.sensor]") :]
    rng = np.random.default_rng([seed, round(100 * share)])
    head, *targets = text.split("[[simulation.targets]]\n")
    for target in targets:
        place_m = np.array([float(line.split("= ")[1]) for line in target.splitlines()[:2]])
        towards = rng.uniform(0.3, 0.7, 2) * (DAVOS.width_m, DAVOS.height_m) - place_m
        east, north = share * SPEED_M_S * towards / np.hypot(*towards)
        east_line, north_line, *rest = target.splitlines(keepends=True)
        moving = f"v_east_m_s = {east:.3f}\nv_north_m_s = {north:.3f}\n"
        head += "[[simulation.targets]]\n" + east_line + north_line + moving + "".join(rest)
    births = f"std_m = 20.0\nspeed_std_m_s = {max(3.0, share * 10.0)}\n"
    head = head.replace("[[births]]\n", "[[births]]\n" + births)
    settings = [f"planning.aim={aim}", "mission.max_duration_s=400.0"]
    return Job(override_keys(head, settings, "terrain"), "terrain", "", seed, "own", 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--terrain", action="store_true")
    parser.add_argument("--shares", type=float, nargs="+", default=(0.2, 0.4, 0.6, 0.8, 0.9))
    options = parser.parse_args()
    runs = options.runs
    make_job = job_over_terrain if options.terrain else job
    warm_up()
    print("| target / agent speed | aim | targets reached | all reached | mission s, all reached by both |")
    print("|---|---|---|---|---|")
    for share in options.shares:
        seeds = range(1, runs + 1)
        rows = {aim: [fly(make_job(aim, share, s)) for s in seeds] for aim in ("position", "intercept")}
        both = [i for i in range(runs) if all(r[i].outcome == "complete" for r in rows.values())]
        for aim, some in rows.items():
            reached, total = sum(r.targets_reached for r in some), sum(r.targets_total for r in some)
            whole = sum(r.outcome == "complete" for r in some)
            mean_s = np.mean([some[i].duration_s for i in both]) if both else float("nan")
            cells = (
                f"{share:.1f}",
                aim,
                f"{reached} / {total}",
                f"{whole} / {runs}",
                f"{mean_s:.0f} ({len(both)})",
            )
            print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
