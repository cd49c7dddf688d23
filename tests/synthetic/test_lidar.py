import numpy as np

from oracles.motions import pose_of
from voxjax.synthetic import Lidar
from voxjax.synthetic.lidar import take_scan


def test_scan_echoes_lie_on_surfaces(storey):
    T = pose_of(translation=[*storey.plan.rooms[0].polygon.mean(axis=0), 1.3])
    scan = take_scan(
        np.random.default_rng(0), storey.scene, T, Lidar(range_noise=0.0, people=0.0, num_azimuths=90)
    )
    distance = storey.solids.distance(scan.points[: scan.num_hits] + T[:3, 3])
    assert np.abs(distance).min(axis=1).max() < 1e-3
    assert (distance.min(axis=1) > -1e-3).all()


def test_dropout_noise_and_people_show_in_scans(storey):
    T = pose_of(translation=[*storey.plan.rooms[0].polygon.mean(axis=0), 1.3])

    def scan(**options):
        base = {"range_noise": 0.0, "dropout": 0.0, "people": 0.0, "num_azimuths": 90}
        return take_scan(np.random.default_rng(4), storey.scene, T, Lidar(**{**base, **options}))

    clean, noisy, crowded = scan(), scan(range_noise=0.03), scan(people=50.0)
    assert len(clean.points) == 90 * 48
    clean_range, noisy_range = (np.linalg.norm(s.points[: s.num_hits], axis=1) for s in (clean, noisy))
    radial = noisy_range - clean_range
    np.testing.assert_allclose(radial.std(), 0.03, rtol=0.1)
    np.testing.assert_allclose(len(scan(dropout=0.3).points) / len(clean.points), 0.7, atol=0.03)
    hits = np.linalg.norm(crowded.points, axis=1) < np.linalg.norm(clean.points, axis=1) - 0.1
    assert hits.sum() > 20
