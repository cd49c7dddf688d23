"""Settings of how a map is prepared."""

import dataclasses

from .._settings import Settings, setting


@dataclasses.dataclass(frozen=True)
class MapConfig(Settings, table="map"):
    """How a map is prepared.

    Attributes:
        voxel_size: Working voxel size [m]; 0 takes the coarser map's, and brings maps finer than `fine_voxel_size` to
            about `usual_voxel_size`, as far as `min_surface` allows: the evidence bounds are lengths that belong to the
            accuracy of maps, not numbers of voxels.
        fine_voxel_size: Maps finer than this are made coarser [m].
        usual_voxel_size: About the voxel size of fine maps after that [m]: the trials behind the evidence ran there.
        min_surface: A map is made coarser only as far as it keeps about so many occupied voxels: a fragment of a room,
            seen from near, is small and drifts little, and its details are all that it has.
        infer_free_space: Take what surfaces enclose for free in a map that records no free space
            (`maps/inferred_space.py`). Fusion never uses it.
        inferred_reach: Length of the rays that look for surfaces around a place [m]: across a hall, not across a
            building.
        inferred_directions: A place is enclosed if a surface lies in at least so many of the 26 directions.
        virtual_reach: The planes of a virtual corner end within this of it [m]: so much of walls does furniture hide.
            In coarse maps it is no less than the seven voxels beside an observed corner.
        max_planar: Planes and their corners are found in voxels so wide that about so many of them are occupied: the
            time grows with their number, and the faces of rooms are as well found in wider ones.
        descriptor_spacing: Descriptors are of points averaged over cells of two and a half voxels, but no wider than
            this [m], where voxels are finer: furniture has no shape beyond it.
        max_described: A map has descriptors at the finest scale at which it has at most so many points: the time of
            matching them grows with the square.
        min_inferred: Inferred free space is used where it lies before at least this share of the surfaces; in half a
            scan it would be on the wrong side of too many.
    """

    voxel_size: float = setting(0.0, low=0.0, high=1_000.0)
    fine_voxel_size: float = setting(0.075, low=0.0, high=1_000.0)
    usual_voxel_size: float = setting(0.1, above=0.0, high=1_000.0)
    min_surface: int = setting(8192, low=0, high=1_000_000_000)
    infer_free_space: bool = setting(True)
    inferred_reach: float = setting(12.0, above=0.0, high=1_000.0)
    inferred_directions: int = setting(20, low=1, high=26)
    virtual_reach: float = setting(2.0, above=0.0, high=1_000.0)
    max_planar: int = setting(60_000, low=1, high=1_000_000_000)
    descriptor_spacing: float = setting(0.3, above=0.0, high=1_000.0)
    max_described: int = setting(10_000, low=1, high=10_000_000)
    min_inferred: float = setting(0.75, low=0.0, high=1.0)
