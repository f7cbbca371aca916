"""Central command for a swarm of fixed-wing vehicles: track, plan, and task over MAVLink."""
