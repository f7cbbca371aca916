"""From grid path to flyable route: shortcuts, string pulling, corner smoothing, turns, Dubins paths."""
