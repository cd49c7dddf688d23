"""From grown regions to planes of real maps: split what is not flat, extend, merge what is one plane.

Region growing over- and under-segments, as the paper says; maps of real sensors have holes, walls two or
three voxels thick and noise. Each step here is one vectorised pass over all segments at the same time.
"""

import numpy as np
from jaxtyping import Float, Int32
from scipy.sparse import coo_matrix

from .grow import grow_segments, keep_large
from .segments import SegmentPlanes, plane_of_segments
from .surface import Surface


def split_segments(
    surface: Surface,
    labels: Int32[np.ndarray, "n"],
    *,
    max_rms: float,
    distance: float,
    max_angle: float,
    min_elements: int,
    num_rounds: int = 10,
) -> Int32[np.ndarray, "n"]:
    """Peel one plane off each segment that is not flat, and regrow the rest, `num_rounds` times.

    Args:
        surface: Surface elements.
        labels: Segment of each element, -1 for none.
        max_rms: Segments with a larger rms distance are split [voxel].
        distance: Inliers of a peeled plane lie within this [voxel] ...
        max_angle: ... and their normals within this [degree].
        min_elements: Smaller pieces lose their label.
        num_rounds: Number of planes that can be peeled off one segment.

    Returns:
        New labels; segments that are still not flat lose theirs.
    """
    points, edges, is_active = surface.index.astype(np.float64), surface.pairs, labels >= 0
    min_cosine = np.cos(np.radians(max_angle))
    # A round peels one plane off every bad segment at once; regions numbered anew after the others are the next
    # round's.
    for number in range(num_rounds):
        num = int(labels.max(initial=-1)) + 1
        # Flat segments stay as they are, so each round looks only at what the round before found bad.
        is_bad = _planes_of(surface, points, labels, is_active, num).rms > max_rms
        if not is_bad.any():
            return labels
        is_active = (labels >= 0) & is_bad[labels]
        inlier = _peel(surface, points, labels, is_active, num, distance, min_cosine)
        rest = is_active & ~inlier
        i, j = edges.T
        # A piece can only grow within its own segment: what was apart before stays apart.
        edges = edges[is_active[i] & is_active[j] & (labels[i] == labels[j])]
        # The angles between elements do not change, so that one round is enough to leave such edges out.
        if number == 0:
            edges = edges[_agree(surface, edges) > min_cosine]
        i, j = edges.T
        regrown = grow_segments(edges[rest[i] & rest[j]], rest, surface.curvature)
        labels = np.where(rest, np.where(regrown >= 0, regrown + num, -1), labels).astype(np.int32)
        labels = keep_large(labels, min_elements)
        is_active &= labels >= 0
    planes = _planes_of(surface, points, labels, is_active, int(labels.max(initial=-1)) + 1)
    bad = (labels >= 0) & (planes.rms > max_rms)[labels] if len(planes.rms) else np.zeros(len(labels), bool)
    return keep_large(np.where(bad, -1, labels).astype(np.int32), min_elements)


def _planes_of(
    surface: Surface, points: np.ndarray, labels: np.ndarray, is_active: np.ndarray, num: int
) -> SegmentPlanes:
    """Planes of the active elements' segments; those of other segments are empty."""
    rows = np.flatnonzero(is_active)
    return plane_of_segments(points[rows], surface.normal[rows], labels[rows], num)


def _peel(surface, points, labels, in_bad, num, distance, min_cosine):
    """Inliers of one plane for each bad segment, started at its smallest curvature and refitted three times."""
    rows = np.flatnonzero(in_bad)
    rows = rows[np.argsort(surface.curvature[rows], kind="stable")]
    ids, first = np.unique(labels[rows], return_index=True)
    seed = np.zeros(num, np.int64)
    seed[ids] = rows[first]
    normal, centre = surface.normal[seed].astype(np.float64), points[seed]
    inlier = np.zeros(len(labels), bool)
    # Wider at first: the normal of a single element is biased by the lattice.
    for factor in (1.5, 1.2, 1.0):
        label = labels[rows]
        offset = np.abs(np.einsum("ij,ij->i", points[rows] - centre[label], normal[label]))
        cosine = np.einsum("ij,ij->i", surface.normal[rows], normal[label])
        inlier[rows] = (offset < factor * distance) & (cosine > min_cosine - 0.1 * (factor - 1.0))
        planes = plane_of_segments(points, surface.normal, np.where(inlier, labels, -1), num)
        # Fewer than six inliers say too little for a plane of their own: the one from before stays.
        enough = planes.count >= 6
        normal = np.where(enough[:, None], planes.normal, normal)
        centre = np.where(enough[:, None], planes.centroid, centre)
    return inlier


