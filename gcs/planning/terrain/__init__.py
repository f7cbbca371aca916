"""Routes over terrain inside a flight band, for vehicles that cannot climb as steeply as the ground.

Reading order:

1. `band`: floor and ceiling at each place. `intervals`: the heights that can be reached along a path.
2. `height_field`: lengths to a goal from every place and height, without turns. `goal`: goals of routes and
   the cost matrix. `loiter_circles`: circles inside the band.
3. `pose_search`: A* over poses with intervals of heights. `corner_path`: shorter paths of legs and turns.
   `path_search`: both.
4. `height_profile`: heights along a path. `route`: waypoints with heights. `flown_route`: the flight along
   them, and the margin that it needs.
"""
