"""The state of each vehicle as its messages give it, and the quality of its link."""
