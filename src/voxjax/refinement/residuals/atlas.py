"""The surfaces and fields of many maps in common tables: what differs from map to map is then a few numbers.

Kernels that work on many pairs of maps at once read the same tables for all of them; stacked, each pair would have a
copy of its own.
"""

from ..._types import Array
from ...ops.evidence.lookup import Block
from .fields import Field
from .planes import NearestSurface


class AtlasBlock(Block):
    """Where the cells of one map lie in the pool of all maps.

    Attributes:
        dims: Size of the map's block [voxel], then where its blocks begin in the common table.
        table: The common table, whose rows are those of a pool of all maps.
    """

    __slots__ = ()

    def rows_of(self, block: Array) -> Array:
        """See `Block`; blocks are numbered over all maps."""
        # Whether a place is inside was asked of the map's own block before: neighbours in the table are other maps.
        return super().rows_of(block + self.dims[3])


class AtlasSurface(NearestSurface):
    """A `NearestSurface` whose keys, points, normals, planarities and trust are those of all maps, one after the other.

    Attributes:
        dims: Size of the map's block [voxel], then where its blocks begin in the common table.
    """

    __slots__ = ()

    @property
    def block(self) -> AtlasBlock:
        """Where the map's keys lie."""
        return AtlasBlock(self.dims, self.origin, self.voxel_size, self.table)


class AtlasField(Field):
    """A `Field` whose rows and values are those of all maps, one after the other; `outside` is the map's own.

    Attributes:
        dims: Size of the map's block [voxel], then where its blocks begin in the common table.
    """

    __slots__ = ()

    @property
    def block(self) -> AtlasBlock:
        """Where the map's rows lie."""
        return AtlasBlock(self.dims, self.origin, self.voxel_size, self.table)
