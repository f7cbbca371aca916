"""`gcs keys`: make, show, install and rotate the keys for MAVLink 2 signing; certificates for zenoh.

Exit codes: 0 done for all vehicles; 1 a vehicle did not accept its key; 2 a mistake in the arguments or
files.
"""

from __future__ import annotations

import json
import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape

from gcs.cli.arguments import JsonOption, VehicleOption, command_app
from gcs.cli.errors import exit_on_error
from gcs.cli.prepare.node_certificates import make_ca, make_node_certificate
from gcs.errors import ConfigError, GcsError
from gcs.io.terminal import console_for
from gcs.mistake_codes import MistakeCode

if TYPE_CHECKING:
    from gcs.io.signing.keystore import KeyFile
    from gcs.io.signing.provisioning import KeyInstallation, Result

app = command_app("""Make keys for MAVLink 2 signing, and certificates for zenoh.

    **Vehicles** (new, show, install, rotate). With a key, a vehicle obeys only signed commands, and central
    command accepts only its signed reports. First **new**, then **install** over a cable, then `keys =
    "keys.toml"` under `[links]` of the mission file. Keys are printed only by `show --secret`.

    **zenoh** (ca, node). With a certificate, a sensor, operator or other program may connect from another
    machine, and do what its role allows. First **ca**, then **node** for each.""")

FileArgument = Annotated[Path, typer.Argument(help="The key file, such as keys.toml.", metavar="FILE")]
EndpointArgument = Annotated[
    str,
    typer.Argument(
        help="Link to the vehicles, such as serial:/dev/ttyACM0:115200 or udpin:0.0.0.0:14550.",
        metavar="ENDPOINT",
    ),
]
YesOption = Annotated[bool, typer.Option("--yes", help="Confirm that the link is secure; do not ask.")]
TimeoutOption = Annotated[float, typer.Option(min=0.5, help="Timeout in seconds.")]


@app.command(rich_help_panel="MAVLink 2 signing")
def new(
    file: FileArgument,
    vehicle: VehicleOption = None,
    link: Annotated[
        list[str] | None,
        typer.Option(help="Endpoint of the mission file. Its vehicles share one key. Can be repeated."),
    ] = None,
    passphrase: Annotated[
        bool,
        typer.Option(
            "--passphrase", help="Derive the key from a passphrase, as Mission Planner and MAVProxy do."
        ),
    ] = False,
) -> None:
    """Make keys and write them to a file that only you can read.

    Without `--vehicle` or `--link`: one key for all vehicles. An existing key is kept; `rotate` replaces it.
    """
    from gcs.io.signing.keystore import KeyFile, read_keys

    console = console_for(stderr=True)
    with exit_on_error():
        keys = read_keys(file) if file.exists() else KeyFile(file)
        vehicles = sorted({*(vehicle or ())})
        links = _endpoints(link)
        there = [_name(v) for v in vehicles if v in keys.vehicles] + [n for n in links if n in keys.links]
        if not vehicles and not links and keys.default is not None:
            there = ["all vehicles"]
        if there:
            problem = f"there is a key for {', '.join(there)}; gcs keys rotate replaces it"
            raise ConfigError(str(file), "", MistakeCode.EXISTS, problem)
        phrase = _ask_passphrase(console) if passphrase else None
        keys.vehicles |= {v: _make_key(phrase) for v in vehicles}
        keys.links |= {name: _make_key(phrase) for name in links}
        if not vehicles and not links:
            keys.default = _make_key(phrase)
        keys.save()
    _print(keys, secret=False)
    named = "" if keys.vehicles else " -v ID"
    console.print(
        f"written to {file}, for you alone. Next: gcs keys install {file} ENDPOINT{named}", highlight=False
    )


