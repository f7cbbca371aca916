"""A user would lose vehicles and time: agents falsely lost, losses undetected, arrivals not counted."""

from helpers.staging import at, confirmation_of, confirmed, mission, picture, track, zones
from hypothesis import given
from hypothesis import strategies as st

from gcs.core.perception.arrival_and_loss import NEVER_SEEN_S, UNSEEN_S, AgentStatusMonitor
from gcs.core.state import State, at_targets, with_status
from gcs.model import Route, read_only

AGENT, TARGET = (0, 0), (0, 1)
RADIUS_M = 40.0
HERE, FAR = (0.0, 0.0), (500.0, 0.0)
NO_TRACKS = confirmation_of()
ROUTE = Route(1, TARGET, read_only([HERE]), 500.0)


class Scene:
    """One agent, vehicle 1, on its way to one target; a scan a second."""

    def __init__(self, vehicles=(1,)):
        self.agents = State.initial(vehicles).agents
        self.monitor = AgentStatusMonitor(self.agents, zones(mission()), RADIUS_M)
        self.t_s = 0

    def scan(
        self,
        agent=None,
        target=None,
        *,
        associated=True,
        reporting=True,
        tasked=True,
        again=False,
        seen_by_one=(),
    ):
        """Process a scan with this agent's and this target's track; return (vehicle, status) that changed."""
        self.t_s += not again
        agents = confirmed(agent) if agent else NO_TRACKS
        targets = confirmed(target) if target else NO_TRACKS
        self.agents[1].perception.association.label = AGENT if associated else None
        self.agents[1].routes.flown = ROUTE if tasked else None
        changed = self.monitor.update(
            at(self.t_s), at(self.t_s), agents, targets, {1} if reporting else set(), seen_by_one
        )
        assert all(status.t_ns == at(self.t_s) for status in changed)
        return [(status.vehicle, status.status) for status in changed]

    @property
    def status(self):
        return self.agents[1].perception.status


def flying(place=FAR, **changes):
    return track(AGENT, place, **changes)


def goal(place=HERE):
    return track(TARGET, place)


def test_an_agent_whose_track_is_gone_is_lost_and_its_last_place_is_known():
    scene = Scene()
    assert scene.scan(flying((300.0, 40.0)), goal()) == []
    assert scene.scan(None, goal(), reporting=False) == [(1, "lost")]
    assert scene.status.position_m == (300.0, 40.0)
    assert with_status(scene.agents, "active") == []


def test_an_agent_whose_track_was_only_missed_flies_on():
    scene = Scene()
    scene.scan(flying(), goal())
    doubted = confirmed(flying())
    for _ in range(6):
        scene.t_s += 1
        doubted.update(picture(flying(existence=0.3, estimated=False)))
        assert scene.monitor.update(at(scene.t_s), at(scene.t_s), doubted, NO_TRACKS, set()) == []


def test_the_last_place_known_is_one_where_it_was_seen():
    scene = Scene()
    scene.scan(flying((300.0, 40.0)), goal())
    coasted = confirmed(flying((300.0, 40.0)))
    coasted.update(picture(flying((390.0, 40.0), existence=0.2, estimated=False)))
    scene.monitor.update(at(2), at(2), coasted, NO_TRACKS, set())
    scene.scan(None, goal(), reporting=False)
    assert scene.status.position_m == (300.0, 40.0)


def test_a_clutter_point_near_a_lost_agent_does_not_revive_it():
    scene = Scene()
    scene.scan(flying(), goal())
    scene.scan(None, goal(), reporting=False)
    for _ in range(5):
        assert scene.scan(flying(), goal(), reporting=False) == []
        assert scene.scan(None, goal(), associated=False, reporting=False) == []
    assert scene.status.status == "lost"


def test_one_sensor_alone_does_not_keep_a_silent_agent_alive():
    scene = Scene()
    alone = {"seen_by_one": {AGENT}}
    assert [scene.scan(flying(), goal(), **alone) for _ in range(10)] == [[]] * 10  # it reports
    silent = [scene.scan(flying(), goal(), reporting=False, **alone) for _ in range(round(UNSEEN_S) + 1)]
    assert silent == [[]] * round(UNSEEN_S) + [[(1, "lost")]]
    for _ in range(5):  # the sensor goes on with its claim
        assert scene.scan(flying(), goal(), reporting=False, **alone) == []
    assert scene.scan(flying(), goal(), **alone) == [(1, "active")]


def test_a_silent_agent_that_no_other_sensor_could_see_flies_on():
    scene = Scene()
    scene.scan(flying(), goal())
    assert [scene.scan(flying(), goal(), reporting=False) for _ in range(30)] == [[]] * 30


def test_a_lost_agent_is_active_again_only_with_a_report_and_a_sure_track_associated_to_it():
    def lost():
        scene = Scene()
        scene.scan(flying(), goal())
        assert scene.scan(None, goal(), reporting=False) == [(1, "lost")]
        return scene

    assert lost().scan(None, goal(), associated=False, reporting=True) == []
    assert lost().scan(flying(), goal(), associated=False, reporting=True) == []
    assert lost().scan(flying(existence=0.89), goal(), reporting=True) == []
    scene = lost()
    assert scene.scan(flying(existence=0.9), goal(), reporting=True) == [(1, "active")]
    assert with_status(scene.agents, "active") == [1]


