"""PNG writer against Pillow's reader."""

import io

import numpy as np
import pytest
from PIL import Image

from voxjax.view import encode_png


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (64, 33)])
def test_pillow_reads_back_the_same_pixels(shape):
    image = np.random.default_rng(3).integers(0, 256, (*shape, 3)).astype(np.uint8)
    with Image.open(io.BytesIO(encode_png(image))) as read:
        read.load()
        assert (read.format, read.mode) == ("PNG", "RGB")
        np.testing.assert_array_equal(np.asarray(read), image)