def _agree(surface: Surface, pairs: np.ndarray) -> np.ndarray:
    """Cosine between the normals of pairs; absolute where a sign is unknown."""
    i, j = pairs.T
    cosine = np.einsum("ij,ij->i", surface.normal[i], surface.normal[j])
    return np.where(surface.is_signed[i] & surface.is_signed[j], cosine, np.abs(cosine))


def extend_segments(
    surface: Surface,
    labels: Int32[np.ndarray, "n"],
    *,
    distance: float,
    min_cosine: float = 0.3,
    num_steps: int = 3,
) -> Int32[np.ndarray, "n"]:
    """Give elements beside a segment its label where they lie on its plane; drop those that do not.

    Args:
        surface: Surface elements.
        labels: Segment of each element, -1 for none.
        distance: Largest distance from the plane [voxel].
        min_cosine: Smallest cosine between an element's normal and the plane's; loose, because the normals
            beside an edge lean toward the other face.
        num_steps: Steps of one voxel.
    """
    points = surface.index.astype(np.float64)
    num = int(labels.max(initial=-1)) + 1
    if num == 0:
        return labels
    planes = plane_of_segments(points, surface.normal, labels, num)
    fits = _fits(surface, points, planes, distance, min_cosine)
    rows = np.flatnonzero(labels >= 0)
    labels = labels.copy()
    # What leaves its plane is dropped before anything is added, so that it carries no label on to its
    # neighbours.
    labels[rows[fits(rows, labels[rows]) > distance]] = -1
    has_label = labels >= 0
    i, j = surface.pairs.T
    # Pairs inside of segments, which are most, have nothing to give to each other.
    is_open = ~(has_label[i] & has_label[j])
    i, j = i[is_open], j[is_open]
    # Labels move by one voxel a step, and only from elements that have one; the planes stay those from before.
    for _ in range(num_steps):
        has_label = labels >= 0
        forward, backward = has_label[j] & ~has_label[i], has_label[i] & ~has_label[j]
        element = np.concatenate([i[forward], j[backward]])
        label = labels[np.concatenate([j[forward], i[backward]])]
        offset = fits(element, label)
        good = offset <= distance
        element, label, offset = element[good], label[good], offset[good]
        # Each element goes to the nearest plane; of equally near ones to the first, so that the order of the
        # pairs does not matter.
        order = np.lexsort((label, offset, element))
        unique, first = np.unique(element[order], return_index=True)
        labels[unique] = label[order][first]
    return labels


def _fits(surface: Surface, points: np.ndarray, planes: SegmentPlanes, distance: float, min_cosine: float):
    """A function (rows, labels) -> distance from the plane, infinite where the normals disagree."""

    def offset(rows: np.ndarray, label: np.ndarray) -> np.ndarray:
        cosine = np.einsum("ij,ij->i", surface.normal[rows], planes.normal[label])
        cosine = np.where(surface.is_signed[rows], cosine, np.abs(cosine))
        return np.where(cosine > min_cosine, np.abs(planes.distance(points[rows], label)), np.inf)

    return offset


