"""Console: the swarm in a browser, served beside the service.

Reading order:

- `feed`: on the loop of the service. It keeps references to scans, effects and the state; it encodes nothing.
- `capture`: what the console reads of the engine, in one place.
- `world`, `rows`, `details`: everything that a page shows, as JSON, on the console's own thread.
- `history`, `series`: marks of the whole run, and the data of its charts; of a recording, read from its file.
- `clients`: bounded queues of the pages; a slow page loses messages, then gets everything anew.
- `access`, `guard`: addresses, tokens, TLS; checks of each request.
- `preflight`: preflight checks on demand.
- `orders`: orders from pages and programs, and their answers. `playback`: control of a replay.
- `alarm_guide`: the page of alarms, and the entry of an alarm.
- `app`, `openapi`, `prometheus`, `static_files`: what is served. `server`: the thread.
- `static`: the page, plain ES modules and CSS. `compare`: the pages of two recordings, in frames.
"""

from gcs.console.access import Access
from gcs.console.server import ConsoleServer, Source

__all__ = ["Access", "ConsoleServer", "Source"]
