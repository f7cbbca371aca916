"""Grid search, assignment and routes: pure numerics, no I/O."""
