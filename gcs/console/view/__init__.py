"""What the console shows of a run, read from the engine and encoded for its pages."""
