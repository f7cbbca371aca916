"""Commands before a flight: mission files, plans, vehicles, keys.

- `init`: a first mission file. `sketch` reads its values from plans, KML, logs and links.
- `check`, `plan`: mission files and plans.
- `preflight`, `fence`, `param`, `keys`: the vehicles.
- `scenarios`, `warm_up`: the shipped scenarios; the compiled kernels.
"""
