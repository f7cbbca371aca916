"""When to plan again, from which inputs, and into which altitude layers."""
