"""The page: complete with its extra, one sentence without it."""

from importlib.util import find_spec

import numpy as np
import pytest

from voxjax import InputError, VoxelGrid
from voxjax.view import page, page_html


def _cube():
    return VoxelGrid(np.full((4, 4, 4), 2, np.uint8), np.zeros(3, np.float32), 0.5)


def test_without_the_extra_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(page, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install 'voxjax\[view\]'"):
        page_html([_cube()], [np.eye(4)], _cube())


@pytest.mark.skipif(find_spec("viser") is None, reason="needs the extra voxjax[view]")
def test_the_page_is_one_html_document(capsys):
    html = page_html([_cube()], [np.eye(4)], _cube())
    assert html.lstrip().lower().startswith("<!doctype html")
    assert capsys.readouterr().out == ""
