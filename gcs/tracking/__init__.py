"""GLMB multi-object tracking: pure numerics, no I/O."""
