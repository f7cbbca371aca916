"""Packet loss: datagrams that are dropped at random, on real and on virtual links."""

from __future__ import annotations

import numpy as np


def is_lost(probability: float, rng: np.random.Generator) -> bool:
    """Return True if a datagram is lost; without loss no number is drawn."""
    return probability > 0.0 and rng.random() < probability
