"""Region growing over surface elements (section III, reference 12), as connected components.

Sequential region growing starts at the smallest curvature, adds neighbours whose normal is within the
smoothness angle of the current seed's, and lets those of low curvature be seeds in turn. The angle between
two normals is symmetric, so the seeds of a region are a connected component of the graph of low-curvature
elements whose edges are neighbours with similar normals; an element of high curvature goes to the first
region, in order of the regions' smallest curvature, that has a seed beside it with a similar normal. That is
what is computed here, and the tests compare it with the sequential loop element by element. One difference:
elements of high curvature that no region reached stay without label instead of forming regions of at most 27
elements of their own.
"""

import numpy as np
from jaxtyping import Bool, Float32, Int32
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from .surface import Surface


def segment_planes(
    surface: Surface, *, max_angle: float = 15.0, max_curvature: float = 0.08, min_elements: int = 1
) -> Int32[np.ndarray, "n"]:
    """Label each surface element with its region.

    Args:
        surface: Surface elements and which of them touch.
        max_angle: Smoothness threshold: largest angle between the normals of a seed and its neighbour
            [degree].
        max_curvature: Curvature threshold: elements below it may be seeds.
        min_elements: Regions with fewer elements lose their label.

    Returns:
        int32 (n,): 0 for the region of the smallest curvature, 1 for the next, ...; -1 without region.
    """
    is_seed = surface.curvature < max_curvature
    is_edge = _similar(surface, np.cos(np.radians(max_angle)))
    labels = grow_segments(surface.pairs[is_edge], is_seed, surface.curvature)
    return keep_large(labels, min_elements)


def _similar(surface: Surface, min_cosine: float) -> Bool[np.ndarray, "m"]:
    """Whether the normals of each pair agree; the sign counts where both are signed."""
    i, j = surface.pairs.T
    cosine = np.einsum("ij,ij->i", surface.normal[i], surface.normal[j])
    both = surface.is_signed[i] & surface.is_signed[j]
    return np.where(both, cosine, np.abs(cosine)) > min_cosine


def grow_segments(
    edges: Int32[np.ndarray, "m 2"], is_seed: Bool[np.ndarray, "n"], curvature: Float32[np.ndarray, "n"]
) -> Int32[np.ndarray, "n"]:
    """Regions of seeds joined by edges, in order of their smallest curvature, and the border elements they reach."""
    n = len(is_seed)
    labels = np.full(n, -1, np.int32)
    if not is_seed.any():
        return labels
    i, j = edges.T
    core = is_seed[i] & is_seed[j]
    # Components give what the loop from seed to seed gives, as said above.
    graph = coo_matrix((np.ones(np.count_nonzero(core), np.int8), (i[core], j[core])), shape=(n, n))
    component = connected_components(graph, directed=False)[1]
    labels[is_seed] = _rank_by_curvature(component[is_seed], curvature[is_seed])
    # Border: the first region that has a seed beside the element.
    # There are at most n regions, so n stands for none and loses every minimum.
    border = np.full(n, n, np.int32)
    for seed, other in ((i, j), (j, i)):
        reached = is_seed[seed] & ~is_seed[other]
        # An element may be reached from many seeds: plain indexing would keep the last of them instead of the
        # lowest.
        np.minimum.at(border, other[reached], labels[seed[reached]])
    is_reached = ~is_seed & (border < n)
    labels[is_reached] = border[is_reached]
    return labels


def _rank_by_curvature(component: np.ndarray, curvature: np.ndarray) -> np.ndarray:
    """Number the components in order of their smallest curvature (ties: first element first)."""
    order = np.argsort(curvature, kind="stable")
    ids, first = np.unique(component[order], return_index=True)
    # Numbers follow the curvature, so that the first segment that reaches an element is the one of the sequential
    # loop.
    rank = np.empty(component.max() + 1, np.int32)
    rank[ids[np.argsort(first)]] = np.arange(len(ids), dtype=np.int32)
    return rank[component]


def keep_large(labels: Int32[np.ndarray, "n"], min_elements: int) -> Int32[np.ndarray, "n"]:
    """Drop regions with fewer than `min_elements` elements and close the gaps in the numbering."""
    if labels.size == 0 or labels.max() < 0:
        return labels
    sizes = np.bincount(labels[labels >= 0])
    is_kept = sizes >= min_elements
    new = np.where(is_kept, np.cumsum(is_kept) - 1, -1).astype(np.int32)
    return np.where(labels >= 0, new[labels], -1).astype(np.int32)