def test_a_revived_agent_can_be_lost_again_and_can_arrive():
    scene = Scene()
    scene.scan(flying(), goal())
    scene.scan(None, goal(), reporting=False)
    scene.scan(flying(), goal())
    assert scene.scan(None, goal(), reporting=False) == [(1, "lost")]
    scene.scan(flying(), goal())
    assert [scene.scan(flying(HERE), goal()) for _ in range(2)] == [[], [(1, "arrived")]]


def test_arrival_takes_two_scans_in_a_row():
    scene = Scene()
    near, away = flying((39.9, 0.0)), flying((40.1, 0.0))
    assert [scene.scan(a, goal()) for a in (near, away, near, away, near)] == [[]] * 5
    assert scene.scan(near, goal()) == [(1, "arrived")]
    assert (scene.status.target, scene.status.position_m) == (TARGET, (39.9, 0.0))
    assert at_targets(scene.agents) == {TARGET: 1}


def test_two_sensors_that_see_an_agent_at_its_target_at_one_epoch_are_not_two_scans_in_a_row():
    scene = Scene()
    assert [scene.scan(flying(HERE), goal(), again=again) for again in (False, True, True)] == [[]] * 3
    assert scene.scan(flying(HERE), goal()) == [(1, "arrived")]


def test_a_second_sensor_that_sees_the_agent_elsewhere_at_that_epoch_breaks_the_row():
    scene = Scene()
    scene.scan(flying(HERE), goal())
    scene.scan(flying(FAR), goal(), again=True)
    assert scene.scan(flying(HERE), goal()) == []


def test_an_agent_that_is_lost_on_its_last_metres_has_not_arrived():
    scene = Scene()
    scene.scan(flying(HERE), goal())
    assert scene.scan(None, goal(), reporting=False) == [(1, "lost")]
    assert not at_targets(scene.agents)


def test_a_track_that_coasts_over_the_target_unseen_has_not_arrived():
    scene = Scene()
    scene.agents[1].perception.association.label = AGENT
    agents = confirmed(flying(HERE))
    agents.update(picture(flying(HERE, existence=0.4, estimated=False)))
    for t_s in range(1, 5):
        changed = scene.monitor.update(at(t_s), at(t_s), agents, confirmed(goal()), {1})
        assert changed == []


def test_an_agent_passes_targets_that_are_not_its_own():
    scene = Scene()
    assert [scene.scan(flying(HERE), goal(), tasked=False) for _ in range(5)] == [[]] * 5
    assert [scene.scan(flying(HERE), None) for _ in range(5)] == [[]] * 5


def test_arrival_is_for_good():
    scene = Scene()
    scene.scan(flying(HERE), goal())
    scene.scan(flying(HERE), goal())
    arrived = scene.status
    scene.scan(None, None, reporting=False)
    for _ in range(30):
        assert scene.scan(None, None, associated=False, reporting=False, tasked=False) == []
    assert scene.status == arrived


def test_a_vehicle_that_never_shows_up_is_lost_after_twenty_seconds():
    scene = Scene()
    unseen = [
        scene.scan(None, goal(), associated=False, reporting=False) for _ in range(int(NEVER_SEEN_S) + 1)
    ]
    assert unseen == [[]] * 21
    assert scene.scan(None, goal(), associated=False, reporting=False) == [(1, "lost")]
    assert scene.status.position_m is None


def test_a_vehicle_that_reported_and_was_never_associated_is_lost_after_five_seconds_unheard():
    scene = Scene()
    assert scene.scan(None, goal(), associated=False, reporting=True) == []
    silent = [scene.scan(None, goal(), associated=False, reporting=False) for _ in range(int(UNSEEN_S))]
    assert silent == [[]] * 5
    assert scene.scan(None, goal(), associated=False, reporting=False) == [(1, "lost")]


def test_a_report_or_an_association_within_five_seconds_keeps_an_agent_active():
    by_reports, by_association = Scene(), Scene()
    for second in range(1, 80):
        now = second % 5 == 0
        assert by_reports.scan(None, goal(), associated=False, reporting=now) == []
        assert by_association.scan(flying() if now else None, goal(), associated=now, reporting=False) == []


@given(st.lists(st.tuples(*[st.booleans()] * 5), max_size=40))
def test_an_agent_status_changes_only_in_allowed_steps(scans):
    """Active to lost or arrived, lost to active, arrived never; each change is reported once."""
    scene, last = Scene(vehicles=(1, 2)), {1: "active", 2: "active"}
    for seen, near, associated, reporting, tasked in scans:
        agent = flying(HERE if near else FAR) if seen else None
        for vehicle, status in scene.scan(
            agent, goal(), associated=associated, reporting=reporting, tasked=tasked
        ):
            assert (last[vehicle], status) in {("active", "lost"), ("active", "arrived"), ("lost", "active")}
            last[vehicle] = status
    assert last == {vehicle: agent.perception.status.status for vehicle, agent in scene.agents.items()}
