"""A user would lose the picture: targets born of loitering agents, lost agents kept by others' detections."""

import math
from dataclasses import replace

import numpy as np
import pytest
from helpers.staging import RADAR, T0, S, at, circle, mission, scan, state

from gcs.core.perception.fusion import MultiSensorTracker
from gcs.core.perception.mahalanobis import squared_distances
from gcs.core.perception.report_sensor import at_time, velocity_m_s
from gcs.core.snapshot import decode_state, encode_state
from gcs.core.state import State
from gcs.errors import WireError
from gcs.io.record_json import encode
from gcs.model import NoticeCode, Sensor, read_only

START, GOAL = (100.0, 200.0), (1500.0, 200.0)


UNFORESEEN = """
[tracking.targets]
accel_psd_m2_s3 = 0.25
anywhere = {per_s = 0.0005}
"""


class Sky:
    """Trackers of a mission, and a sensor with noise over it. Clutter comes where a test puts it."""

    def __init__(self, config, seed=0):
        self.config, self.trackers = config, MultiSensorTracker(config)
        self.rng = np.random.default_rng(seed)

    def scan(self, t_s, *things, clutter=(), reports=()):
        """Scan true places `things`; `reports` are vehicle states."""
        noisy = [tuple(np.array(place) + self.rng.normal(0.0, math.sqrt(10.0), 2)) for place in things]
        return self.trackers.scan(scan(t_s, *noisy, *clutter), reports)

    @property
    def agents(self):
        return self.trackers.agents.confirmation.tracks

    @property
    def targets(self):
        return self.trackers.targets.confirmation.tracks


def near(tracks, place, within_m):
    return [one for one in tracks.values() if math.dist(one.mean[:2], place) <= within_m]


# ---------------------------------------------------------------- two kinds in one scan


def test_each_kind_is_tracked_where_it_starts_and_only_there():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(8):
        agents, targets = sky.scan(t_s, (START[0] + 15.0 * t_s, START[1]), GOAL)
    assert [one.label for one in sky.agents.values()] == [(0, 0)]
    assert [one.label for one in sky.targets.values()] == [(0, 0)]
    assert near(sky.agents, (START[0] + 15.0 * 7, START[1]), 10.0)
    assert near(sky.targets, GOAL, 10.0)
    assert (agents.kind, targets.kind) == ("agents", "targets")
    assert agents.scan_t_ns == targets.scan_t_ns == at(7)


@pytest.mark.parametrize("seed", range(3))
def test_an_agent_that_loiters_where_targets_are_born_is_no_target(seed):
    place = (160.0, 200.0)
    sky = Sky(mission(agents=[START], births=[place]), seed)
    for t_s in range(4):
        sky.scan(t_s, (START[0] + 15.0 * t_s, START[1]))
    for t_s in range(4, 60):
        loitering, _ = circle(place, 8.0, 4.0, t_s)
        sky.scan(t_s, loitering)
        assert sky.targets == {}, t_s
    assert [one.label for one in sky.agents.values()] == [(0, 0)]


@pytest.mark.parametrize("seed", range(3))
def test_an_agent_that_is_lost_at_its_target_does_not_stay_in_the_targets_detections(seed):
    target = (300.0, 200.0)
    sky = Sky(mission(agents=[START], births=[target]), seed)
    for t_s in range(14):
        place = (min(START[0] + 15.0 * t_s, 288.0), 200.0)
        sky.scan(t_s, place, target, reports=[state(1, place, t_s, speed_m_s=0.1)])
    assert len(sky.agents) == 1
    for t_s in range(14, 19):
        sky.scan(t_s, target)
    assert sky.trackers.agents.confirmation.is_lost((0, 0))
    assert sky.agents == {}
    assert near(sky.targets, target, 10.0)


def test_two_agents_and_a_target_that_meet_are_all_still_there():
    target = (300.0, 200.0)
    sky = Sky(mission(agents=[START, (500.0, 200.0)], births=[target]))
    for t_s in range(26):
        west, east = (100.0 + 15.0 * t_s, 206.0), (500.0 - 15.0 * t_s, 194.0)
        reports = [
            state(1, west, t_s, speed_m_s=15.0, course_rad=math.pi / 2),
            state(2, east, t_s, speed_m_s=15.0, course_rad=-math.pi / 2),
        ]
        sky.scan(t_s, west, east, target, reports=reports if t_s else [])
    assert set(sky.agents) == {(0, 0), (0, 1)}
    assert set(sky.targets) == {(0, 0)}


