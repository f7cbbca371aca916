"""Bytes to MAVLink frames and back: `codec`, `stream`, `signing`, and compiled forms of them (`fast_*`).

The plain Python form of each compiled module is the reference: tests compare the two.
"""
