"""Before the first test: kernels compiled, or loaded, once."""

import pytest


def pytest_sessionstart(session: pytest.Session) -> None:
    """Compile outside of every test: their time limits are not made for a first start."""
    if hasattr(session.config, "workerinput") or session.config.option.collectonly:
        return
    from gcs.mavlink.quiet import warm_up as warm_up_links
    from gcs.planning.routes import warm_up as warm_up_planning
    from gcs.tracking.glmb import warm_up as warm_up_tracking

    warm_up_tracking()
    warm_up_planning()
    warm_up_links()
