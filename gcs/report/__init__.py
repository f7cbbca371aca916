"""Reports: how a run went, as text, figures and pages.

Reading order:

- `run`: one run. `truth` (ground truth), `evaluation` (success against the ground truth), `timeline` (all
  that is drawn), `triggers` (why plans were made), `tables`, `run_page`, `summary` (terminal), `tracks_csv`,
  `verification` (a replay against its recording).
- `plots`: figures of runs, plans and tracking.
- `telemetry`: flights and traffic as recorded from the MAVLink frames.
- `html_page`: one self-contained page. `operator_lines`, `plan_reminders`,
  `agent_order`: texts and order of displays.
"""
