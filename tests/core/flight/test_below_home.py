"""In a valley below its home a vehicle flies at heights that are negative above home."""

from dataclasses import replace

from helpers.hills import elevation_of, terrain_table
from helpers.sky import FIELD, Sky, fly_on

from gcs.model import FlightPhase


def test_a_vehicle_that_was_down_and_flies_in_a_valley_below_its_home_flies_again():
    """Before, it was down until it was 10 m above its home."""
    valley = terrain_table(elevation_of(lambda east, north: 70.0 + 0.0 * (east + north), 3000.0))
    sky = Sky((600.0, 600.0, 80.0), field=FIELD + valley)
    autopilot = sky.planes[1].autopilot
    autopilot.home = replace(autopilot.home, alt_m=200.0)
    fly_on(sky, 10.0)
    flight = sky.run_.engine.state.agents[1].flight
    flight.phase = FlightPhase.DOWN
    fly_on(sky, 5.0)
    assert sky.planes[1].alt_rel_m < 150.0
    assert flight.phase is FlightPhase.EN_ROUTE
