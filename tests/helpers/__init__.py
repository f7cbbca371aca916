"""What several tests share. Tests and benchmarks import it by name, by way of the link in `tests/bench`."""