# ---------------------------------------------------------------- reports


def test_a_living_agent_that_the_sensor_misses_is_kept_by_its_reports():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(20):
        place = (START[0] + 15.0 * t_s, START[1])
        report = state(1, place, t_s, speed_m_s=15.0, course_rad=math.pi / 2)
        sky.scan(t_s, *([place] if t_s < 5 or t_s % 2 else []), reports=[report])
    assert [one.label for one in sky.agents.values()] == [(0, 0)]


def test_an_agent_without_radio_is_kept_by_the_sensor():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(30):
        sky.scan(t_s, (START[0] + 15.0 * t_s, START[1]))
    assert [one.label for one in sky.agents.values()] == [(0, 0)]
    assert near(sky.agents, (START[0] + 15.0 * 29, START[1]), 10.0)


def test_an_agent_that_falls_silent_and_unseen_is_lost_within_three_scans():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(8):
        place = (START[0] + 15.0 * t_s, START[1])
        sky.scan(t_s, place, reports=[state(1, place, t_s, speed_m_s=15.0, course_rad=math.pi / 2)])
    for t_s in range(8, 11):
        sky.scan(t_s)
    assert sky.trackers.agents.confirmation.is_lost((0, 0))


@pytest.mark.parametrize("p_d", [0.99, 1.0])
def test_a_fast_sensor_that_leaves_an_agent_out_cannot_end_its_track_against_reports_and_radar(p_d):
    """Ten misses a second, each taken for 100 to 1 against the agent, ended its track after 0.7 s."""
    sky = Sky(mission(agents=[START], births=[GOAL]))
    rogue = replace(RADAR, name="rogue", detection_probability=p_d)
    for tenth in range(200):
        t_s = 0.1 * tenth
        place = (START[0] + 15.0 * t_s, START[1])
        report = state(1, place, t_s, speed_m_s=15.0, course_rad=math.pi / 2)
        if tenth % 10 == 0:
            sky.scan(t_s, place, GOAL, reports=[report])
        elif t_s > 5.0:
            sky.trackers.scan(replace(scan(t_s, GOAL), sensor=rogue), [report])
            assert not sky.trackers.agents.confirmation.is_lost((0, 0))
    assert near(sky.agents, place, 15.0)


def test_a_fast_sensor_that_leaves_a_target_out_cannot_end_its_track_while_the_radar_detects_it():
    """Its track fell out of the picture 0.6 s after the first of ten scans a second."""
    sky = Sky(mission(agents=[START], births=[GOAL]))
    rogue = replace(RADAR, name="rogue", detection_probability=0.99)
    for tenth in range(200):
        t_s = 0.1 * tenth
        if tenth % 10 == 0:
            sky.scan(t_s, START, GOAL)
        elif t_s > 5.0:
            sky.trackers.scan(replace(scan(t_s, START), sensor=rogue), [])
            assert near(sky.targets, GOAL, 15.0), t_s


