"""`voxjax render`: maps as a picture."""

from pathlib import Path

from voxjax.cli.main import main


def test_render_draws_all_maps(maps):
    assert main(["render", *maps, "-o", "p.png"]) == 0
    assert Path("p.png").read_bytes().startswith(b"\x89PNG")
    assert main(["render", maps[0], "-o", "p.png"]) == 2
    assert main(["render", maps[0], "-o", "p.png", "--force", "--keep-ceiling"]) == 0
