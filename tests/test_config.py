"""A mission file's mistakes are named: file, key, what was expected."""

import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli import app
from gcs.config import load, parse, read_text, scenario_names
from gcs.errors import ConfigError
from gcs.geo import LocalFrame
from sim_vehicles.world.scenario import parse_scenario

GOOD = """
name = "x"
[frame]
lat_deg = 33.0
lon_deg = -87.0
alt_msl_m = 70.0
[[agents]]
system_id = 1
east_m = 100.0
north_m = 100.0
"""


def test_the_scenarios_of_the_paper_are_shipped_and_valid() -> None:
    assert scenario_names() == [
        "deterministic",
        "prescribed",
        "random-obstacles",
        "random-targets",
        "radars",
        "swarm-50",
    ]
    for name in scenario_names():
        assert load(name).name == name


@pytest.mark.parametrize(
    ("change", "key", "words"),
    [
        (("lat_deg = 33.0", "lat_deg = 133.0"), "frame.lat_deg", "<= 85"),
        (("lat_deg = 33.0", 'lat_deg = "north"'), "frame.lat_deg", "expected a number, got text"),
        (("system_id = 1", "system_id = 251"), "agents[0].system_id", "250"),
        (("east_m = 100.0", "east_m = 9000.0"), "agents[0]", "outside the map"),
        (("east_m = 100.0", "easting_m = 100.0"), "agents[0]", "easting_m"),
        (('name = "x"', 'name = "x"\nspeed = 3'), "", "unknown key `speed`"),
        (('name = "x"', 'name = "x"\n[map]\nnodes_east = 21'), "map", "square"),
        (('name = "x"', 'name = "x"\n[tracking]\nlost_existence = 0.6'), "tracking.lost_existence", "0.5"),
    ],
)
def test_a_mistake_names_file_key_and_what_was_expected(
    change: tuple[str, str], key: str, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(GOOD.replace(*change), "mission.toml")
    assert caught.value.file == "mission.toml"
    assert caught.value.key == key
    assert words in str(caught.value)


def test_two_agents_of_one_system_id_are_refused() -> None:
    again = "[[agents]]\nsystem_id = 1\neast_m = 200.0\nnorth_m = 100.0\n"
    with pytest.raises(ConfigError, match="used twice"):
        parse(GOOD + again, "mission.toml")


def test_endpoints_come_alone_or_listed_and_of_other_networks() -> None:
    links = """
[links]
mavlink = ["/dev/ttyUSB0,57600", { endpoint = "udp://:14560", network = 2 }]
[[links.forward]]
endpoint = "tcpin:0.0.0.0:5790"
access = "full"
network = 2
"""
    config = parse(GOOD.replace("system_id = 1", "system_id = 1\nnetwork = 2") + links, "mission.toml")
    assert [(link.name, link.network, link.role) for link in config.mavlink_links] == [
        ("serial:/dev/ttyUSB0:57600", 0, "vehicles"),
        ("udpin:0.0.0.0:14560", 2, "vehicles"),
        ("tcpin:0.0.0.0:5790", 2, "full"),
    ]
    assert config.agents[0].vehicle == 2 * 256 + 1


@pytest.mark.parametrize(
    ("links", "key", "words"),
    [
        ('mavlink = "14550"', "links.mavlink", "udpin:HOST:PORT"),
        ('mavlink = ["udpin:0.0.0.0:1", "udp"]', "links.mavlink[1]", "udpin:HOST:PORT"),
        ('mavlink = ["udpin:0.0.0.0:1", "udp://:1"]', "links.mavlink[1]", "twice"),
        ("mavlink = []", "links.mavlink", "length >= 1"),
        ('forward = [{ endpoint = "serial:x" }]', "links.forward[0]", "serial:/dev/DEVICE:BAUD"),
        ('forward = [{ endpoint = "udpin::2", access = "some" }]', "links.forward[0].access", "some"),
        ('forward = [{ endpoint = "udpin::2", network = 3 }]', "links.forward[0]", "network 3 has no"),
        ('mavlink = { endpoint = "udpin::2", network = 3 }', "agents[0].network", "network 0 has no"),
    ],
)
def test_an_endpoint_that_is_wrong_is_named(links: str, key: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(f"{GOOD}[links]\n{links}\n", "mission.toml")
    assert caught.value.key.startswith(key)
    assert words in str(caught.value)


def test_broken_toml_and_missing_files_say_so(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not valid TOML"):
        parse("a = [[", "mission.toml")
    with pytest.raises(ConfigError, match="shipped scenarios: deterministic"):
        read_text("no-such-scenario")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="is not text: expected a mission file"):
        read_text(str(binary))


# ---------------------------------------------------------------- places by latitude and longitude

SIMULATED = """
[simulation]
forward_speed_m_s = 15.0
[[simulation.targets]]
east_m = 700.0
north_m = 900.0
"""
BORN = GOOD + "[[births]]\neast_m = 700.0\nnorth_m = 900.0\n"


def in_degrees(text: str) -> str:
    """The same file with every place by latitude and longitude."""
    frame = LocalFrame(33.0, -87.0, 70.0)

    def place(match: re.Match[str]) -> str:
        lat_deg, lon_deg = frame.to_geodetic(float(match[1]), float(match[2]))
        return f"lat_deg = {lat_deg:.9f}\nlon_deg = {lon_deg:.9f}"

    return re.sub(r"east_m = ([\d.]+)\nnorth_m = ([\d.]+)", place, text)


def test_places_may_be_given_by_latitude_and_longitude() -> None:
    text = in_degrees(BORN + SIMULATED)
    assert "east_m" not in text
    metres, degrees = parse(BORN, "m.toml"), parse(text, "m.toml")
    for one, other in ((metres.agents, degrees.agents), (metres.births, degrees.births)):
        assert [(row.east_m, row.north_m) for row in one] == [(row.east_m, row.north_m) for row in other]
    (target,) = parse_scenario(text, "m.toml").simulation.targets
    assert (target.east_m, target.north_m) == (700.0, 900.0)


def test_check_prints_places_that_a_mission_file_takes(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(BORN)
    result = CliRunner().invoke(app, ["check", str(tmp_path / "m.toml")], env={"COLUMNS": "140"})
    assert result.exit_code == 0, result.output
    (agent, birth) = re.findall(r"(-?[\d.]+)°, (-?[\d.]+)° \(east", result.output)
    text = BORN
    for (east, north), (lat, lon) in (((100.0, 100.0), agent), ((700.0, 900.0), birth)):
        text = text.replace(f"east_m = {east}\nnorth_m = {north}", f"lat_deg = {lat}\nlon_deg = {lon}")
    again = parse(text, "m.toml")
    assert again.agents[0].east_m == pytest.approx(100.0, abs=0.02)
    assert again.births[0].north_m == pytest.approx(900.0, abs=0.02)


@pytest.mark.parametrize(
    ("place", "key", "words"),
    [
        ("lat_deg = 33.001", "agents[0]", "the key `lon_deg` is missing"),
        ("lon_deg = -87.0", "agents[0]", "the key `lat_deg` is missing"),
        (
            "lat_deg = 33.001\nlon_deg = -87.0\neast_m = 1.0",
            "agents[0]",
            "got east_m and lat_deg and lon_deg",
        ),
        ("lat_deg = 33.001\nnorth_m = 1.0", "agents[0]", "expected either"),
        ("lat_deg = 133.0\nlon_deg = -87.0", "agents[0].lat_deg", "<= 90"),
        ('lat_deg = "33 N"\nlon_deg = -87.0', "agents[0].lat_deg", "a number"),
        ("lat_deg = -87.0\nlon_deg = 33.0", "agents[0]", "swapped?"),
        ("lat_deg = -33.0\nlon_deg = 93.0", "agents[0]", "swapped?"),
        ("lat_deg = nan\nlon_deg = -87.0", "agents[0].lat_deg", ""),
        ("lat_deg = 33.5\nlon_deg = -87.0", "agents[0]", "outside the map"),
    ],
)
def test_a_place_given_wrongly_is_named(place: str, key: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(GOOD.replace("east_m = 100.0\nnorth_m = 100.0", place), "m.toml")
    assert caught.value.key == key
    assert words in str(caught.value)


def test_a_target_of_the_simulation_given_in_both_ways_is_named() -> None:
    text = GOOD + SIMULATED.replace("east_m = 700.0", "east_m = 700.0\nlat_deg = 33.0")
    with pytest.raises(ConfigError) as caught:
        parse_scenario(text, "m.toml")
    assert caught.value.key == "simulation.targets[0]"


def test_every_mistake_is_listed_with_a_proposal_for_what_is_misspelt() -> None:
    text = """
name = "bad name"
[frame]
lat_deg = 95.0
lon_deg = 8.0
[map]
widht_m = 2000.0
[[agents]]
system_id = 300
east_m = 1.0
north_m = "x"
[planning]
clearance_m = -3
"""
    with pytest.raises(ConfigError) as refused:
        parse(text, "m.toml")
    lines = str(refused.value).splitlines()
    assert lines[0] == "m.toml: 7 mistakes:"
    assert "  map: unknown key `widht_m`: did you mean `width_m`?" in lines
    for key in (
        "name: ",
        "frame: ",
        "frame.lat_deg: ",
        "agents[0].system_id: ",
        "agents[0].north_m: ",
        "planning",
    ):
        assert any(line.startswith(f"  {key}") for line in lines), key


def test_every_contradiction_is_listed() -> None:
    text, _ = read_text("prescribed")
    text = text.replace("system_id = 2", "system_id = 1").replace("system_id = 3", "system_id = 1")
    with pytest.raises(ConfigError, match="2 mistakes") as refused:
        parse(text, "m.toml")
    assert "agents[1].system_id" in str(refused.value)
    assert "agents[2].system_id" in str(refused.value)


PLACES = """
name = "x"
[frame]
lat_deg = 47.0
lon_deg = 8.0
alt_msl_m = 400.0
[[agents]]
system_id = 300
lat_deg = 95.0
lon_deg = 190.0
[[agents]]
system_id = 2
lat_deg = 8.0
lon_deg = 47.0
[[births]]
lat_deg = 47.0
east_m = 3.0
[planning]
clearance_m = -3
"""


def test_mistakes_of_places_in_degrees_are_listed_with_all_others() -> None:
    with pytest.raises(ConfigError) as refused:
        parse(PLACES, "m.toml")
    lines = [line.strip() for line in str(refused.value).splitlines()]
    for begin in (
        "agents[0].lat_deg: ",
        "agents[0].lon_deg: ",
        "agents[0].system_id: ",
        "agents[1]: 8.0°, 47.0° lies far",
        "births[0]: expected either",
        "planning.clearance_m: ",
    ):
        assert any(line.startswith(begin) for line in lines), (begin, lines)
    with pytest.raises(ConfigError) as refused:
        parse(PLACES.replace("lat_deg = 47.0\nlon_deg = 8.0", "lat_deg = 99.0\nlon_deg = 8.0"), "m.toml")
    assert "frame.lat_deg: " in str(refused.value)
    assert "agents[0].lat_deg: " in str(refused.value)


@pytest.mark.parametrize(
    ("text", "result"),
    [
        ('name = "x"\n[frame]\nlat_deg = 47,0\n', "(at line 3, column 13): `lat_deg = 47,0`"),
        ("name = 1\nname = 2\nx = 3", "the key is there twice (at line 2, column 9): `name = 2`"),
        ('name = "x\n', 'expected a closing quote before the line ends (at line 1, column 10): `name = "x`'),
        ("[frame\n", "Expected ']' at the end of a table declaration (at line 1, column 7): `[frame`"),
        ("a = [1,\n2", "Unclosed array (at end of document): `2`"),
    ],
)
def test_broken_toml_is_shown_with_its_line(text: str, result: str) -> None:
    with pytest.raises(ConfigError) as refused:
        parse(text, "m.toml")
    assert result in str(refused.value)
    assert "not valid TOML: " in str(refused.value)


@pytest.mark.parametrize(
    ("old", "hint"),
    [
        ("[mission]\nlane_step_m = 20.0", "did you mean `layer_step_m`?"),
        ("[mission]\nlanes = 2", "did you mean `layers`?"),
        ("[tracking]\ndead_existence = 0.01", "did you mean `lost_existence`?"),
        ("[tracking.agents]\naccel_std_m_s2 = 4.0", "Its value is the square of the former one"),
    ],
)
def test_a_renamed_key_is_refused_with_its_new_name(old, hint):
    with pytest.raises(ConfigError) as refused:
        parse(f'name = "x"\n[frame]\nlat_deg = 33.2\nlon_deg = -87.6\nalt_msl_m = 70.0\n{old}\n', "x.toml")
    assert hint in str(refused.value)


@pytest.mark.parametrize(
    ("links", "key", "words"),
    [
        ('zenoh = "tcp/0.0.0.0:7447"', "links.zenoh", "lets every program on that network command"),
        ('zenoh = "tcp/10.0.0.5:7447"\nzenoh_role = "connect"', "links.zenoh", "expected tls/HOST:PORT"),
        ('zenoh = "udp/[::]:7447"', "links.zenoh", "zenoh_unprotected = true"),
        ('zenoh = "tls/0.0.0.0:7447"', "links.zenoh_tls", "gcs keys node"),
        ('zenoh_tls = "hub"', "links.zenoh", "would not use links.zenoh_tls"),
    ],
)
def test_an_endpoint_that_other_machines_reach_without_certificates_is_refused(
    links: str, key: str, words: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        parse(f"{GOOD}\n[links]\n{links}\n", "mission.toml")
    assert caught.value.key == key
    assert words in caught.value.expected


@pytest.mark.parametrize(
    "links",
    [
        'zenoh = "tcp/127.0.0.1:7447"',
        'zenoh = "tcp/[::1]:7447"',
        'zenoh = "tcp/localhost:7447"',
        'zenoh = "tcp/0.0.0.0:7447"\nzenoh_unprotected = true',
        'zenoh = "tls/0.0.0.0:7447"\nzenoh_tls = "hub"',
    ],
)
def test_a_protected_endpoint_or_one_of_this_machine_needs_no_word(links: str) -> None:
    config = parse(f"{GOOD}\n[links]\n{links}\n", "missions/mission.toml")
    folder = config.links.tls_folder("missions/mission.toml")
    assert folder == (Path("missions/hub") if config.links.zenoh_tls else None)


def test_the_check_warns_of_an_unprotected_endpoint(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_text(f'{GOOD}\n[links]\nzenoh = "tcp/0.0.0.0:7447"\nzenoh_unprotected = true\n')
    done = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["check", str(path)])
    assert done.exit_code == 0
    assert "every program that reaches tcp/0.0.0.0:7447 may command the vehicles" in done.output


def test_the_check_shows_what_a_link_is_for_and_whether_it_is_signed(tmp_path: Path) -> None:
    radio = '{ endpoint = "serial:/dev/ttyUSB0", redundant = true }'
    receiver = '{ endpoint = "udpin:0.0.0.0:14560", traffic = true }'
    for keys, signing in (('keys = "keys.toml"', "keys of keys.toml"), ("", "none")):
        path = tmp_path / "mission.toml"
        path.write_text(f"{GOOD}\n[links]\nmavlink = [{radio}, {receiver}]\n{keys}\n")
        done = CliRunner(env={"COLUMNS": "200"}).invoke(app, ["check", str(path)])
        assert "serial:/dev/ttyUSB0:57600: vehicles, a second link of vehicles" in done.output
        assert "udpin:0.0.0.0:14560: vehicles, receivers of other aircraft" in done.output
        assert re.search(rf"signing +│ {signing} ", done.output)


def test_the_altitude_of_a_mission_may_be_above_mean_sea_level() -> None:
    given = parse(GOOD + "[mission]\naltitude_msl_m = 150.0\n", "here.toml")
    assert given.mission.altitude_rel_m == 80.0
    for wrong in ("altitude_msl_m = 70.0", "altitude_msl_m = 150.0\naltitude_rel_m = 80.0"):
        with pytest.raises(ConfigError, match="altitude"):
            parse(f"{GOOD}[mission]\n{wrong}\n", "here.toml")