@pytest.mark.parametrize("rate_hz", [1, 10])
def test_a_target_that_a_hostile_sensor_drags_away_has_a_track_at_its_place_again(rate_hz):
    """The misses of the hostile sensor ended each new track there before the radar's second detection."""
    sky = Sky(mission(agents=[START], births=[GOAL], tables=UNFORESEEN))
    rogue = replace(RADAR, name="rogue", detection_probability=0.99, noise_cov_m2=read_only(np.eye(2)))
    begin_s = 20.0
    is_back = []
    for tenth in range(500):
        t_s = 0.1 * tenth
        target = (GOAL[0], GOAL[1] + 10.0 * t_s)  # away from the place where births are declared
        if tenth % 10 == 0:
            sky.scan(t_s, START, target, clutter=sky.rng.uniform(0.0, 2000.0, (20, 2)).tolist())
            is_back.append(bool(near(sky.targets, target, 15.0)))
        elif t_s > begin_s and tenth % 10 % (10 // rate_hz) == 5 % (10 // rate_hz):
            dragged = (target[0] + 5.0 * (t_s - begin_s), target[1])
            sky.trackers.scan(replace(scan(t_s, START, dragged), sensor=rogue), [])
    assert all(is_back[3:20])
    assert not all(is_back[20:35])
    assert all(is_back[35:])


def test_a_flood_of_sensor_names_is_bounded():
    sky = Sky(mission(agents=[START], births=[GOAL], tables=UNFORESEEN))
    for tenth in range(150):
        one = replace(RADAR, name=f"rogue-{tenth}")
        sky.trackers.scan(replace(scan(0.1 * tenth, GOAL), sensor=one), [])
    state = sky.trackers.state
    assert len(state.untracked.chains) <= 100
    assert "rogue-149" in state.untracked.chains


def test_a_vehicle_that_reports_where_nothing_is_known_comes_back_into_the_picture():
    sky, lost = Sky(mission(agents=[START], births=[GOAL])), (900.0, 900.0)
    for t_s in range(6):
        sky.scan(t_s, lost, reports=[state(1, lost, t_s)])
    assert len(sky.agents) == 1
    assert near(sky.agents, lost, 8.0)
    assert sky.targets == {}


def test_detections_without_a_report_or_a_birth_component_are_no_agent():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(10):
        sky.scan(t_s, (900.0, 900.0))
    assert (dict(sky.agents), dict(sky.targets)) == ({}, {})


def test_an_old_report_is_not_a_place_where_a_vehicle_is_now():
    sky, lost = Sky(mission(agents=[START], births=[GOAL])), (900.0, 900.0)
    for t_s in range(2, 10):
        sky.scan(t_s, lost, reports=[state(1, lost, 0.5)])
    assert sky.agents == {}


def test_the_targets_filter_does_not_hear_reports():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(8):
        sky.scan(t_s, reports=[state(1, GOAL, t_s)])
    assert sky.targets == {}


def test_a_report_is_moved_to_the_time_of_the_scan():
    northeast = state(1, (100.0, 50.0), 10.0, speed_m_s=20.0, course_rad=math.pi / 4)
    v = 20.0 / math.sqrt(2.0)
    assert velocity_m_s(northeast) == pytest.approx((v, v))
    assert at_time(northeast, at(10.5)) == pytest.approx((100.0 + v / 2, 50.0 + v / 2))
    assert at_time(northeast, at(9.0)) == pytest.approx((100.0 - v, 50.0 - v))


# ---------------------------------------------------------------- births


def test_clutter_at_a_place_that_has_given_its_target_is_no_second_one():
    def seen_as_two(before):
        """Whether a single clutter point at the place of birth makes an estimate of one more target."""
        sky = Sky(mission(agents=[START], births=[(1500.0, 900.0), GOAL]))
        for t_s in range(before):
            sky.scan(t_s, (GOAL[0], GOAL[1] + 6.0 * t_s))
        _, targets = sky.scan(before, (GOAL[0], GOAL[1] + 6.0 * before), clutter=[GOAL])
        return sum(one.estimated for one in targets.tracks) - (before > 0)

    assert seen_as_two(before=40) == 0
    sky = Sky(
        mission(agents=[START], births=[GOAL])
    )  # a place that has given nothing yet is confirmed sooner
    _, targets = sky.scan(0, clutter=[GOAL])
    assert sum(one.estimated for one in targets.tracks) == 1


def test_a_second_object_at_a_place_is_still_found_when_it_stays():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(50):
        first = (GOAL[0], GOAL[1] + 6.0 * t_s)
        sky.scan(t_s, *([first] if t_s < 30 else [first, GOAL]))
    assert len(sky.targets) == 2


def test_every_place_gives_its_own_target():
    births = [(1500.0, 200.0), (1500.0, 260.0), (1500.0, 320.0)]
    sky = Sky(mission(agents=[START], births=births))
    for t_s in range(30):
        appeared = births[: 1 + t_s // 8]
        sky.scan(t_s, *appeared)
    assert len(sky.targets) == 3
    assert all(near(sky.targets, place, 8.0) for place in births)


def test_a_mission_without_places_of_birth_has_no_targets_and_no_trouble():
    sky = Sky(mission(agents=[START], births=[]))
    for t_s in range(5):
        sky.scan(t_s, START, GOAL)
    assert (len(sky.agents), len(sky.targets)) == (1, 0)


# ---------------------------------------------------------------- time and scans


def test_scans_at_irregular_times_keep_one_label_for_a_moving_target():
    sky, rng, t_s = Sky(mission(agents=[START], births=[GOAL])), np.random.default_rng(5), 0.0
    for _ in range(40):
        place = (GOAL[0] - 5.0 * t_s, GOAL[1] + 3.0 * t_s)
        sky.scan(t_s, place)
        t_s += float(rng.uniform(0.1, 4.0))
    assert list(sky.targets) == [(0, 0)]
    assert near(sky.targets, place, 12.0)
    assert sky.targets[(0, 0)].mean[2:] == pytest.approx((-5.0, 3.0), abs=1.5)


def test_a_scan_is_of_its_epoch_not_of_its_arrival():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(8):
        place = (GOAL[0] + 6.0 * t_s, GOAL[1])
        _, targets = sky.trackers.scan(scan(t_s, place, arrives_s=t_s + 0.7), [])
    assert (targets.t_ns, targets.scan_t_ns) == (at(7.7), at(7))
    assert near(sky.targets, (GOAL[0] + 42.0, GOAL[1]), 3.0)


@pytest.mark.parametrize(
    ("measured_s", "arrives_s", "sensor", "words"),
    [
        (5.0, 5.0, RADAR, "twice"),
        (4.0, 5.5, RADAR, "1.000 s before the last"),
        (5.0, 5.0, Sensor("lidar", 0.9, 1e-6, read_only(np.eye(2)), RADAR.field_of_view_m), ""),
        (5.1, 9.0, RADAR, ""),
    ],
)
def test_a_scan_that_is_late_or_repeated_is_refused_with_a_reason(measured_s, arrives_s, sensor, words):
    sky = Sky(mission(agents=[START], births=[GOAL]))
    sky.scan(5.0, GOAL)
    refusal = sky.trackers.refusal(scan(measured_s, GOAL, sensor=sensor, arrives_s=arrives_s))
    assert words in refusal
    assert bool(refusal) == bool(words)


@pytest.mark.parametrize("noise", [np.zeros((2, 2)), np.diag([0.0, 9.0]), np.full((2, 2), 4.0)])
def test_a_sensor_that_claims_no_noise_is_survived(noise):
    sensor = Sensor("radar", 1.0, 0.0, read_only(noise), RADAR.field_of_view_m)
    trackers = MultiSensorTracker(mission(agents=[START], births=[GOAL]))
    for t_s in range(6):
        trackers.scan(scan(t_s, START, GOAL, sensor=sensor), [state(1, START, t_s)])
    assert len(trackers.agents.confirmation.tracks) == len(trackers.targets.confirmation.tracks) == 1


def test_the_other_kinds_intensity_adds_up_to_the_detections_expected_of_it():
    """The integral of the intensity over the plane is p_D times the expected number of objects."""
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(6):
        sky.scan(t_s, START, GOAL)
    east, north = np.meshgrid(
        np.arange(-100.0, 100.0, 0.5) + GOAL[0], np.arange(-100.0, 100.0, 0.5) + GOAL[1]
    )
    grid = np.column_stack([east.ravel(), north.ravel()])
    targets = sky.trackers.targets
    for ahead_s in (0.0, 1.0):
        total = targets.intensity(at(5 + ahead_s), grid, RADAR).sum() * 0.25
        assert total == pytest.approx(0.98 * targets.picture.tracks[0].existence, rel=1e-3)


def test_tracks_are_expected_further_on_the_longer_ago_they_were_seen():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(20):
        sky.scan(t_s, (GOAL[0], GOAL[1] + 6.0 * t_s))
    (now,), (cov,), _ = sky.trackers.targets.expected(T0 + 19 * S)
    (later,), (wider,), existence = sky.trackers.targets.expected(T0 + 24 * S)
    assert later - now == pytest.approx((0.0, 30.0), abs=5.0)
    assert np.linalg.eigvalsh(wider - cov).min() > 0.0
    assert existence.shape == (1,)


def test_distances_are_those_of_the_textbook_for_each_pair():
    rng = np.random.default_rng(0)
    places, means = rng.normal(0, 9, (3, 2)), rng.normal(0, 9, (2, 2))
    roots = rng.normal(0, 1, (2, 2, 2))
    S_ = roots @ roots.transpose(0, 2, 1) + np.eye(2)
    found = squared_distances(places, means, S_)
    for i in range(3):
        for j in range(2):
            d = places[i] - means[j]
            assert found[i, j] == pytest.approx(d @ np.linalg.solve(S_[j], d))


# ---------------------------------------------------------------- seen and not tracked


def notices_of(sky, seconds, *things):
    """Return the notices, scan by scan, while `things` are seen."""
    news = []
    for t_s in seconds:
        sky.scan(t_s, *things)
        news += [(t_s, notice) for notice in sky.trackers.untracked.notices(at(t_s))]
    return news


def test_the_operator_is_warned_of_persistent_detections_without_a_track():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    news = notices_of(sky, range(12), START, GOAL, (1200.0, 900.0))
    ((t_s, notice),) = news
    assert notice.code is NoticeCode.UNTRACKED_DETECTIONS
    assert t_s <= 8
    assert notice.parameters["remedy"] == "add [[births]] there, or set tracking.targets.anywhere.per_s"
    place = notice.parameters["places"]
    assert place.startswith("east 1")
    lat, lon = (float(part) for part in place[place.index("(") + 1 : place.index(")")].split(","))
    frame = mission(agents=[START], births=[GOAL]).local_frame
    assert math.dist(frame.to_local(lat, lon), (1200.0, 900.0)) < 15.0
    gone = notices_of(sky, range(12, 40), START, GOAL)
    assert [notice.code for _, notice in gone] == [NoticeCode.UNTRACKED_OVER]


def test_tracked_objects_and_few_detections_get_no_notice():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    assert notices_of(sky, range(20), START, GOAL) == []
    assert notices_of(sky, range(20, 22), START, GOAL, (1200.0, 900.0)) == []
    assert notices_of(sky, range(22, 40), START, GOAL) == []


def test_many_untracked_objects_make_one_alarm():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    crowd = [(300.0 + 250.0 * i, 1500.0) for i in range(6)]
    news = notices_of(sky, range(10), START, GOAL, *crowd)
    ((_, notice),) = news
    assert notice.code is NoticeCode.UNTRACKED_DETECTIONS
    assert notice.parameters["places"].count("(") <= 3
    assert "more place" in notice.parameters["places"]


# ---------------------------------------------------------------- continuing from a snapshot


def continued(sky, change=lambda _trackers: None):
    """Return the same trackers from a snapshot of their state, after a change."""
    trackers = decode_state("test", snapshot_of(sky)).perception.trackers
    change(trackers)
    again = Sky(sky.config)
    again.trackers = MultiSensorTracker(sky.config, trackers)
    return again


def snapshot_of(sky):
    whole = State.initial([1])
    whole.perception.trackers = sky.trackers.state
    return encode_state(whole)


def crowded_scans(sky, seconds):
    """Scan an agent, a target and an untracked object in clutter, with the clutter of each second."""
    for t_s in seconds:
        sky.rng = np.random.default_rng(t_s)
        clutter = [tuple(place) for place in sky.rng.uniform(0.0, 2000.0, (20, 2))]
        start = (START[0] + 15.0 * t_s, START[1])
        reports = [state(1, start, t_s, speed_m_s=15.0, course_rad=math.pi / 2)]
        yield sky.scan(t_s, start, GOAL, (1200.0, 900.0), clutter=clutter, reports=reports)


ANYWHERE = """
[tracking.targets]
accel_psd_m2_s3 = 0.25
anywhere = {per_s = 0.02}
[tracking.agents]
accel_psd_m2_s3 = 1.0
turn_rate_std_deg_s = 6.0
"""


def test_trackers_continue_from_a_snapshot_to_the_last_bit():
    sky = Sky(mission(agents=[START], births=[GOAL], tables=ANYWHERE))
    list(crowded_scans(sky, range(9)))
    again = continued(sky)
    assert encode(again.trackers.agents.picture) == encode(sky.trackers.agents.picture)
    pairs = zip(crowded_scans(sky, range(9, 25)), crowded_scans(again, range(9, 25)), strict=True)
    for expected, pictures in pairs:
        assert [encode(one) for one in pictures] == [encode(one) for one in expected]
    assert snapshot_of(again) == snapshot_of(sky)
    assert len(sky.targets) == 2


def damage_posterior(trackers):
    posterior = trackers.targets.filter.posterior
    posterior.clusters.items[0] = 10**6


def damage_births(trackers):
    trackers.agents.is_born.append(True)


@pytest.mark.parametrize("damage", [damage_posterior, damage_births])
def test_trackers_refuse_a_damaged_snapshot(damage):
    sky = Sky(mission(agents=[START], births=[GOAL]))
    list(crowded_scans(sky, range(9)))
    with pytest.raises(ValueError, match="tracker state"):
        continued(sky, damage)


def damage_chains(trackers):
    trackers.untracked.chains[RADAR.name].mean = np.zeros((3, 4))


def damage_unexplained(trackers):
    unexplained = trackers.targets.adaptive_birth.unexplained
    trackers.targets.adaptive_birth.unexplained = unexplained._replace(noise_m2=np.full((1, 2, 2), np.nan))


@pytest.mark.parametrize("damage", [damage_chains, damage_unexplained])
def test_a_snapshot_with_damaged_detections_is_refused(damage):
    sky = Sky(mission(agents=[START], births=[GOAL], tables=ANYWHERE))
    list(crowded_scans(sky, range(9)))
    damage(sky.trackers.state)
    with pytest.raises(WireError, match="not valid"):
        continued(sky)


# ---------------------------------------------------------------- reports over a satellite


def test_an_agent_out_of_view_lives_on_by_a_report_every_five_seconds():
    """Vehicle 1 reports four times a second in view of a radar, vehicle 2 by HIGH_LATENCY2 out of view."""
    sky = Sky(mission(agents=[START, (100.0, 1500.0)], births=[]))
    near_start = replace(RADAR, field_of_view_m=(0.0, 0.0, 2000.0, 800.0))
    late_m = 45.0
    for step in range(4 * 60):
        t_s = step / 4
        first = (START[0] + 15.0 * t_s, START[1])
        second = (100.0 + 15.0 * t_s, 1500.0)
        states = [state(1, first, t_s, speed_m_s=15.0, course_rad=math.pi / 2)]
        reported_s = t_s if t_s < 5.0 else 5.0 * (t_s // 5.0)
        slow = {"period_s": 5.0, "std_m": 75.0} if t_s >= 5.0 else {}
        place = (100.0 + 15.0 * reported_s - (late_m if slow else 0.0), 1500.0)
        reported = state(2, place, reported_s, speed_m_s=15.0, course_rad=math.pi / 2)
        states.append(replace(reported, **slow))
        sky.trackers.scan(scan(t_s, first, sensor=near_start), states)
    assert len(sky.agents) == 2
    assert near(sky.agents, second, 120.0)


# ---------------------------------------------------------------- the picture of some scans ago


def test_a_late_picture_is_of_the_scan_some_scans_ago_and_more_accurate():
    config = mission([START], [GOAL], "[tracking]\nlag_scans = 3\n")
    sky = Sky(config)
    errors = {"late": [], "now": []}
    for t_s in range(14):
        place = (START[0] + 15.0 * t_s, START[1])
        agents, _ = sky.scan(t_s, place, GOAL, reports=[])
        late = sky.trackers.lagged_pictures(agents.t_ns)
        if t_s < 3:
            assert late == []
            continue
        assert [(one.kind, one.scan_t_ns) for one in late] == [
            ("agents", at(t_s - 3)),
            ("targets", at(t_s - 3)),
        ]
        ((track,), (target,)) = (one.tracks for one in late)
        assert (track.label, target.label) == ((0, 0), (0, 0))
        errors["late"].append(math.dist(track.mean[:2], (START[0] + 15.0 * (t_s - 3), START[1])))
        errors["now"].append(math.dist(next(iter(sky.agents.values())).mean[:2], place))
    assert np.mean(errors["late"]) < 0.8 * np.mean(errors["now"])


def test_without_a_lag_there_is_no_late_picture():
    sky = Sky(mission(agents=[START], births=[GOAL]))
    for t_s in range(4):
        sky.scan(t_s, START, GOAL)
        assert sky.trackers.lagged_pictures(at(t_s)) == []
