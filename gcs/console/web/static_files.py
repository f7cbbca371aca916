"""Files of the console's page: its modules as one script, with cache headers.

The page's modules are served as one script and its styles as one sheet, for a browser needs longer for forty
requests than for the content. Comments with types are left out there. Their path has a version, so that a
browser may keep them.
"""

from __future__ import annotations

import hashlib
import mimetypes
import re
from collections.abc import Iterator
from importlib.resources import files
from typing import Final

from starlette.requests import Request
from starlette.responses import Response

_STYLES: Final = (
    "base", "layout", "header", "alarms", "map", "vehicles", "panels", "profile", "charts", "log", "replay",
    "commands",
)  # fmt: skip
_IMPORT: Final = re.compile(r'^import (?:\* as (\w+)|\{([^}]+)\}) from "\./(\w+\.js)";$', re.MULTILINE)
_EXPORT: Final = re.compile(r"^export (?=(?:(?:async )?function|class|const) (\w+))", re.MULTILINE)
_TYPES: Final = re.compile(r"^ */\*\*(?:(?!\*/).)*\*/\n", re.MULTILINE | re.DOTALL)
"""Comments with the types of the modules, a quarter of their size."""
_KEPT: Final = {"cache-control": "private, max-age=31536000, immutable"}


class StaticFiles:
    """Contents and media types by name."""

    def __init__(self) -> None:
        folder = files("gcs.console") / "static"
        found = {one.name: one.read_bytes() for one in folder.iterdir() if one.is_file()}
        found["page.js"] = script(
            {name: text.decode() for name, text in found.items() if name.endswith(".js")}
        )
        found["page.css"] = b"".join(found[f"{name}.css"] for name in _STYLES)
        digest = hashlib.sha256(b"".join(found[name] for name in sorted(found)))
        self.version = digest.hexdigest()[:12]
        """Changes with every change of a file."""
        found["index.html"] = found["index.html"].replace(b"{version}", self.version.encode())
        self.files = {
            name: (content, mimetypes.guess_type(name)[0] or "application/octet-stream")
            for name, content in found.items()
        }

    async def serve(self, request: Request) -> Response:
        """Serve a file under its name."""
        return self.response(request.url.path.removeprefix("/"))

    async def serve_kept(self, request: Request) -> Response:
        """Serve a file under the path with the version."""
        name = request.path_params["name"]
        return self.response(name, _KEPT) if name in self.files else Response(status_code=404)

    def response(self, name: str, headers: dict[str, str] | None = None) -> Response:
        """Return the response with a file."""
        content, media_type = self.files[name]
        return Response(content, headers=headers, media_type=media_type)


def script(modules: dict[str, str]) -> bytes:
    """Return one script of `main.js` and all that it imports.

    Each module becomes a block. Imports and exports become reads and writes of an object of modules.
    """
    blocks = (_block(name, modules[name]) for name in dict.fromkeys(_in_order(modules, "main.js")))
    return "\n".join(("const modules = {};", *blocks)).encode()


def _in_order(modules: dict[str, str], name: str) -> Iterator[str]:
    """Yield a module after all that it imports; some more than once."""
    for found in _IMPORT.finditer(modules[name]):
        yield from _in_order(modules, found[3])
    yield name


def _block(name: str, text: str) -> str:
    exports = ", ".join(found[1] for found in _EXPORT.finditer(text))
    body = _TYPES.sub("", _EXPORT.sub("", _IMPORT.sub(_read, text)))
    return f'{{ // {name}\n{body}modules["{name}"] = {{ {exports} }};\n}}'


def _read(found: re.Match[str]) -> str:
    names = found[1] or "{" + found[2].replace(" as ", ": ") + "}"
    return f'const {names} = modules["{found[3]}"];'
