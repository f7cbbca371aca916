"""How flights begin and end: the climb, the terminal loiter, the landing."""
