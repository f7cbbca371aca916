"""Labels whose associations depend on each other: they merge, split, or are worked alone."""
