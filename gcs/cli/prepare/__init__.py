"""Commands before a flight: mission files, plans, vehicles, keys.

- `init`: a first mission file. It reads sources into a `sketch`: `sketch_files` (.plan, KML), `sketch_heard`
  (logs, links).
- `check`, `plan`: mission files and plans.
- `preflight`, `fence`, `param`, `keys`: the vehicles.
- `scenarios`, `warm_up`: the shipped scenarios; the compiled kernels.
"""
