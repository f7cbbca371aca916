"""Key files, the signing gate of all links, and keys on their way to vehicles."""
