"""Console: the swarm in a browser, in a process of its own; that of a replay is beside it.

Reading order:

- `source`: what the console needs of a run. `view.news`: what it asks, and what it gets.
- `view.feed`: on the loop of the run. It keeps references to scans, effects and the state; it encodes
  nothing. `engine`: what the console reads of the engine; nothing else here imports it.
- `remote`: news of a service for consoles in other processes, over zenoh: the answers of the service, the
  questions of the console.
- `server`: the server with its thread.
- `view.page_records`: the records that pages and programs get.
- `view.page_state`, `view.sections`: all that a page shows, as JSON.
- `view.run_marks`, `view.chart_data`: marks of the whole run, and the data of its charts; of a recording,
  read from its file.
- `web.page_connections`: bounded queues of the pages; a slow page loses messages, then gets everything anew.
- `web.console_access`, `web.request_checks`, `web.token_attempts`: addresses, tokens, TLS; checks of each
  request.
- `web.preflight_run`: preflight checks on demand.
- `web.order_requests`: orders from pages and programs, and their answers. `web.playback_control`: control of
  a replay.
- `web.alarm_guide`: the page of alarms, and the entry of an alarm.
- `web.web_routes`, `web.openapi`, `web.prometheus`, `web.static_files`, `web.tiles`: what is served.
- `static`: the page, plain ES modules and CSS. `compare`: the pages of two recordings, in frames.
"""
