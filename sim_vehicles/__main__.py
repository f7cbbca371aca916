"""``python -m sim_vehicles``: the same as the ``sim-vehicles`` command."""

from sim_vehicles.cli import main

main()
