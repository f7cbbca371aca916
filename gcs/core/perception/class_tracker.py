"""The filter of agents, or of targets: its birth components, its confirmed tracks and its pictures.

A birth component has `BIRTH_PROBABILITY` until its object is confirmed, then `BIRTH_AGAIN_PROBABILITY`. With
a rate in `tracking.<kind>.anywhere`, objects are also born at detections that no track explains
(`gcs.tracking.models.adaptive_birth`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gcs.config import Config
from gcs.core.perception.perception_state import TrackerState
from gcs.core.perception.track_lifecycle import TrackConfirmation
from gcs.core.perception.tracking_model import BIRTH_AGAIN_PROBABILITY, glmb_params
from gcs.model import NS_PER_S, FloatArray, Kind, LaggedPicture, Picture, Sensor, Track, read_only
from gcs.tracking.glmb.filter import Birth, DetectionSummary, Glmb
from gcs.tracking.models.adaptive_birth import AdaptiveBirth
from gcs.tracking.models.clutter import intensity_per_m2
from gcs.tracking.models.constant_velocity import transition
from gcs.tracking.models.sensor_geometry import clutter_per_m2, covers, noise_m2


class ClassTracker:
    """One filter with its birth components and confirmed tracks.

    Raises
    ------
    ValueError
        If the state is damaged.
    """

    def __init__(self, kind: Kind, config: Config, births: Sequence[Birth], state: TrackerState) -> None:
        tracking = config.tracking
        table = tracking.agents if kind == "agents" else tracking.targets
        params = glmb_params(tracking, table.accel_psd_m2_s3, table.turn_rate_std_deg_s)
        self.kind = kind
        self.births = births
        self._state = state
        self._components_again = [replace(one, probability=BIRTH_AGAIN_PROBABILITY) for one in births]
        self._components_closed = [replace(one, probability=0.0) for one in births]
        state.is_born = state.is_born or [False] * len(births)
        if len(state.is_born) != len(births):
            raise ValueError("tracker state: is_born is not valid")
        self._process_noise = params.process_noise
        self._turn_rate_std_rad_s = math.radians(table.turn_rate_std_deg_s)
        lag = tracking.lag_scans
        self._filter = Glmb(kind, params, 0, summarise_detections=True, lag=lag, state=state.filter)
        scan_t_ns = state.filter.t_ns
        self.picture = None if scan_t_ns is None else self._filter.picture(scan_t_ns)
        tracks = () if self.picture is None else self.picture.tracks
        self.confirmation = TrackConfirmation(tracking.lost_existence, state.confirmation, tracks)
        anywhere = table.anywhere
        self.unknown = AdaptiveBirth(
            anywhere.per_s,
            anywhere.speed_std_m_s,
            anywhere.max_probability,
            self._process_noise,
            state.adaptive_birth,
        )

    def update(
        self, t_ns: int, z_m: FloatArray, sensor: Sensor, others: FloatArray, births: Sequence[Birth] = ()
    ) -> DetectionSummary:
        """Process one scan, with births in addition to the birth components.

        `others` (m,) is the intensity of the other kind's objects at each detection, per m2.
        """
        clutter = clutter_per_m2(sensor, z_m) + others
        components = self._components(t_ns, sensor)
        self._filter.update(t_ns, z_m, sensor, [*components, *births, *self.unknown.births(t_ns)], clutter)
        assert self._filter.detection_summary is not None
        return self._filter.detection_summary

    def _components(self, t_ns: int, sensor: Sensor) -> list[Birth]:
        """Return the birth components of a scan: once per epoch, where the sensor covers them.

        Without coverage unmissed births would add up. Position reports cover agents everywhere. The other
        components get probability 0, so that labels keep their indices.
        """
        means = np.reshape([birth.mean[:2] for birth in self.births], (-1, 2))
        is_open = covers(sensor, means) | (self.kind == "agents")
        is_open &= t_ns > self._state.born_t_ns
        self._state.born_t_ns = t_ns
        return [
            (again if is_born else first) if is_open_now else closed
            for first, again, closed, is_born, is_open_now in zip(
                self.births,
                self._components_again,
                self._components_closed,
                self._state.is_born,
                is_open.tolist(),
                strict=True,
            )
        ]

    def update_by_reports(self, t_ns: int, z_m: FloatArray, sensor: Sensor, births: Sequence[Birth]) -> None:
        """Process an epoch of position reports alone, with births at reports only.

        No miss would end the objects of the other components.
        """
        self._filter.update(t_ns, z_m, sensor, [*self._components_closed, *births])

    def update_again(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> None:
        """Process another sensor's scan of the same epoch, without births."""
        self._filter.update(t_ns, z_m, sensor)

    def expected(self, t_ns: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the tracks of the last picture, predicted to `t_ns`.

        Positions (n, 2), their covariances (n, 2, 2), existence probabilities (n,).
        """
        tracks = () if self.picture is None else self.picture.tracks
        dt_s = 0.0 if self.picture is None else max(0.0, (t_ns - self.picture.scan_t_ns) / NS_PER_S)
        F = transition(dt_s)
        Q = self._process_noise(dt_s)
        means = np.reshape([track.mean for track in tracks], (-1, 4)) @ F.T
        covs = F @ np.reshape([track.cov for track in tracks], (-1, 4, 4)) @ F.T + Q
        # The picture has no turn rates: the offset of a turn adds to the covariance.
        offset_m = 0.5 * dt_s**2 * self._turn_rate_std_rad_s * np.hypot(means[:, 2], means[:, 3])
        covs[:, [0, 1], [0, 1]] += np.square(offset_m)[:, None]
        existence = np.array([track.existence for track in tracks])
        return np.ascontiguousarray(means[:, :2]), np.ascontiguousarray(covs[:, :2, :2]), existence

    def intensity(self, t_ns: int, z_m: FloatArray, sensor: Sensor) -> FloatArray:
        """Return the intensity of this kind's detections at each of `z_m` (m, 2), per m2."""
        means, covs, existence = self.expected(t_ns)
        points = np.array(z_m, order="C")
        noise = np.array(noise_m2(sensor, z_m), order="C")
        intensity = intensity_per_m2(means, covs, existence, points, noise)
        return np.asarray(sensor.detection_probability * intensity)

    def extract(self, t_ns: int, sensor: Sensor | None) -> Picture:
        """Return the picture after a scan; update confirmation and birth probabilities.

        `sensor` is the sensor of the scan; None: position reports came too, which cover everything.
        """
        self.picture = self._filter.picture(t_ns)
        self.confirmation.update(self.picture, sensor)
        for _, index in self.confirmation.tracks:
            if index < len(self.births):
                self._state.is_born[index] = True
        return self.picture

    def lagged(self, t_ns: int) -> list[LaggedPicture]:
        """Return the picture of some scans ago, after `extract`; none before there are enough scans."""
        found = self._filter.lag_estimates()
        if found is None or self.picture is None:
            return []
        existence = {track.label: track.existence for track in self.picture.tracks}
        tracks = tuple(
            Track((born, index), read_only(mean), read_only(cov), existence[born, index], estimated=True)
            for (born, index), mean, cov in zip(found.label.tolist(), found.mean, found.cov, strict=True)
        )
        return [LaggedPicture(t_ns, found.t_ns, self.kind, tracks)]
