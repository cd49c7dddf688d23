"""Candidate associations: index pairs (corner of a, corner of b) that a search may choose from."""

import numpy as np
from jaxtyping import Bool, Int, UInt8

from .._checks import InputError
from .._types import Array
from ..features.types import KIND_UNKNOWN


def all_associations(mask_a: Bool[Array, "n"], mask_b: Bool[Array, "m"]) -> np.ndarray:
    """Every corner of a with every corner of b, as nothing is known before (section IV.C).

    Args:
        mask_a: Which rows of the corners of a are corners.
        mask_b: Which rows of the corners of b are corners.

    Returns:
        int32 (k, 2) row indices, in lexicographic order.
    """
    rows_a = np.flatnonzero(np.asarray(mask_a)).astype(np.int32)
    rows_b = np.flatnonzero(np.asarray(mask_b)).astype(np.int32)
    return np.stack(np.meshgrid(rows_a, rows_b, indexing="ij"), axis=-1).reshape(-1, 2)


def same_kind(
    associations: Int[Array, "k 2"], convexity_a: UInt8[Array, "n"], convexity_b: UInt8[Array, "m"]
) -> np.ndarray:
    """The associations whose corners have equally many convex edges, as far as that is known.

    Args:
        associations: Index pairs.
        convexity_a: `Corners.convexity` of a.
        convexity_b: Convexity of the corners of b.
    """
    pairs = np.asarray(associations)
    kind_a, kind_b = np.asarray(convexity_a)[pairs[:, 0]], np.asarray(convexity_b)[pairs[:, 1]]
    # A corner whose faces were not seen may be of any kind, so it goes with all: an association that is left
    # out here cannot come back, whereas a wrong one still has to agree with all others.
    return pairs[(kind_a == kind_b) | (kind_a == KIND_UNKNOWN) | (kind_b == KIND_UNKNOWN)]


def check_associations(associations: Int[Array, "k 2"], count_a: int, count_b: int) -> np.ndarray:
    """The associations as int32 (k, 2) on the host.

    Raises:
        InputError: If the shape is wrong or an index does not exist.
    """
    pairs = np.asarray(associations)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or not np.issubdtype(pairs.dtype, np.integer):
        raise InputError(
            f"associations must be whole numbers of shape (k, 2), got {pairs.dtype} of shape {pairs.shape}."
        )
    # A negative index is refused although NumPy would take it: it would count from the end, and stands for
    # padding in the kernels.
    if len(pairs) and (pairs.min() < 0 or (pairs.max(axis=0) >= (count_a, count_b)).any()):
        raise InputError(
            f"associations must index {count_a} points of a and {count_b} of b from 0, "
            f"got indices from {pairs.min()} to {pairs.max(axis=0).tolist()}."
        )
    return pairs.astype(np.int32)
