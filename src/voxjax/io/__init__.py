"""Maps on disk, for everyone who has files or wants some: start with `read_map` and `write_map` in `map_files`.

`load_map` also says what is odd about a map, and `describe_map` gives its figures. `.bt` and `.ot` are OctoMap's
(`octomap`), `.npz` is voxjax's own (`npz`), `.zarr` is a store for maps of any size, read by chunks (`zarr_reading`,
`zarr_writing`), `.ply` is a cloud of points (`ply`), whose voxel size may be estimated (`spacing`). Readers trust no
file: what they take is bounded by `budget`, but for the chunks of stores, which the package zarr decodes; and what is
wrong with a file is an `InputError` of one sentence.
"""

from ..ops.resampling.lattice import MAX_VOXELS as MAX_VOXELS
from .map_files import ENDINGS as ENDINGS
from .map_files import DescribedMap as DescribedMap
from .map_files import LoadedMap as LoadedMap
from .map_files import MapWarning as MapWarning
from .map_files import check_place as check_place
from .map_files import describe_map as describe_map
from .map_files import encode_map as encode_map
from .map_files import load_map as load_map
from .map_files import read_map as read_map
from .map_files import write_map as write_map
