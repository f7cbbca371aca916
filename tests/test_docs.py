"""A reader would type a command, set a key or follow a link of the documentation that does not exist."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest
import typer
from helpers.documented_files import write_documented_files
from helpers.pages import COMMAND, FENCE, ROOT, SAVED, blocks, shown_commands, text_of, words_of
from typer.testing import CliRunner

from gcs.cli import app as gcs
from gcs.config import Config, Table, parse
from gcs.io.signing.keystore import read_keys
from gcs.mavlink.autopilots import ARDUPLANE, PX4, AutopilotProfile
from sim_vehicles.cli import app as sim_vehicles
from sim_vehicles.world.scenario import Simulation, parse_scenario

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
APPS = {"gcs": typer.main.get_command(gcs), "sim-vehicles": typer.main.get_command(sim_vehicles)}
SPAN = re.compile(r"`([^`]+)`")

SMOKE = "first-demo"
"""Page whose commands are run by `pytest` alone, too; those of all by `pytest -m real_time`."""
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))


def spans(page: Path) -> list[str]:
    """Return the inline code of a page."""
    return [" ".join(span.split()) for span in SPAN.findall(FENCE.sub("", text_of(page)))]


def command_of(words: list[str]) -> tuple[Any, Any, list[str]]:
    """Return the command that the first words name, its context, and the other words."""
    command, rest = APPS[words[0]], words[1:]
    context = command.context_class(command, info_name=words[0])
    while hasattr(command, "resolve_command"):
        name, command, rest = command.resolve_command(context, rest)
        context = command.context_class(command, parent=context, info_name=name)
    return command, context, rest


def check_call(line: str) -> None:
    """Raise a usage error for a command that the command line would refuse. Files need not exist."""
    command, context, rest = command_of(words_of(line))
    values, extra, _ = command.make_parser(context).parse_args(rest)
    assert not extra, f"{line}: unexpected {extra}"
    for param in command.params:
        try:
            param.handle_parse_result(context, values, [])
        except Exception as error:
            if "does not exist" not in str(error):
                raise


def options_of(words: list[str]) -> set[str]:
    """Return the options of a command, or of all commands below a group or an unfinished name."""
    command = APPS[words[0]]
    for word in words[1:]:
        if not hasattr(command, "commands") or word not in command.commands:
            break
        command = loaded(words[0], command, word)
    params = [param for one in leaves(words[0], command) for param in one.params]
    return {"-h", "--help"} | {opt for param in params for opt in [*param.opts, *param.secondary_opts]}


def loaded(program: str, group: Any, name: str) -> Any:
    return group.resolve_command(group.context_class(group, info_name=program), [name])[1]


def leaves(program: str, command: Any) -> Iterator[Any]:
    if not hasattr(command, "commands"):
        yield command
        return
    yield command
    for name in command.commands:
        yield from leaves(program, loaded(program, command, name))


@each_page
def test_every_command_in_a_code_block_is_accepted_by_the_command_line(page: Path) -> None:
    for line in shown_commands(page):
        check_call(line)


def test_commands_are_found_in_fenced_and_indented_blocks() -> None:
    assert len(shown_commands(ROOT / "docs" / "field-guide.md")) > 20
    assert len(shown_commands(ROOT / "docs" / "recordings.md")) >= 7
    assert "gcs demo" in shown_commands(ROOT / "README.md")


NEEDS_A_SERVICE = "needs a running service; tests/system/test_tutorials.py and test_guides.py"
NEEDS_VEHICLES = "needs vehicles, or their autopilot on a cable"
NOT_RUN = {
    "gcs demo": "flies for minutes; tests/system",
    "gcs montecarlo": "flies for minutes; tests/sim_vehicles/campaign",
    "gcs simulate random-targets": "flies for minutes of virtual time; a shorter one is run",
    "gcs warm-up": "compiles all kernels; tests/conftest.py",
    "gcs run": "serves until it is interrupted; tests/service",
    "gcs console": NEEDS_A_SERVICE,
    "gcs metrics": NEEDS_A_SERVICE,
    "gcs tak": NEEDS_A_SERVICE,
    "gcs foxglove": NEEDS_A_SERVICE,
    "gcs status": NEEDS_A_SERVICE,
    "gcs order": NEEDS_A_SERVICE,
    "gcs preflight": NEEDS_VEHICLES,
    "gcs fence": NEEDS_VEHICLES,
    "gcs param": NEEDS_VEHICLES,
    "gcs init --listen": NEEDS_VEHICLES,
    "gcs keys install": NEEDS_VEHICLES,
    "gcs keys rotate": NEEDS_VEHICLES,
    "gcs replay flight.tlog": "needs detections of the same flight; tests/cli/test_foreign.py",
    "sim-vehicles": "serves until it is interrupted; tests/sim_vehicles",
}
"""Commands of the documentation that only have to be accepted by the command line, and why."""


def run_commands(page: Path) -> list[str]:
    return [line for line in shown_commands(page) if not line.startswith(tuple(NOT_RUN))]


@pytest.fixture(scope="module")
def documented_files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("documented")
    write_documented_files(folder)
    return folder


@pytest.mark.timeout(300)  # many commands, each as long as a test
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=() if page.stem == SMOKE else pytest.mark.real_time)
        for page in PAGES
        if run_commands(page)
    ],
    ids=lambda page: page.stem,
)
def test_the_commands_of_a_page_succeed_one_after_another(
    page: Path, documented_files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder with the files that the page names; a block of Python or TOML "Save ... as" is saved."""
    shutil.copytree(documented_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for name, language, text in SAVED.findall(text_of(page)):
        (tmp_path / name).write_text(text)
        if language == "python":
            run(text, name)
    for line in run_commands(page):
        words = words_of(line)[1:]
        if words[0] == "init":  # it replaces no file, and the guide has two sources of the same name
            Path(words[1]).with_suffix(".toml").unlink(missing_ok=True)
        done = CliRunner().invoke(gcs, words)
        assert done.exit_code == 0, f"{line}: {done.output}"


def test_each_reason_not_to_run_a_command_is_one_of_a_command_that_is_shown() -> None:
    shown = [line for page in PAGES for line in shown_commands(page)]
    assert [start for start in NOT_RUN if not any(line.startswith(start) for line in shown)] == []


def test_no_code_block_is_in_a_language_that_nothing_checks() -> None:
    found = {language for page in PAGES for language, _ in FENCE.findall(text_of(page))}
    assert found <= {"", "python", "toml", "json", "mermaid"}


@each_page
def test_every_block_of_json_is_read(page: Path) -> None:
    for block in blocks(page, "json"):
        json.loads(block)


@pytest.mark.parametrize(
    ("profile", "names"),
    [
        (ARDUPLANE, {"FS_GCS_ENABL", "FS_LONG_ACTN", "FENCE_ENABLE", "RTL_ALTITUDE"}),
        (PX4, {"MIS_TKO_LAND_REQ", "NAV_DLL_ACT", "GF_ACTION", "RTL_RETURN_ALT"}),
    ],
    ids=["ArduPlane", "PX4"],
)
def test_the_guide_has_the_parameters_of_each_firmware_to_copy(
    profile: AutopilotProfile, names: set[str]
) -> None:
    guide = blocks(ROOT / "docs" / "field-guide.md", "")
    (given,) = [found for block in guide if names <= (found := dict(parameters_in(block))).keys()]
    wanted = {name: one for one in profile.parameters for name in one.names}
    refused = [name for name, value in given.items() if name in wanted and not wanted[name].accepts(value)]
    assert refused == []


def parameters_in(block: str) -> Iterator[tuple[str, float]]:
    for line in block.splitlines():
        if line.startswith("gcs param set CONFIG "):
            _, _, _, _, name, value, *_ = words_of(line)
            yield name, float(value)


@pytest.mark.parametrize(
    "line",
    [
        "gcs fly prescribed",
        "gcs demo --sped 8",
        "gcs demo --speed fast",
        "gcs run",
        "gcs order hold --every",
        "gcs track set.npz --estimator best",
        "sim-vehicles world CONFIG --links tcp:127.0.0.1:5762",
    ],
)
def test_a_wrong_command_is_noticed(line: str) -> None:
    with pytest.raises((Exception, SystemExit)):
        check_call(line)


@each_page
def test_every_command_named_in_the_text_exists_with_its_options(page: Path) -> None:
    wrong = []
    for span in spans(page):
        words = span.replace("\\|", " ").replace("|", " ").split()
        if COMMAND.match(span):
            known = options_of(words)
            first = words[1]
            if first not in APPS[words[0]].commands:
                wrong.append(span)
        elif span.startswith("--") and span != "--":
            known = EVERY_OPTION
        else:
            continue
        wrong += [f"{span}: {word}" for word in words if re.match("--?[a-z]", word) and word not in known]
    assert wrong == []


SCRIPTS = [*(ROOT / "tests" / "bench").glob("*.py"), ROOT / "tests" / "recordings" / "renew.py"]
EVERY_OPTION = {"--release", "--install-completion", "--show-completion"}.union(
    *(options_of([program]) for program in APPS),
    *(re.findall(r'"(--[a-z-]+)"', text_of(script)) for script in SCRIPTS),
)


@each_page
def test_every_benchmark_named_exists_with_its_options(page: Path) -> None:
    for span in [*spans(page), *(line for block in blocks(page, "") for line in block.splitlines())]:
        match = re.match(r"(?:python )?((?:tests/[\w/]*)?bench_\w+\.py|tests/[\w/]+\.py)(.*)", span.strip())
        if match is None:
            continue
        path = ROOT / match[1] if "/" in match[1] else ROOT / "tests" / "bench" / match[1]
        assert path.is_file(), span
        for option in re.findall(r"(?<=\s)--[a-z-]+", match[2].partition(" # ")[0]):
            assert f'"{option}"' in path.read_text(encoding="utf-8"), f"{span}: {option}"


@each_page
def test_every_link_and_anchor_exists(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text_of(page))):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        assert path.exists(), target
        if anchor:
            assert anchor in anchors(path), target


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, formed as GitHub forms them."""
    titles = re.findall(r"^#+ (.*)$", FENCE.sub("", text_of(page)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@each_page
def test_every_path_of_the_project_named_exists(page: Path) -> None:
    for span in spans(page):
        if re.fullmatch(r"(gcs|sim_vehicles|tests|docs|config)/[\w./-]*", span):
            assert (ROOT / span).exists(), span


def tables(struct: type[Table], path: str) -> dict[str, set[str]]:
    """Map the path of each table of a mission file to its keys."""
    found = {path: {field.encode_name for field in msgspec.structs.fields(struct)}}
    for field in msgspec.structs.fields(struct):
        outer = [field.type, *get_args(field.type)]
        for part in [*outer, *(inner for kind in outer for inner in get_args(kind))]:
            if isinstance(part, type) and issubclass(part, Table):
                found |= tables(part, f"{path}.{field.encode_name}".lstrip("."))
    return found


TABLES = {**tables(Config, ""), **tables(Simulation, "simulation")}
PLACES = {"agents", "births", "simulation.targets"}
TABLES |= {path: TABLES[path] | {"lat_deg", "lon_deg"} for path in PLACES}
PATHS = {f"{path}.{key}".lstrip(".") for path, keys in TABLES.items() for key in keys}
BY_NAME = {"airframes"}
"""Tables of tables with names of the user's own."""
OTHER_TOML = {
    "tracking.md": "the trackers' model; tests/tracking/test_tracking_page.py",
    "own-detections.md": "the trackers' model; a command of the page reads it",
    "signing.md": "the key file",
}


