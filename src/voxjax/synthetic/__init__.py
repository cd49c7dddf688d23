"""Generated worlds: buildings, robots that map them, and the truth to compare with.

The demo, the tests and the benchmarks take their maps from here. Start at `simulate_team`, which gives the maps of
several robots, their true poses and the true corners. Places that are no buildings, and storeys of one plan, are in
`voxjax.synthetic.families`.
"""

from .building import Building as Building
from .building import make_building as make_building
from .building import make_hotel as make_hotel
from .lidar import Lidar as Lidar
from .team import Team as Team
from .team import different_buildings as different_buildings
from .team import measure_overlap as measure_overlap
from .team import simulate_hotel as simulate_hotel
from .team import simulate_team as simulate_team
from .true_corners import TrueCorners as TrueCorners
