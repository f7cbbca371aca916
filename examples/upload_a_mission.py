"""Upload a mission to one vehicle, read it back and start it. The vehicle is never armed.

sim-vehicles run deterministic        # in another terminal; or ArduPlane, a real one or SITL
python examples/upload_a_mission.py udpin:127.0.0.1:14550 --system-id 1
"""

import argparse
import sys

import numpy as np

from gcs.errors import LinkError
from gcs.io.vehicles import upload_mission

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("endpoint")
parser.add_argument("--system-id", type=int, default=1)
parser.add_argument("--at", type=float, nargs=2, default=(33.2, -87.6), metavar=("LAT", "LON"))
arguments = parser.parse_args()

square = np.array([[0.004, 0.0], [0.004, 0.004], [0.0, 0.004], [0.0, 0.0]])
waypoints = np.column_stack([square + arguments.at, [100.0, 110.0, 120.0, 120.0]])  # degrees, m above home
try:
    result = upload_mission(arguments.endpoint, arguments.system_id, waypoints)
except LinkError as error:
    sys.exit(str(error))
print(f"{result.detail} in {result.duration_s:.1f} s; the vehicle stores:")
for number, item in enumerate(result.items or ()):
    print(f"  {number}: command {item.command}, {item.x * 1e-7:.5f} {item.y * 1e-7:.5f}, {item.z_m:.0f} m")
sys.exit(0 if result.ok else 1)