@app.command(rich_help_panel="MAVLink 2 signing")
def show(
    file: FileArgument,
    secret: Annotated[
        bool, typer.Option("--secret", help="Print the keys as well, to enter them in other programs.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """List the keys of a file by their fingerprints."""
    from gcs.io.signing.keystore import read_keys

    with exit_on_error(as_json=as_json):
        keys = read_keys(file)
    if as_json:
        print(json.dumps({"keys": _rows(keys, secret=secret)}))  # noqa: T201  the output of --json
    else:
        _print(keys, secret=secret)


@app.command(rich_help_panel="MAVLink 2 signing")
def install(
    file: FileArgument,
    endpoint: EndpointArgument,
    vehicle: VehicleOption = None,
    yes: YesOption = False,
    timeout: TimeoutOption = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Send vehicles their keys from the file, and check that they sign with them.

    Keys are sent unencrypted: use a link that no one else can hear. Vehicles must be disarmed. Without
    `--vehicle`: all vehicles with a key of their own.
    """
    from gcs.io.signing.provisioning import KeyInstallation

    console = console_for(stderr=True)
    with exit_on_error(as_json=as_json):
        keys, vehicles = _keys_and_vehicles(file, vehicle)
        waiting = [_name(v) for v in vehicles if v in keys.pending]
        if waiting:
            problem = f"gcs keys rotate was not finished for {', '.join(waiting)}: run it again"
            raise ConfigError(str(file), "pending", MistakeCode.CONFLICT, problem)
        wanted = [KeyInstallation(v, _key_of(keys, v, endpoint), None) for v in vehicles]
        _confirm(console, endpoint, yes=yes)
        results = _install(keys, endpoint, wanted, timeout, console)
    _finish(results, as_json=as_json)


@app.command(rich_help_panel="MAVLink 2 signing")
def rotate(
    file: FileArgument,
    endpoint: EndpointArgument,
    vehicle: VehicleOption = None,
    shared: Annotated[
        bool, typer.Option("--shared", help="Use one new key for all, for a slow shared radio.")
    ] = False,
    yes: YesOption = False,
    timeout: TimeoutOption = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Send vehicles new keys in place of those in the file, and check that they sign with them.

    A new key is saved before it is sent, and replaces the old one when the vehicle signs with it. The same
    command finishes an interrupted rotation. Stop the service first and start it afterwards: it reads its
    keys once.
    """
    from gcs.io.signing.provisioning import KeyInstallation

    console = console_for(stderr=True)
    with exit_on_error(as_json=as_json):
        keys, vehicles = _keys_and_vehicles(file, vehicle)
        old = {v: _key_of(keys, v, endpoint) for v in vehicles}
        _confirm(console, endpoint, yes=yes)
        new = {v for v in vehicles if v not in keys.pending}
        common = secrets.token_bytes(32)
        for one in vehicles:
            keys.pending.setdefault(one, common if shared else secrets.token_bytes(32))
        keys.save()
        wanted = [KeyInstallation(v, keys.pending[v], old[v]) for v in vehicles]
        results = _install(keys, endpoint, wanted, timeout, console)
        for result in results:
            if result.vehicle in new and not (result.ok or result.sent):
                del keys.pending[result.vehicle]  # no vehicle has this key
        keys.save()
    unsure = [_name(result.vehicle) for result in results if result.vehicle in keys.pending]
    if unsure:
        console.print(
            f"[bold yellow]not finished for {', '.join(unsure)}:[/] such a vehicle may have either key. "
            "Run the same command again; until then signed links reject its frames."
        )
    _finish(results, as_json=as_json)


app.command("ca", rich_help_panel="zenoh")(make_ca)
app.command("node", rich_help_panel="zenoh")(make_node_certificate)


def _keys_and_vehicles(file: Path, vehicles: list[int] | None) -> tuple[KeyFile, list[int]]:
    """Return the keys of a file, and the named vehicles or all with a key of their own."""
    from gcs.io.signing.keystore import read_keys

    keys = read_keys(file)
    chosen = sorted((vehicles and {*vehicles}) or keys.vehicles)
    if not chosen:
        raise ConfigError(
            str(file),
            "",
            MistakeCode.MISSING_KEY,
            "no vehicle has a key of its own: name some with --vehicle",
        )
    return keys, chosen


def _endpoints(names: list[str] | None) -> list[str]:
    from gcs.endpoints import parse_endpoint

    return [str(parse_endpoint(name)) for name in names or []]


def _name(vehicle: int) -> str:
    from gcs.model import vehicle_name

    return f"vehicle {vehicle_name(vehicle)}"


def _ask_passphrase(console: Console) -> str:
    console.print(
        "[yellow]Recorded signed traffic allows an attacker to guess passphrases: use a long one.[/]"
    )
    phrase: str = typer.prompt("Passphrase", hide_input=True, confirmation_prompt=True, err=True)
    return phrase


def _make_key(phrase: str | None) -> bytes:
    from gcs.mavlink.frames.signing import passphrase_key

    return secrets.token_bytes(32) if phrase is None else passphrase_key(phrase)


def _key_of(keys: KeyFile, vehicle: int, endpoint: str) -> bytes:
    """Return the key of a vehicle in the file."""
    key = keys.vehicles.get(vehicle) or keys.links.get(_endpoints([endpoint])[0]) or keys.default
    if key is None:
        problem = f"no key for {_name(vehicle)}: gcs keys new {keys.path} --vehicle ..."
        raise ConfigError(str(keys.path), "", MistakeCode.MISSING_KEY, problem)
    return key


def _confirm(console: Console, endpoint: str, *, yes: bool) -> None:
    console.print(
        f"[bold yellow]The key goes over {escape(endpoint)} in the clear.[/] Any listener can then "
        "command the vehicle. Use a cable, or a network without other listeners.",
        highlight=False,
    )
    if yes:
        return
    if not sys.stdin.isatty():
        raise GcsError("gcs keys: cannot ask whether the link is secure; confirm it with --yes")
    if not typer.confirm("Is this link secure?", err=True):
        raise GcsError("gcs keys: no key was sent")


def _install(
    keys: KeyFile, endpoint: str, wanted: list[KeyInstallation], timeout_s: float, console: Console
) -> list[Result]:
    from gcs.endpoints import parse_endpoint
    from gcs.io.signing.keystore import TimeFile
    from gcs.io.signing.provisioning import install as install_keys

    results: list[Result] = []

    def on_result(result: Result) -> None:
        results.append(result)
        if result.ok and result.vehicle in keys.pending:
            keys.vehicles[result.vehicle] = keys.pending.pop(result.vehicle)
            keys.save()
        style, outcome = ("green", "done") if result.ok else ("bold red", "failed")
        text = f"{_name(result.vehicle)}: [{style}]{outcome}[/]: {escape(result.detail)}"
        console.print(text, highlight=False)

    with console.status(f"waiting for {len(wanted)} vehicles on {escape(endpoint)}"):
        try:
            where = parse_endpoint(endpoint)
            times = TimeFile(keys.path)
            install_keys(
                where, wanted, times, timeout_s, on_result, lambda text: console.print(text, highlight=False)
            )
        except OSError as error:
            raise ConfigError(
                str(keys.path), "", MistakeCode.NO_ACCESS, f"cannot save its signing time: {error}"
            ) from None
        except KeyboardInterrupt:
            console.print("interrupted", highlight=False)
            raise typer.Exit(130) from None
    return sorted(results, key=lambda result: result.vehicle)


def _finish(results: list[Result], *, as_json: bool) -> None:
    if as_json:
        rows = [{"vehicle": r.vehicle, "ok": r.ok, "detail": r.detail, "sent": r.sent} for r in results]
        print(json.dumps({"vehicles": rows}))  # noqa: T201  the output of --json
    raise typer.Exit(0 if all(result.ok for result in results) else 1)


def _rows(keys: KeyFile, *, secret: bool) -> list[dict[str, str]]:
    from gcs.mavlink.frames.signing import fingerprint

    named = [("all vehicles", keys.default, "")] if keys.default is not None else []
    named += [(name, key, "") for name, key in keys.links.items()]
    named += [(_name(v), key, "") for v, key in sorted(keys.vehicles.items())]
    named += [(_name(v), key, "pending") for v, key in sorted(keys.pending.items())]
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
