"""Control authority: overrides by pilots, failsafes and other ground stations; onboard mission audits."""
