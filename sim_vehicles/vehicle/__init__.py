"""One simulated vehicle: airframe, guidance, failsafes and its side of the link."""
