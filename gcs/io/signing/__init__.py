"""Signing keys: `keystore` (files), `link_signing` (of a run), `provisioning` (SETUP_SIGNING)."""
