"""Outcomes of data, as values: each with a sentence that says what happened and what to do."""

import optimistix as optx


class RESULTS(optx.RESULTS):  # pyright: ignore[reportGeneralTypeIssues]
    """How a stage ended. Failures of data are results, not exceptions."""

    successful = ""
    empty_map = "A map has no occupied voxel, so there is nothing to align."
    too_few_corners = (
        "Fewer than three corners were found in a map; use a finer voxel size or another source."
    )
    too_few_associations = "Fewer than three associations agree, which does not fix a pose."
    budget_exhausted = "The search stopped at its node budget; the best clique so far may not be the largest."
    degenerate = "The matches do not fix all six degrees of freedom of the pose."
    not_converged = "The refinement stopped at its step limit before it converged."
    no_overlap = "No pose is supported by the maps' occupied and free space."
    ambiguous = "Several poses explain the maps almost equally well."
    mirrored = "A map seems to be mirrored; flip one of its axes."
    scaled = "A map seems to have another scale or unit of length; bring both to metres."
