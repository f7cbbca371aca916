"""Signing keys: `keystore` (files), `gate` (signing of a run's links), `provisioning` (SETUP_SIGNING)."""
