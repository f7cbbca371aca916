"""A service in another process: its news over zenoh.

`messages`: what travels. `answers`: in the process of the service. `remote_run`: in that of the console.
"""
