"""Service discovery on this machine: a small file per running service.

The files are in a folder of the user, below ``XDG_RUNTIME_DIR`` or the temporary folder. A folder that others
may write to is ignored. Files of ended processes are ignored and removed.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import msgspec

from gcs.errors import LinkError, NoAnswerError


class ServiceInfo(msgspec.Struct, frozen=True, kw_only=True):
    """One running service."""

    mission: str
    zenoh: str
    """Endpoint to connect to."""
    pid: int
    zenoh_tls: str = ""
    """Folder of its certificate, which its user may use as well; empty without TLS."""


class ServiceAddress(NamedTuple):
    """Where a service is reached."""

    mission: str
    zenoh: str
    """Endpoint to connect to."""
    tls: Path | None
    """Folder of the certificate to use."""


_decoder = msgspec.json.Decoder(ServiceInfo)


@contextlib.contextmanager
def announced(mission: str, zenoh: str, tls: Path | None = None) -> Iterator[None]:
    """Announce this process to `gcs order` on this machine, if a file can be written."""
    folder_text = "" if tls is None else str(tls.absolute())
    here = ServiceInfo(mission=mission, zenoh=zenoh, pid=os.getpid(), zenoh_tls=folder_text)
    path: Path | None = None
    with contextlib.suppress(OSError):
        folder = _folder()
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_ours(folder):
            path = folder / f"{mission}-{here.pid}.json"
            path.write_bytes(msgspec.json.encode(here))
    try:
        yield
    finally:
        if path is not None:
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def running_services() -> list[ServiceInfo]:
    """Return this user's running services on this machine."""
    folder = _folder()
    found: list[ServiceInfo] = []
    if not folder.is_dir() or not _is_ours(folder):
        return found
    for path in sorted(folder.glob("*.json")):
        with contextlib.suppress(OSError, msgspec.DecodeError):
            one = _decoder.decode(path.read_bytes())
            if is_running(one.pid):
                found.append(one)
            else:
                path.unlink(missing_ok=True)
    return found


def find_service(mission: str | None) -> ServiceInfo:
    """Return the one running service, or the one of a mission.

    Raises
    ------
    LinkError
        There is none, or more than one.
    """
    found = [one for one in running_services() if mission is None or one.mission == mission]
    if len(found) == 1:
        return found[0]
    if found:
        names = ", ".join(f"{one.mission} at {one.zenoh}" for one in found)
        by = "--mission NAME" if mission is None else f"--mission {mission} --zenoh ENDPOINT"
        raise LinkError("gcs", f"several services run here ({names}): choose one by {by}")
    what = "no service" if mission is None else f"no service of the mission {mission}"
    raise NoAnswerError(
        "gcs",
        f"{what} runs on this machine: start `gcs run` or `gcs demo`, or name another machine's with "
        "--mission NAME --zenoh tls/HOST:PORT",
    )


def choose_service(mission: str | None, zenoh: str | None, tls: Path | None) -> ServiceAddress:
    """Return the address of a service: the given one, else that of the service on this machine.

    There its own certificate is used, unless another one is given.

    Raises
    ------
    LinkError
        There is none, or more than one, or an endpoint is given without a mission.
    """
    if zenoh is None:
        found = find_service(mission)
        own = Path(found.zenoh_tls) if found.zenoh_tls else None
        return ServiceAddress(found.mission, found.zenoh, tls or own)
    if mission is None:
        raise LinkError(zenoh, "name the mission of its service with --mission")
    return ServiceAddress(mission, zenoh, tls)


def private_folder() -> Path:
    """Return the folder of this user's services, which no other user may write to.

    Raises
    ------
    LinkError
        It cannot be made, or others may write to it.
    """
    folder = _folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_ours(folder):
            return folder
        problem = "others may write to it"
    except OSError as error:
        problem = error.strerror or str(error)
    raise LinkError(str(folder), f"the folder of running services cannot be used ({problem})")


def _folder() -> Path:
    return Path(os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()) / f"swarm-gcs-{os.getuid()}"


def _is_ours(folder: Path) -> bool:
    status = folder.stat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


def is_running(pid: int) -> bool:
    """Return True if a process runs. One that has ended and was not waited for by its parent does not."""
    try:
        os.kill(pid, 0)
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except ProcessLookupError:
        return False
    except (PermissionError, FileNotFoundError):  # of another user; a system without /proc
        return True
    return state not in ("Z", "X")
