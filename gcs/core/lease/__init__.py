"""The lease: which command node may send to the vehicles of which bridge (``docs/failover.md``).

`bridge_lease` is the side of a bridge, which grants; `node_lease` that of a command node, which asks. Both
are functions over frozen records. Clocks of two machines are never compared.
"""
