"""Sizes of memory as people write them."""

import pytest

from voxjax._runtime.memory_sizes import gigabytes_of


@pytest.mark.parametrize(
    ("text", "gigabytes"),
    [
        *[
            (text, 2.0)
            for text in ("2", "2G", "2g", "2GB", "2 GB", " 2gb ", "2000M", "2000 MB", "2.0G", "+2")
        ],
        ("2 GiB", 2.147483648),
        ("2gib", 2.147483648),
        ("512MiB", 0.536870912),
        (".5G", 0.5),
        ("1.5e1", 15.0),
        (repr(0.05), 0.05),
        (repr(1e-7), 1e-7),
        (repr(1e22), 1e22),
    ],
)
def test_a_number_with_or_without_a_unit_is_gigabytes(text, gigabytes):
    assert gigabytes_of(text) == pytest.approx(gigabytes, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        " ",
        "G",
        "2T",
        "2K",
        "2Gi",
        "-1G",
        "0",
        "0M",
        "nan",
        "inf",
        "infG",
        "1e999",
        "2 G B",
        "1_000M",
        "two",
    ]
    + ["٢G", "9" * 400],
)
def test_other_texts_are_none(text):
    assert gigabytes_of(text) is None
