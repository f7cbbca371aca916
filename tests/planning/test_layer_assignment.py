"""Vehicles stay apart: by altitude layer, or in time where they share one; else a conflict is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning import layer_assignment
from gcs.planning.layer_assignment import PlannedFlight, assign_layers, min_separation_m


def flight(vehicle, *points, speed=15.0, layer=0, fixed=False):
    return PlannedFlight(vehicle, np.array(points, dtype=float), speed, layer, fixed)


def test_conflicting_routes_get_different_layers():
    head_on = [flight(1, (0, 0), (1000, 0)), flight(2, (1000, 0), (0, 0))]
    layers, conflicts = assign_layers(head_on, 3, 50.0)
    assert layers == {1: 0, 2: 1}
    assert conflicts == ()


def over_terrain(vehicle, *places, layer):
    """Return a flight through places of east, north and height."""
    at = np.array(places, dtype=float)
    return PlannedFlight(vehicle, at[:, :2], 15.0, layer, True, heights_msl_m=at[:, 2])


def test_routes_over_terrain_whose_heights_come_together_are_reported_though_their_layers_differ():
    lower = over_terrain(1, (0, 0, 1600), (1000, 0, 1620), layer=0)
    upper = over_terrain(2, (1000, 0, 1640), (0, 0, 1600), layer=1)
    _, (conflict,) = assign_layers([lower, upper], 3, 60.0, 15.0)
    assert conflict.vehicles == (1, 2)
    _, conflicts = assign_layers(
        [lower, over_terrain(2, (1000, 0, 1640), (0, 0, 1635), layer=1)], 3, 60.0, 15.0
    )
    assert conflicts == ()


def test_routes_over_terrain_that_are_apart_in_height_may_share_a_layer():
    lower = over_terrain(1, (0, 0, 1600), (1000, 0, 1600), layer=0)
    upper = over_terrain(2, (1000, 0, 1620), (0, 0, 1620), layer=0)
    assert assign_layers([lower, upper], 1, 60.0, 15.0)[1] == ()


def test_an_earlier_pass_may_share_a_layer():
    crossing = [
        flight(1, (0, 0), (1000, 0)),
        flight(2, (500, -500), (500, 900)),
        flight(3, (500, -1400), (500, -600)),
    ]
    layers, conflicts = assign_layers(crossing, 2, 50.0)
    assert layers == {1: 0, 2: 1, 3: 0}
    assert conflicts == ()


def test_vehicles_that_cannot_be_kept_apart_are_reported():
    layers, (conflict,) = assign_layers([flight(1, (0, 0), (1000, 0)), flight(2, (1000, 0), (0, 0))], 1, 50.0)
    assert layers == {1: 0, 2: 0}
    assert conflict.vehicles == (1, 2)
    assert conflict.distance_m < 15.0
    assert conflict.after_s == pytest.approx((1000.0 - 50.0) / 30.0, abs=1.5)


def test_a_flown_route_keeps_its_layer_and_others_give_way():
    layers, conflicts = assign_layers(
        [flight(1, (1000, 0), (0, 0), layer=2), flight(2, (0, 0), (1000, 0), layer=2, fixed=True)], 3, 50.0
    )
    assert layers == {1: 0, 2: 2}
    assert conflicts == ()


def test_who_has_arrived_circles_there():
    layers, _ = assign_layers(
        [flight(1, (500, 0), (500, 0), fixed=True), flight(2, (0, 0), (1000, 0))], 2, 50.0
    )
    assert layers == {1: 0, 2: 1}


@settings(max_examples=100)
@given(st.integers(0, 2**32), st.integers(1, 12), st.integers(1, 6))
def test_vehicles_of_one_layer_stay_apart_or_a_conflict_is_reported(seed, count, layers):
    rng = np.random.default_rng(seed)
    flights = [
        PlannedFlight(
            v,
            rng.uniform(0, 1500, (rng.integers(2, 5), 2)),
            15.0,
            int(rng.integers(0, 6)),
            bool(rng.random() < 0.3),
        )
        for v in range(1, count + 1)
    ]
    found, conflicts = assign_layers(flights, layers, 60.0)
    assert set(found) == {f.vehicle for f in flights}
    assert all(0 <= layer < layers for layer in found.values())
    assert all(found[f.vehicle] == f.layer % layers for f in flights if f.keeps_layer)
    said = {c.vehicles for c in conflicts}
    for one in flights:
        for other in flights:
            pair = (one.vehicle, other.vehicle)
            if pair[0] < pair[1] and found[pair[0]] == found[pair[1]] and pair not in said:
                assert nearest_m(one, other) >= 60.0 - 30.0  # checked once a second, closing at 30 m/s


def nearest_m(one, other):
    t_s = np.arange(0.0, 900.0, 0.1)

    def at(f):
        way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(f.points_m, axis=0).T))))
        return np.column_stack([np.interp(f.speed_m_s * t_s, way, f.points_m[:, axis]) for axis in (0, 1)])

    return np.hypot(*(at(one) - at(other)).T).min()


def test_a_route_does_not_share_the_layer_of_a_circle_that_it_touches():
    """A vehicle was led through the circle of one that was held: its position was elsewhere on it."""
    route_m = np.array([(0.0, 0.0), (1000.0, 0.0)])
    centre_m = np.array([(500.0, 110.0), (500.0, 110.0)])
    route = PlannedFlight(1, route_m, 15.0, 2)
    for radius_m, expected in ((0.0, 2), (70.0, 0)):
        held = PlannedFlight(2, centre_m, 15.0, 2, keeps_layer=True, radius_m=radius_m)
        layers, conflicts = assign_layers([route, held], 4, 60.0)
        assert layers == {1: expected, 2: 2}
        assert conflicts == ()


def test_a_route_over_terrain_keeps_apart_from_the_circle_at_the_end_of_another():
    """It passed 60 m beside the target of another, on whose circle of 60 m that was then."""
    there = PlannedFlight(
        1, np.array([(0.0, 0.0), (0.0, 100.0)]), 15.0, 0, True, 0.0, np.array([1600.0, 1600.0]), 60.0
    )
    passing = over_terrain(2, (-1000, 190, 1600), (1000, 190, 1600), layer=1)
    _, (conflict,) = assign_layers([there, passing], 3, 60.0, 15.0)
    assert conflict.distance_m == pytest.approx(30.0, abs=1.0)


def distances(order, min_distance_m, min_height_m):
    """Return the least distance of each pair, and when it falls below the minimum, from every step."""
    places = layer_assignment._positions(order)
    n = len(order)
    distance_m = np.full((n, n), np.inf)
    after_s = np.full((n, n), np.inf)
    for i in range(n):
        for j in range(i):
            gaps = np.hypot(*(places[i] - places[j])[:, :2].T) - places[i, :, 3] - places[j, :, 3]
            gaps[np.abs(places[i, :, 2] - places[j, :, 2]) >= min_height_m] = np.inf
            distance_m[i, j] = gaps.min()
            near = np.flatnonzero(gaps < min_distance_m)
            after_s[i, j] = near[0] if len(near) else np.inf
    return distance_m, after_s


@settings(max_examples=60)
@given(st.integers(0, 10**6), st.booleans())
def test_distances_with_steps_left_out_are_those_of_all_steps(seed, has_heights):
    rng = np.random.default_rng(seed)
    flights = []
    for vehicle in range(8):
        points = rng.uniform(0.0, 2500.0, (rng.integers(1, 5), 2))
        heights = rng.uniform(0.0, 60.0, len(points)) if has_heights and vehicle % 2 else None
        radii = rng.uniform(0.0, 80.0, 2) * (rng.random() < 0.4)
        layer = int(rng.integers(0, 2))
        speed_m_s = rng.uniform(5.0, 30.0)
        flights.append(PlannedFlight(vehicle, points, speed_m_s, layer, True, radii[0], heights, radii[1]))
    want_m, want_s = distances(flights, 150.0, 20.0)
    by_height = np.array([one.heights_msl_m is not None for one in flights])
    layers = np.array([one.layer for one in flights])
    meets = (layers[:, None] == layers) | (by_height[:, None] & by_height)
    _, conflicts = assign_layers(flights, 2, 150.0, 20.0)
    assert {one.vehicles: (one.distance_m, one.after_s) for one in conflicts} == {
        (j, i): (pytest.approx(want_m[i, j]), want_s[i, j])
        for i in range(8)
        for j in range(i)
        if meets[i, j] and want_m[i, j] < 150.0
    }
    still = [replace(one, radius_m=0.0, end_radius_m=0.0) for one in flights]  # circles do not count there
    want_m, _ = distances(still, 150.0, 20.0)
    want_m = np.where(meets, np.minimum(want_m, want_m.T), np.inf)
    assert list(min_separation_m(flights, 20.0).values()) == pytest.approx(want_m.min(axis=1).tolist())


def test_times_are_those_over_ground_in_the_wind_that_vehicles_report():
    """Before, times were those in calm air: two met 40 s later than one of them was planned there."""
    eastwards = flight(1, (120, 1500), (2900, 1500))
    northwards = flight(2, (1500, 740), (1500, 2900))
    layers, _ = assign_layers([eastwards, northwards], 2, 60.0)
    assert layers[1] == layers[2]
    blown = [replace(one, wind_m_s=(8.0, 0.0)) for one in (eastwards, northwards)]
    layers, _ = assign_layers(blown, 2, 60.0)
    assert layers[1] != layers[2]
    _, (conflict,) = assign_layers(blown, 1, 60.0)
    assert conflict.after_s == pytest.approx(60.0, abs=4.0)


def test_a_vehicle_that_cannot_fly_against_the_wind_counts_as_slow():
    against = replace(flight(1, (0, 0), (300, 0)), wind_m_s=(-30.0, 0.0))
    (places,) = layer_assignment._positions([against])
    assert places[10, 0] == pytest.approx(10.0)
    assert tuple(places[-1, :2]) == (300.0, 0.0)
