"""Console: the swarm in a browser, in a process of its own; that of a replay is beside it.

Reading order:

- `source`: what the console needs of a run. `view.news`: what it asks, and what it gets.
- `view.feed`: on the loop of the run. It keeps references to scans, effects and the state; it encodes
  nothing. `engine`: what the console reads of the engine; nothing else here imports it.
- `remote`: news of a service for consoles in other processes, over zenoh: the answers of the service, the
  questions of the console.
- `server`: the server with its thread.
- `view.schema`: the records that pages and programs get.
- `view.world`, `view.sections`: all that a page shows, as JSON.
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