def keys_of(value: Any, path: str) -> Iterator[str]:
    """Return the paths of all keys of a table that TOML has read."""
    for key, inner in value.items():
        name = f"{path}.{key}".lstrip(".")
        yield name
        if name in BY_NAME:
            inner = list(inner.values())
        for part in inner if isinstance(inner, list) else [inner]:
            if isinstance(part, dict) and name in TABLES:
                yield from keys_of(part, name)


@each_page
def test_every_key_of_a_mission_file_is_one(page: Path) -> None:
    named = set()
    if page.name not in OTHER_TOML:
        for block in blocks(page, "toml"):
            named |= set(keys_of(tomllib.loads(re.sub(r"^# (?=\w+ = )", "", block, flags=re.MULTILINE)), ""))
    for span in spans(page):
        table = re.fullmatch(r"\[\[?([a-z_.]+)\]\]?(?: ([a-z_0-9]+)(?: = .*)?)?", span)
        key = re.fullmatch(r"([a-z_]+)(?:\[\d*\])?\.([a-z_0-9.]+)(?: ?= ?.*)?", span)
        if table and not (page.name in OTHER_TOML and table[1] not in PATHS):
            named |= {".".join(part for part in table.groups() if part)}
        elif key and f"{key[1]}" in PATHS and key[2] != "toml":
            named |= {f"{key[1]}.{key[2]}"}
    assert named - PATHS == set()


