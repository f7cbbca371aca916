"""Commands, parameters, signing keys and other exchanges with one vehicle, with their repeats."""
