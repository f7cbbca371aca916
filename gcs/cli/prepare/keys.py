"""`gcs keys`: makes, shows, installs and rotates the keys that vehicles and ground stations sign with.

Exit codes: 0 done for all, 1 some vehicle did not take its key, 2 a mistake in the arguments or files.
"""

from __future__ import annotations

import json
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.markup import escape

from gcs.cli.errors import complain
from gcs.errors import ConfigError, GcsError
from gcs.io.console import console_for

if TYPE_CHECKING:
    from gcs.io.signing.keystore import KeyFile
    from gcs.io.signing.provisioning import Result, Wanted

app = typer.Typer(
    help="""Keys for MAVLink 2 signing: vehicles obey, and are believed, by their key alone.

    First **new**, then **install** over a cable, then `keys = "keys.toml"` under `[links]` of the mission
    file. No command prints a key unless it is told to.""",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

FileArgument = Annotated[Path, typer.Argument(help="The key file, such as keys.toml.", metavar="FILE")]
EndpointArgument = Annotated[
    str,
    typer.Argument(
        help="Where the vehicles are heard now: serial:/dev/ttyACM0:115200, udpin:0.0.0.0:14550.",
        metavar="ENDPOINT",
    ),
]
VehicleOption = Annotated[
    list[str] | None,
    typer.Option("--vehicle", "-v", help="System id (2:3 on network 2); repeat it for more."),
]
YesOption = Annotated[bool, typer.Option("--yes", help="Do not ask whether the link is secure.")]
TimeoutOption = Annotated[float, typer.Option(min=0.5, help="Seconds to try.")]
JsonOption = Annotated[bool, typer.Option("--json", help="End with one JSON object on its own line.")]


@app.command()
def new(
    file: FileArgument,
    vehicle: VehicleOption = None,
    link: Annotated[
        list[str] | None,
        typer.Option(help="An endpoint of the mission file: one key for all who are there."),
    ] = None,
    passphrase: Annotated[
        bool, typer.Option("--passphrase", help="Ask for words: Mission Planner and MAVProxy can use them.")
    ] = False,
) -> None:
    """Make keys and write them to a file that only you can read.

    Without `--vehicle` or `--link`: one key for all vehicles. A key that is there already stays: `rotate`
    replaces it.
    """
    console = console_for(stderr=True)
    try:
        keys = _read_or_begin(file)
        vehicles, links = _vehicles(vehicle), _endpoints(link)
        there = [_name(v) for v in vehicles if v in keys.vehicles] + [n for n in links if n in keys.links]
        if not vehicles and not links and keys.default is not None:
            there = ["all vehicles"]
        if there:
            problem = f"there is a key for {', '.join(there)}; gcs keys rotate replaces it"
            raise ConfigError(str(file), "", problem)
        words = _ask_words(console) if passphrase else None
        keys.vehicles |= {v: _make(words) for v in vehicles}
        keys.links |= {name: _make(words) for name in links}
        if not vehicles and not links:
            keys.default = _make(words)
        keys.save()
    except GcsError as error:
        _fail(console, error)
    _print(keys, secret=False)
    console.print(
        f"written to {file}, for you alone. Next: gcs keys install {file} ENDPOINT", highlight=False
    )


@app.command()
def show(
    file: FileArgument,
    secret: Annotated[
        bool, typer.Option("--secret", help="Print the keys themselves, to enter them elsewhere.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List whose keys a file holds, each by its fingerprint."""
    from gcs.io.signing.keystore import read_keys

    try:
        keys = read_keys(file)
    except GcsError as error:
        _fail(console_for(stderr=True), error)
    if as_json:
        print(json.dumps({"keys": _rows(keys, secret=secret)}))  # noqa: T201  the promised line
    else:
        _print(keys, secret=secret)


@app.command()
def install(
    file: FileArgument,
    endpoint: EndpointArgument,
    vehicle: VehicleOption = None,
    yes: YesOption = False,
    timeout: TimeoutOption = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Give vehicles the keys that the file holds for them, and prove that they use them.

    Vehicles must be disarmed, on a link that nobody else hears: the key goes over it in the clear. Without
    `--vehicle`: all vehicles with a key of their own.
    """
    from gcs.io.signing.keystore import read_keys
    from gcs.io.signing.provisioning import Wanted

    console = console_for(stderr=True)
    try:
        keys = read_keys(file)
        vehicles = _vehicles(vehicle) or sorted(keys.vehicles)
        if not vehicles:
            raise ConfigError(str(file), "", "no vehicle has a key of its own: name some with --vehicle")
        waiting = [_name(v) for v in vehicles if v in keys.pending]
        if waiting:
            problem = f"gcs keys rotate was not finished for {', '.join(waiting)}: run it again"
            raise ConfigError(str(file), "pending", problem)
        wanted = [Wanted(v, _key_of(keys, v, endpoint), None) for v in vehicles]
        _confirm(console, endpoint, yes=yes)
        results = _install(keys, endpoint, wanted, timeout, console)
    except GcsError as error:
        _fail(console, error)
    _finish(results, as_json=as_json)


@app.command()
def rotate(
    file: FileArgument,
    endpoint: EndpointArgument,
    vehicle: VehicleOption = None,
    shared: Annotated[
        bool, typer.Option("--shared", help="One new key for all of them, as slow shared radios want it.")
    ] = False,
    yes: YesOption = False,
    timeout: TimeoutOption = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Give vehicles new keys in place of those that the file holds, and prove that they use them.

    Each new key is in the file before it goes out, and takes the old one's place when the vehicle has shown
    that it uses it. A rotation that breaks off is finished by the same command. Stop the service before, and
    start it after: it reads its keys once.
    """
    from gcs.io.signing.keystore import read_keys
    from gcs.io.signing.provisioning import Wanted

    console = console_for(stderr=True)
    try:
        keys = read_keys(file)
        vehicles = _vehicles(vehicle) or sorted(keys.vehicles)
        if not vehicles:
            raise ConfigError(str(file), "", "no vehicle has a key of its own: name some with --vehicle")
        old = {v: _key_of(keys, v, endpoint) for v in vehicles}
        _confirm(console, endpoint, yes=yes)
        common = secrets.token_bytes(32)
        for one in vehicles:
            keys.pending.setdefault(one, common if shared else secrets.token_bytes(32))
        keys.save()
        wanted = [Wanted(v, keys.pending[v], old[v]) for v in vehicles]
        results = _install(keys, endpoint, wanted, timeout, console)
    except GcsError as error:
        _fail(console, error)
    unsure = [_name(result.vehicle) for result in results if not result.ok]
    if unsure:
        text = (
            f"[bold yellow]not finished for {', '.join(unsure)}:[/] such a vehicle may hold either key, and "
        )
        console.print(text + "is not heard on signed links until the same command was run again.")
    _finish(results, as_json=as_json)


# ---------------------------------------------------------------- help


def _read_or_begin(file: Path) -> KeyFile:
    from gcs.io.signing.keystore import KeyFile, read_keys

    return read_keys(file) if file.exists() else KeyFile(file)


def _vehicles(names: list[str] | None) -> list[int]:
    from gcs.io.signing.keystore import vehicle_of

    found = []
    for name in names or []:
        vehicle = vehicle_of(name)
        if vehicle is None:
            raise ConfigError("--vehicle", name, "expected a system id from 1 to 250, or 2:3 on network 2")
        found.append(vehicle)
    return sorted(set(found))


def _endpoints(names: list[str] | None) -> list[str]:
    from gcs.endpoints import parse_endpoint

    return [str(parse_endpoint(name)) for name in names or []]


def _name(vehicle: int) -> str:
    from gcs.model import vehicle_name

    return f"vehicle {vehicle_name(vehicle)}"


def _ask_words(console: Console) -> str:
    console.print(
        "[yellow]Whoever has recorded signed traffic can try passphrases at leisure: take a long one.[/]"
    )
    words: str = typer.prompt("Passphrase", hide_input=True, confirmation_prompt=True, err=True)
    return words


def _make(words: str | None) -> bytes:
    from gcs.mavlink.frames.signing import passphrase_key

    return secrets.token_bytes(32) if words is None else passphrase_key(words)


def _key_of(keys: KeyFile, vehicle: int, endpoint: str) -> bytes:
    """Key that the file holds for a vehicle, whatever link it is given over."""
    key = keys.vehicles.get(vehicle) or keys.links.get(_endpoints([endpoint])[0]) or keys.default
    if key is None:
        problem = f"no key for {_name(vehicle)}: gcs keys new {keys.path} --vehicle ..."
        raise ConfigError(str(keys.path), "", problem)
    return key


def _confirm(console: Console, endpoint: str, *, yes: bool) -> None:
    console.print(
        f"[bold yellow]The key goes over {escape(endpoint)} in the clear.[/] Whoever listens there can "
        "command the vehicle from then on. Use a cable, or a network that nobody else hears.",
        highlight=False,
    )
    if yes:
        return
    if not sys.stdin.isatty():
        raise ConfigError(
            "gcs keys", "", "nobody is there to ask whether the link is secure: say so by --yes"
        )
    if not typer.confirm("Is it such a link?", err=True):
        raise ConfigError("gcs keys", "", "no key was sent")


def _install(
    keys: KeyFile, endpoint: str, wanted: list[Wanted], timeout_s: float, console: Console
) -> list[Result]:
    from gcs.endpoints import parse_endpoint
    from gcs.io.signing.keystore import TimeFile
    from gcs.io.signing.provisioning import install as install_keys

    results: list[Result] = []

    def settle(result: Result) -> None:
        results.append(result)
        if result.ok and result.vehicle in keys.pending:
            keys.vehicles[result.vehicle] = keys.pending.pop(result.vehicle)
            keys.save()
        style, word = ("green", "done") if result.ok else ("bold red", "failed")
        text = f"{_name(result.vehicle)}: [{style}]{word}[/]: {escape(result.detail)}"
        console.print(text, highlight=False)

    with console.status(f"waiting for {len(wanted)} vehicles on {escape(endpoint)}"):
        try:
            where, times = parse_endpoint(endpoint), TimeFile(keys.path)
            install_keys(
                where, wanted, times, timeout_s, settle, lambda text: console.print(text, highlight=False)
            )
        except OSError as error:
            raise ConfigError(str(keys.path), "", f"cannot keep the time beside it: {error}") from None
        except KeyboardInterrupt:
            console.print("interrupted", highlight=False)
            raise typer.Exit(130) from None
    return sorted(results, key=lambda result: result.vehicle)


def _finish(results: list[Result], *, as_json: bool) -> None:
    if as_json:
        rows = [{"vehicle": r.vehicle, "ok": r.ok, "detail": r.detail, "sent": r.sent} for r in results]
        print(json.dumps({"vehicles": rows}))  # noqa: T201  the promised line
    raise typer.Exit(0 if all(result.ok for result in results) else 1)


def _rows(keys: KeyFile, *, secret: bool) -> list[dict[str, str]]:
    from gcs.mavlink.frames.signing import fingerprint

    named = [("all vehicles", keys.default, "")] if keys.default is not None else []
    named += [(name, key, "") for name, key in keys.links.items()]
    named += [(_name(v), key, "") for v, key in sorted(keys.vehicles.items())]
    named += [(_name(v), key, "on its way") for v, key in sorted(keys.pending.items())]
    return [
        {"of": name, "fingerprint": fingerprint(key), "state": state} | ({"key": key.hex()} if secret else {})
        for name, key, state in named
        if key is not None
    ]


def _print(keys: KeyFile, *, secret: bool) -> None:
    rows = _rows(keys, secret=secret)
    width = max((len(row["of"]) for row in rows), default=0)
    for row in rows:
        line = f"{row['of']:<{width}}  {row['fingerprint']}  {row.get('key', '')}  {row['state']}"
        console_for().print(line.rstrip(), highlight=False, markup=False, soft_wrap=True)


def _fail(console: Console, error: GcsError) -> NoReturn:
    raise typer.Exit(complain(error, console)) from None
