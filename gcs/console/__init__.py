"""Console: the swarm in a browser, served beside the service.

Reading order:

- `server`: the thread of the console.
- `view.feed`: on the loop of the service. It keeps references to scans, effects and the state; it encodes
  nothing.
- `view.capture`: what the console reads of the engine, in one place.
- `view.schema`: the records that pages and programs get.
- `view.world`, `view.sections`: all that a page shows, as JSON, on the own thread. `view.details`: everything
  of one vehicle, when a page or program asks.
- `view.history`, `view.series`: marks of the whole run, and the data of its charts; of a recording, read from
  its file.
- `web.clients`: bounded queues of the pages; a slow page loses messages, then gets everything anew.
- `web.access`, `web.guard`: addresses, tokens, TLS; checks of each request.
- `web.preflight`: preflight checks on demand.
- `web.orders`: orders from pages and programs, and their answers. `web.playback`: control of a replay.
- `web.alarm_guide`: the page of alarms, and the entry of an alarm.
- `web.app`, `web.openapi`, `web.prometheus`, `web.static_files`, `web.tiles`: what is served.
- `static`: the page, plain ES modules and CSS. `compare`: the pages of two recordings, in frames.
"""

from gcs.console.server import ConsoleServer, Source
from gcs.console.web.access import Access

__all__ = ["Access", "ConsoleServer", "Source"]