def merge_segments(
    surface: Surface, labels: Int32[np.ndarray, "n"], *, max_rms: float, max_angle: float, gap: float
) -> Int32[np.ndarray, "n"]:
    """Join segments that lie on one plane and are near each other; each joins the largest that fits it.

    Args:
        surface: Surface elements.
        labels: Segment of each element, -1 for none.
        max_rms: Largest rms distance of the smaller segment from the larger one's plane [voxel].
        max_angle: Largest angle between the mean normals [degree].
        gap: Segments farther apart than about this stay apart [voxel].
    """
    points = surface.index.astype(np.float64)
    num = int(labels.max(initial=-1)) + 1
    if num < 2:
        return labels
    planes = plane_of_segments(points, surface.normal, labels, num)
    small, large = near_segments(points, labels, num, gap)
    # Each pair comes both ways; of equal sizes the first row counts as larger, so that no two segments join
    # each other.
    bigger = (planes.count[large] > planes.count[small]) | (
        (planes.count[large] == planes.count[small]) & (large < small)
    )
    small, large = small[bigger], large[bigger]
    n = planes.normal[large]
    offset = np.einsum("ij,ij->i", planes.centroid[small] - planes.centroid[large], n)
    # The mean square distance from another plane is the variance along its normal and the square of the
    # middle's offset: no element has to be looked at again.
    rms = np.sqrt(np.maximum(np.einsum("ij,ijk,ik->i", n, planes.covariance[small], n), 0.0) + offset**2)
    cosine = np.einsum("ij,ij->i", planes.normal[small], n)
    # The normal of a small segment says little: its elements' distances say more.
    size_limit = np.where(planes.count[small] < 60, 2.0 * max_angle, max_angle)
    fits = (rms < max_rms) & (cosine > np.cos(np.radians(size_limit)))
    small, large, rms = small[fits], large[fits], rms[fits]
    # The last key counts first: for each small segment the largest that fits it.
    order = np.lexsort((large, -planes.count[large], small))
    unique, first = np.unique(small[order], return_index=True)
    target = np.arange(num)
    target[unique] = large[order][first]
    # Only into segments that stay, so that errors do not add up along chains.
    is_root = target == np.arange(num)
    target = np.where(is_root[target], target, np.arange(num))
    merged = np.where(labels >= 0, target[labels], -1).astype(np.int32)
    return keep_large(merged, 1)


def drop_narrow(
    surface: Surface, labels: Int32[np.ndarray, "n"], *, min_width: float
) -> Int32[np.ndarray, "n"]:
    """Take the label from segments narrower than `min_width` [voxel]: rounded edges, door frames, cables.

    The width is that of a rectangle with the same second moment across the segment.
    """
    num = int(labels.max(initial=-1)) + 1
    if num == 0:
        return labels
    covariance = plane_of_segments(surface.index.astype(np.float64), surface.normal, labels, num).covariance
    is_wide = np.sqrt(12.0 * np.maximum(np.linalg.eigvalsh(covariance)[:, 1], 0.0)) >= min_width
    return keep_large(np.where((labels >= 0) & is_wide[labels], labels, -1).astype(np.int32), 1)


def near_segments(
    points: Float[np.ndarray, "n 3"], labels: Int32[np.ndarray, "n"], num: int, gap: float
) -> tuple[np.ndarray, np.ndarray]:
    """Ordered pairs of different segments that come within about `gap` of each other, by blocks of that edge."""
    used = labels >= 0
    block = np.floor(points[used] / gap).astype(np.int64)
    block -= block.min(axis=0) - 1 if len(block) else -1  # from the map on, however far out it lies
    shape = block.max(axis=0, initial=0) + 2
    strides = np.asarray([shape[1] * shape[2], shape[2], 1])
    key = np.unique(labels[used].astype(np.int64) * int(np.prod(shape)) + block @ strides)
    label, block_id = np.divmod(key, int(np.prod(shape)))
    # Two segments are near if one has a block among the 27 around a block of the other; the product of both
    # incidence matrices asks this of all pairs at once.
    steps = np.stack(np.meshgrid(*[[-1, 0, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3) @ strides
    spread = (block_id[:, None] + steps[None, :]).ravel()
    # Columns are the blocks that occur: the box around a map has far more than its surfaces touch.
    ids, compact = np.unique(np.concatenate([block_id, spread]), return_inverse=True)
    own = coo_matrix((np.ones(len(label), np.int32), (label, compact[: len(label)])), shape=(num, len(ids)))
    wide = coo_matrix(
        (np.ones(len(spread), np.int32), (np.repeat(label, 27), compact[len(label) :])), shape=(num, len(ids))
    )
    a, b = (wide.tocsr() @ own.tocsr().T).nonzero()
    return a[a != b], b[a != b]
