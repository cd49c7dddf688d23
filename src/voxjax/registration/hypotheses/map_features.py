"""`MapFeatures`: what the hypotheses of a map's pairs are made from; each part computed once, when first asked for."""

import dataclasses

import numpy as np
from jaxtyping import Float, Float32

from ...features.corners import corners_of_planes
from ...features.types import Corners
from ...grid import VoxelGrid
from ...maps.inferred_space import infer_free_space
from ...maps.prepared import PreparedMap, draw_rows, map_surface, prepare_map
from ...maps.settings import MapConfig
from ...matching.descriptors import MapDescriptors, describe_map, finest_level, working_spacing
from ...planes.extract import extract_planes
from ...planes.settings import PlaneConfig
from .directions import dominant_directions
from .settings import RotationConfig, SourceConfig


class LateFeatures:
    """Corners and descriptors of a map: they take longest, and many pairs are decided without them."""

    def __init__(
        self,
        grid: VoxelGrid,
        max_virtual: int,
        planes: PlaneConfig | None = None,
        settings: MapConfig | None = None,
    ):
        """Compute nothing yet.

        Args:
            grid: The map.
            max_virtual: Largest number of virtual corners.
            planes: How the planes behind the corners are found; None for the defaults.
            settings: How far furniture hides walls, and what shapes it has; None for the defaults.
        """
        self._grid, self._max_virtual, self._planes = grid, max_virtual, planes
        self._settings = MapConfig() if settings is None else settings
        self._corners: Corners | None = None
        self._finest_level: int | None = None
        self._descriptors: dict[tuple[bool, int], MapDescriptors] = {}

    def of(self, grid: VoxelGrid) -> "LateFeatures":
        """Those of another map, with the same settings; nothing is computed yet.

        Args:
            grid: The other map.
        """
        return LateFeatures(grid, self._max_virtual, self._planes, self._settings)

    @property
    def corners(self) -> Corners:
        """Observed and virtual corners."""
        # No `cached_property`: before Python 3.12 its lock lets no two maps find corners side by side.
        if self._corners is None:
            self._corners = self._find_corners()
        return self._corners

    def _find_corners(self) -> Corners:
        grid, settings = self._grid, self._settings
        # The faces that make corners are large, and refinement places what corners propose.
        factor = int(np.ceil(np.sqrt(grid.num_occupied / settings.max_planar)))
        if factor > 1:
            grid = grid.with_voxel_size(factor * grid.voxel_size)
        planes = extract_planes(grid, settings=self._planes)
        return corners_of_planes(
            grid, planes, virtual=True, virtual_reach=settings.virtual_reach, max_virtual=self._max_virtual
        )

    @property
    def finest_level(self) -> int:
        """The finest level at which the map is described."""
        if self._finest_level is None:
            most = self._settings.max_described
            self._finest_level = finest_level(self._grid, spacing=self._spacing, max_points=most)
        return self._finest_level

    def descriptors(self, *, use_free_space: bool, finest: int) -> MapDescriptors:
        """Local descriptors from a level on; maps of a pair agree on it, and on whether free space signs normals."""
        chosen = use_free_space, finest
        if chosen not in self._descriptors:
            self._descriptors[chosen] = describe_map(
                self._grid, spacing=self._spacing, use_free_space=use_free_space, finest=finest
            )
        return self._descriptors[chosen]

    @property
    def _spacing(self) -> float:
        """Working spacing of the descriptors [m]."""
        return working_spacing(self._grid.voxel_size, most=self._settings.descriptor_spacing)


