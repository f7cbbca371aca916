"""The running service: the event queue, its one consumer, its journal, replay and restart."""
