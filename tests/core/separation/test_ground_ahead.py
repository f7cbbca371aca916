"""How far a hold leads a vehicle out of the flight band."""

import pytest
from helpers.hills import elevation_of, hill
from helpers.sky import FIELD, Sky

from gcs.config.schema import TerrainTable
from gcs.core.separation.forward_flight import Flight, Goal, GoalKind


@pytest.mark.parametrize(("wind_m_s", "may_hold"), [(0.0, True), (8.0, False)])
def test_a_hold_keeps_clear_of_a_hill_beside_it_in_wind_and_may_pass_it_without(wind_m_s, may_hold):
    """A hill 100 m west of the centre of a circle of 70 m: in calm air none could hold beside it."""
    ground = Sky((500.0, 500.0, 60.0), field=FIELD).run_.engine.stages.avoidances._order_check._ground
    ground._elevation = elevation_of(hill(1400.0, 1500.0, 60.0, 12.0, 70.0), 3000.0)
    ground._terrain = TerrainTable(file="ground.tif", min_agl_m=50.0, max_agl_m=150.0)
    hold = Flight(
        vehicle=1,
        east_m=1500.0,
        north_m=1500.0,
        height_m=150.0,
        speed_m_s=15.0,
        course_rad=0.0,
        climb_m_s=0.0,
        turn_rate_rad_s=0.0,
        max_turn_rate_rad_s=0.45,
        goals=(Goal(GoalKind.CIRCLE, 1500.0, 1500.0, 70.0, 150.0),),
        wind_m_s=(wind_m_s, 0.0),
    )
    below_m, above_m = ground.departures_m(hold, 40.0)
    assert (below_m < 0.0) is may_hold
    assert above_m < 0.0
