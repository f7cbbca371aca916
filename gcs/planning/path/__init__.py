"""From grid path to flyable route: shortcuts, string pulling, corners, turns, Dubins paths."""