@dataclasses.dataclass(frozen=True, eq=False)
class MapFeatures:
    """One map with its fields and directions, and with corners and descriptors on demand.

    Attributes:
        prepared: Fields and surface of the map, in the local frame in which all features are.
        origin: Origin of that local frame in the frame of the map [m].
        directions: Dominant unsigned normals, strongest first.
        shares: Share of the surface along each.
        normals: Normals drawn by leverage, that rotations are judged by.
        late: Corners and descriptors, computed when first asked for.
        free_space: "observed" by the sensor, "inferred" from what encloses it, or "unknown".
        num_isolated: Occupied voxels of the map that lie far away from all the rest, and are not in its features.
        coarser: Features of the map in voxels so many times as wide, of those that were asked for.
    """

    prepared: PreparedMap
    origin: Float[np.ndarray, "3"]
    directions: Float[np.ndarray, "k 3"]
    shares: Float[np.ndarray, "k"]
    normals: Float32[np.ndarray, "s 3"]
    late: LateFeatures
    free_space: str
    num_isolated: int = 0
    coarser: dict[int, "MapFeatures"] = dataclasses.field(default_factory=dict)

    @property
    def corners(self) -> Corners:
        """Observed and virtual corners."""
        return self.late.corners

    @property
    def searched(self) -> "MapFeatures":
        """Features that poses were looked for with: those of the coarsest copy, which only wide maps have."""
        return self.coarser[max(self.coarser)] if self.coarser else self


def map_features(
    grid: VoxelGrid,
    *,
    origin: Float[np.ndarray, "3"] | None = None,
    num_isolated: int = 0,
    max_virtual: int = SourceConfig.max_virtual_corners,
    settings: MapConfig | None = None,
    rotation: RotationConfig | None = None,
    plane: PlaneConfig | None = None,
) -> MapFeatures:
    """Features of a map that has occupied voxels.

    Args:
        grid: A map at the working voxel size, in a frame in which it lies near zero.
        origin: Origin of that frame in the frame of the map [m]; None for a map in its own frame.
        num_isolated: Occupied voxels that were left out of the map beforehand.
        max_virtual: Largest number of virtual corners.
        settings: Whether free space is inferred, and when it is used; None for the defaults.
        rotation: How many normals and directions are taken; None for the defaults.
        plane: How the planes behind the corners are found; None for the defaults.
    """
    chosen = RotationConfig() if rotation is None else rotation
    prepared, free_space = _prepare(grid, MapConfig() if settings is None else settings)
    count = prepared.num_points
    normals, planarity = np.asarray(prepared.normals)[:count], np.asarray(prepared.planarity)[:count]
    leverage = planarity.astype(np.float64) * np.asarray(prepared.weights)[:count]
    # Normals of clutter point anywhere and would only blur the peaks of the directions.
    is_planar = planarity > chosen.min_planarity
    directions, shares = dominant_directions(normals[is_planar], planarity[is_planar], settings=chosen)
    # A map without any planar voxel has no leverage; its voxels then count alike.
    drawn = leverage if leverage.sum() > 0 else np.ones(count)
    return MapFeatures(
        prepared=prepared,
        origin=np.zeros(3) if origin is None else origin,
        directions=directions,
        shares=shares,
        normals=normals[draw_rows(drawn, chosen.num_normals)],
        late=LateFeatures(prepared.grid, max_virtual, plane, settings),
        free_space=free_space,
        num_isolated=num_isolated,
    )


def worse_free_space(a: MapFeatures, b: MapFeatures) -> str:
    """Where the less reliable free space of two maps is from."""
    return min(a.free_space, b.free_space, key=("unknown", "inferred", "observed").index)


def _prepare(grid: VoxelGrid, settings: MapConfig) -> tuple[PreparedMap, str]:
    """The prepared map, and where its free space is from."""
    if grid.num_free:
        return prepare_map(grid), "observed"
    if settings.infer_free_space:
        inferred = infer_free_space(
            grid, reach=settings.inferred_reach, min_directions=settings.inferred_directions
        )
        # The surface alone tells whether too little was inferred; the fields take most of the time.
        surface = map_surface(inferred)
        if surface.free_share >= settings.min_inferred:
            return prepare_map(surface), "inferred"
    # Without inferred free space, or with too little to be of use, the map counts as it was given.
    return prepare_map(grid), "unknown"
