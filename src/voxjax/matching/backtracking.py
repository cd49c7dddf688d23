"""Algorithm 1 of the paper: the maximum common subgraph by backtracking over the corners of a.

Host code on purpose: the search is a tree of unequal branches. The checks against all matches so far are one
AND of bitsets, since the compatibility of all pairs is known beforehand.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from .._types import Array
from .associations import check_associations

MAX_BACKTRACKING_NODES = 3_000_000
"""Default budget; a node costs 1 to 3 microseconds."""

EARLY_COST = 200
"""An early transform takes as long as so many nodes (measured: 100 to 500), and counts as them."""


Extend = Callable[[np.ndarray], np.ndarray]
"""Takes five matches (5, 2) and gives the scheme (k, 2) that their transform leads to."""


class Schemes(NamedTuple):
    """What the backtracking found.

    Attributes:
        schemes: The largest schemes, int32 (k, 2) pairs each, all of the same k, in the order in which they
            appeared.
        completed: Whether the search ended inside its budget.
        has_all_ties: Whether no tied scheme was left out for `max_schemes`.
        num_nodes: Matches that were tried; an early transform counts as `EARLY_COST`.
    """

    schemes: tuple[np.ndarray, ...]
    completed: bool
    has_all_ties: bool
    num_nodes: int


def backtrack(
    associations: Int[Array, "k 2"],
    adjacency: Bool[Array, "m m"],
    *,
    extend: Extend | None = None,
    max_nodes: int = MAX_BACKTRACKING_NODES,
    max_schemes: int = 64,
) -> Schemes:
    """Search row by row: a row is a corner of a, its candidates are the corners of b it may match.

    A candidate that is compatible with all matches in M joins M and the next row is tried; a row without any
    is left unmatched; after the last row the scheme is complete and the search goes back one row. Branches
    that cannot reach the size of the best scheme are not entered, which changes no result of the exact
    search.

    Args:
        associations: Candidate pairs; all corners of a against all of b in the paper.
        adjacency: Compatibility of the associations, equation (4), from `consistency_graph`; may be padded.
        extend: Early transform. When M has five matches, the scheme that it returns is taken as the scheme of
            this branch and the search goes back. None searches exactly.
        max_nodes: Budget of matches tried; when it is spent, the best schemes so far are returned.
        max_schemes: Number of tied schemes that are kept.

    Returns:
        The schemes with most matches; one empty scheme if there is no candidate.

    References:
        Section IV.C, Algorithm 1.
    """
    # The points are not known here, so indices are only checked to be whole, not negative, and within int32.
    pairs = check_associations(associations, np.iinfo(np.int32).max, np.iinfo(np.int32).max)
    search = _Backtracking(
        pairs, np.asarray(adjacency)[: len(pairs), : len(pairs)], extend, max_nodes, max_schemes
    )
    completed = search.run()
    schemes = tuple(search.schemes) or (np.zeros((0, 2), np.int32),)
    return Schemes(schemes, completed, completed and search.has_all_ties, search.num_nodes)


@dataclass
class _Row:
    """One row on the path of the search.

    Attributes:
        row: Position of the row.
        untried: Bits of its candidates that were not tried yet.
        allowed: Bits of all associations that are compatible with M as it was before this row.
        is_matched: Whether a match of this row is in M now.
        is_finished: Whether the row was also tried unmatched.
    """

    row: int
    untried: int
    allowed: int
    is_matched: bool = False
    is_finished: bool = False


class _Backtracking:
    """The matrix M, the best schemes and the budget of one search."""

    def __init__(
        self,
        pairs: np.ndarray,
        adjacency: np.ndarray,
        extend: Extend | None,
        max_nodes: int,
        max_schemes: int,
    ):
        # Associations sorted by row, so that the rows after one are a range of bits.
        order = np.argsort(pairs[:, 0], kind="stable")
        self.pairs = pairs[order]
        packed = np.packbits(adjacency[np.ix_(order, order)], axis=1, bitorder="little")
        self.compatible = [int.from_bytes(row.tobytes(), "little") for row in packed]
        # No index is negative, so -1 before the first association starts the first row, too.
        starts = np.flatnonzero(np.diff(self.pairs[:, 0], prepend=-1)).tolist()
        ends = [*starts[1:], len(pairs)]
        self.rows = [(1 << end) - (1 << start) for start, end in zip(starts, ends, strict=False)]
        self.later = [(1 << len(pairs)) - (1 << end) for end in ends]
        self.extend = extend
        self.max_nodes, self.max_schemes = max_nodes, max_schemes
        # The best size is 1 before anything is found: an empty scheme, which the path without any match leads
        # to, is no result.
        self.num_nodes, self.best_size, self.has_all_ties = 0, 1, True
        self.schemes: list[np.ndarray] = []
        self.known: list[set[tuple[int, int]]] = []
        self.matches: list[int] = []
        self.stack: list[_Row] = []

    def run(self) -> bool:
        """Visit the whole tree; False if the budget ran out."""
        if len(self.pairs):
            everything = (1 << len(self.pairs)) - 1
            self.stack.append(_Row(0, everything & self.rows[0], everything))
        # The stack stands for recursion, whose depth would be the number of corners of a: Python ends its own at
        # a thousand unless told otherwise.
        while self.stack:
            # A row is met again when everything below it is done: its match then leaves M before the next one
            # is tried.
            top = self.stack[-1]
            if top.is_matched:
                self.matches.pop()
                top.is_matched = False
            if top.untried:
                # The budget is asked before a match is made, so that the schemes so far stand as they are.
                if self.num_nodes >= self.max_nodes:
                    return False
                self._match(top)
            elif not top.is_finished:
                # All candidates were tried: go on with this row unmatched, once.
                top.is_finished = True
                # The best scheme may well leave a corner of a out, which the other map may not show at all.
                self._advance(top.row, top.allowed & self.later[top.row])
            else:
                self.stack.pop()
        return True

    def _match(self, top: _Row) -> None:
        """The next compatible candidate of the row joins M."""
        # Section IV.C: a first transform is calculated when there are five matches.
        early_count = 5
        # The lowest bit comes first, that is the candidates in their given order: equal inputs find ties in
        # equal order.
        bit = (top.untried & -top.untried).bit_length() - 1
        top.untried &= top.untried - 1
        self.num_nodes += 1
        self.matches.append(bit)
        top.is_matched = True
        if self.extend is not None and len(self.matches) >= early_count:
            self._extend(self.extend)
        else:
            # What is compatible with all matches before and with this one stays allowed; rows up to this one
            # are decided.
            self._advance(top.row, top.allowed & self.compatible[bit] & self.later[top.row])

    def _advance(self, row: int, allowed: int) -> None:
        """Go to the next row that has a candidate, or finish the scheme."""
        if not allowed:
            self._record(self.pairs[self.matches])
            return
        if not self._may_reach(allowed):
            return
        row += 1
        # This ends, because `allowed` has bits of later rows alone and is not zero.
        while not allowed & self.rows[row]:
            row += 1
        self.stack.append(_Row(row, allowed & self.rows[row], allowed))

    def _may_reach(self, allowed: int) -> bool:
        """Whether enough rows have a candidate left to tie with the best, while there is room for ties."""
        needed = self.best_size - len(self.matches)
        if allowed.bit_count() < needed:
            return False
        # The number of candidates costs one instruction to compare; the number of rows, which a scheme has one
        # match each of at most, is the sharper bound and is only counted where the first lets the branch pass.
        num_rows = sum(1 for row in self.rows if row & allowed)
        # With exactly as many rows as are needed nothing larger can come, only ties.
        if num_rows == needed and len(self.schemes) >= self.max_schemes:
            self.has_all_ties = False
            return False
        return num_rows >= needed

    def _extend(self, extend: Extend) -> None:
        """Early transform, unless the five matches belong to a scheme that is known."""
        seed = self.pairs[self.matches]
        as_set = {(int(i), int(j)) for i, j in seed}
        # The transform of five matches of a known scheme would lead to that scheme again, or nearly.
        if any(as_set <= scheme for scheme in self.known):
            return
        # A search by transforms alone would otherwise not come to its budget for minutes.
        self.num_nodes += EARLY_COST
        self._record(extend(seed))

    def _record(self, scheme: np.ndarray) -> None:
        """Keep a scheme that is larger than the best, or tied with it and new."""
        if len(scheme) < self.best_size:
            return
        as_set = {(int(i), int(j)) for i, j in scheme}
        if len(scheme) > self.best_size:
            # Ties that were left out of smaller schemes do not matter any more.
            self.best_size, self.schemes, self.known, self.has_all_ties = len(scheme), [], [], True
        if as_set in self.known:
            return
        if len(self.schemes) >= self.max_schemes:
            self.has_all_ties = False
            return
        self.schemes.append(np.asarray(sorted(as_set), np.int32))
        self.known.append(as_set)
