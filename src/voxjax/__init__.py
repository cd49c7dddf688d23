"""voxjax: fuse 3D occupancy maps of several robots without knowing how the maps lie to each other.

Start at `register`, `fuse` and `merge`, which take and give `VoxelGrid` maps. Names are loaded when they are first
used, so that `import voxjax` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from ._version import __version__

_HOME = {
    "VoxelGrid": "grid",
    "InputError": "_checks",
    "RESULTS": "_results",
    "read_map": "io",
    "write_map": "io",
    "box_count": "ops.window.classes",
    "classify_voxels": "features.classify",
    "Corners": "features.corners",
    "detect_corners": "features.corners",
    "Planes": "planes.fit",
    "consistency_graph": "matching.consistency",
    "ConsistencyGraph": "matching.consistency",
    "maximum_common_subgraph": "matching.common_subgraph",
    "refine": "refinement.refine",
    "refine_joint": "refinement.refine_joint",
    "Registration": "registration.types",
    "register": "pipeline.pair",
    "register_batch": "pipeline.batch",
    "fuse": "fusion.fuse",
    "merge": "pipeline.many",
    "Config": "pipeline.config",
    "Merge": "pipeline.merged",
    "use_compilation_cache": "_runtime.compilation_cache",
}

_PACKAGES = ("frames", "io", "metrics", "ops", "pipeline", "refinement", "rigid", "synthetic", "view")
"""Packages and modules for those who want more than the names above, as `voxjax.ops`; loaded like these."""

__all__ = ["__version__", *_HOME]

if TYPE_CHECKING:
    from . import frames as frames
    from . import io as io
    from . import metrics as metrics
    from . import ops as ops
    from . import pipeline as pipeline
    from . import refinement as refinement
    from . import rigid as rigid
    from . import synthetic as synthetic
    from . import view as view
    from ._checks import InputError as InputError
    from ._results import RESULTS as RESULTS
    from ._runtime.compilation_cache import use_compilation_cache as use_compilation_cache
    from .features.classify import classify_voxels as classify_voxels
    from .features.corners import Corners as Corners
    from .features.corners import detect_corners as detect_corners
    from .fusion.fuse import fuse as fuse
    from .grid import VoxelGrid as VoxelGrid
    from .io import read_map as read_map
    from .io import write_map as write_map
    from .matching.common_subgraph import maximum_common_subgraph as maximum_common_subgraph
    from .matching.consistency import ConsistencyGraph as ConsistencyGraph
    from .matching.consistency import consistency_graph as consistency_graph
    from .ops.window.classes import box_count as box_count
    from .pipeline.batch import register_batch as register_batch
    from .pipeline.config import Config as Config
    from .pipeline.many import merge as merge
    from .pipeline.merged import Merge as Merge
    from .pipeline.pair import register as register
    from .planes.fit import Planes as Planes
    from .refinement.refine import refine as refine
    from .refinement.refine_joint import refine_joint as refine_joint
    from .registration.types import Registration as Registration


def __getattr__(name: str) -> object:
    """Load a public name from its module, or a package, on first use."""
    if name in _PACKAGES:
        return import_module(f"{__name__}.{name}")
    if name not in _HOME:
        raise AttributeError(f"module 'voxjax' has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    # The next access finds the name in the module itself and does not come here.
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """All public names and packages, loaded or not."""
    return sorted([*__all__, *_PACKAGES])