@each_page
def test_every_whole_mission_file_is_read(page: Path) -> None:
    for block in blocks(page, "toml"):
        if {"name", "frame", "agents"} <= tomllib.loads(block).keys():
            parse(block, page.name)
            parse_scenario(block, page.name)


def test_the_key_file_of_the_signing_page_is_read(tmp_path: Path) -> None:
    (block,) = blocks(ROOT / "docs" / "signing.md", "toml")
    file = tmp_path / "keys.toml"
    file.write_text(re.sub(r'"(?:64 hex digits|\.\.\.)"', f'"{"5a" * 32}"', block))
    file.chmod(0o600)
    assert read_keys(file).keys


@pytest.mark.parametrize("key", ["planning.switch_gain", "tracking.targets.anywhere.rate", "fences"])
def test_a_wrong_key_is_noticed(key: str) -> None:
    assert key not in PATHS
    assert "planning.switch_gain_m" in PATHS
    assert "fence.areas.circle" in PATHS


def run(code: str, page: str) -> str:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile(code, page, "exec"), {})
    return printed.getvalue()


RUN_BY = {
    "README.md": "tests/test_docs.py",
    "console.md": "tests/console/test_programs.py",
    "library.md": "tests/test_library_page.py",
    "own-detections.md": "tests/test_docs.py",  # with its commands
    "recordings.md": "tests/test_docs.py",
    "security.md": "tests/io/zenoh/test_session.py",
    "sensors.md": "tests/io/zenoh/test_session.py",
    "tracking.md": "tests/tracking/test_tracking_page.py",
}
"""Pages with Python that needs files, a service or a vehicle, or whose output is compared: their tests."""


@each_page
def test_every_block_of_python_is_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if not blocks(page, "python"):
        return
    if page.name in RUN_BY:
        assert page.name in text_of(ROOT / RUN_BY[page.name])
        return
    for block in blocks(page, "python"):
        run(block, page.name)


def test_the_example_of_the_readme_tracks_a_data_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = blocks(ROOT / "README.md", "python")
    rows = [f"{k},{400 + 5 * k},-600" for k in range(1, 13)]
    (tmp_path / "set.csv").write_text("\n".join(["k,x,y", *rows]))
    monkeypatch.chdir(tmp_path)
    printed = run(code, "README.md")
    assert printed.startswith("(")
    last = re.search(r"\[ *(\S+) +(\S+) *\]\]\s*$", printed)
    assert last is not None, printed
    assert (float(last[1]), float(last[2])) == pytest.approx((460.0, -600.0), abs=5.0)


def test_the_example_of_the_recordings_page_lists_plans() -> None:
    (code,) = blocks(ROOT / "docs" / "recordings.md", "python")
    recording = ROOT / "tests" / "recordings" / "death.mcap"
    lines = run(code.replace('"runs/prescribed-1"', repr(str(recording))), "recordings.md").splitlines()
    assert lines
    assert "first plan" in lines[0]
