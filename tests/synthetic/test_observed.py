import numpy as np

from voxjax.synthetic import simulate_team


def test_observed_corners_lie_on_occupied_voxels(two_rows):
    team = simulate_team(4, building=two_rows, overlap=0.5, drift=0.0, voxel_size=0.1)
    for grid, pose, seen in zip(team.grids, team.poses, team.is_observed, strict=True):
        assert pose is not None
        inverse = np.linalg.inv(pose)
        corners = team.corners.position[seen] @ inverse[:3, :3].T + inverse[:3, 3]
        points = grid.occupied_points()
        gap = np.sqrt(((corners[:, None] - points[None]) ** 2).sum(axis=-1).min(axis=1))
        assert len(gap) > 40
        assert np.median(gap) < 0.1
        assert gap.max() < 0.35
    rooms = team.corners.kind == "room"
    owner = np.repeat(np.arange(two_rows.num_rooms), 8)
    visited = np.isin(owner, team.rooms[0])
    share_visited, share_other = (team.is_observed[0][rooms][v].mean() for v in (visited, ~visited))
    assert share_visited > 0.6
    assert share_other < 0.5
