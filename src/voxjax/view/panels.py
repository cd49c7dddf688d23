"""Pictures put together: titles, legends, rows and columns of panels."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import UInt8

from .colors import BACKGROUND, INK
from .font import GLYPH_ADVANCE, write_text

Image = UInt8[np.ndarray, "_ _ 3"]


def titled(image: Image, title: str, color: tuple[int, int, int] = INK) -> Image:
    """The image below a line of text; a title that is too long ends in two dots."""
    line = np.full((34, image.shape[1], 3), BACKGROUND, np.uint8)
    longest = (image.shape[1] - 16) // (2 * GLYPH_ADVANCE)
    text = title if len(title) <= longest else title[: longest - 2] + ".."
    write_text(line, text, left=8, top=10, color=color)
    return np.concatenate([line, image])


def legend(entries: Sequence[tuple[str, tuple[int, int, int]]], width: int) -> Image:
    """One line of coloured squares, each with its meaning on its right."""
    line = np.full((42, width, 3), BACKGROUND, np.uint8)
    square, gap = 18, 30
    left = 8
    for label, color in entries:
        line[10 : 10 + square, left : left + square] = color
        write_text(line, label, left=left + square + 10, top=12)
        left += square + 10 + 2 * GLYPH_ADVANCE * len(label) + gap
    return line


def stack(images: Sequence[Image]) -> Image:
    """Images of any width one below the other."""
    width = max(image.shape[1] for image in images)
    return np.concatenate([_padded(image, image.shape[0], width) for image in images])


def rows(images: Sequence[Image], *, per_row: int) -> Image:
    """Images side by side, `per_row` in each row."""
    found = []
    for start in range(0, len(images), per_row):
        row = images[start : start + per_row]
        height = max(image.shape[0] for image in row)
        found.append(np.concatenate([_padded(image, height, image.shape[1]) for image in row], axis=1))
    return stack(found)


def trimmed(images: Sequence[Image], *, margin: int = 12) -> list[Image]:
    """Images of one height without the rows, above and below, that are background in all of them.

    Args:
        images: Pictures that will stand side by side, so that all of them lose the same rows.
        margin: Background that stays above and below [pixel].
    """
    is_drawn = np.any([(image != np.asarray(BACKGROUND)).any(axis=(1, 2)) for image in images], axis=0)
    # Any row that one of them needs stays in all, so that the images keep one height.
    drawn = np.flatnonzero(is_drawn)
    if not len(drawn):
        return list(images)
    low, high = max(int(drawn[0]) - margin, 0), int(drawn[-1]) + 1 + margin
    return [image[low:high] for image in images]


def framed(image: Image, *, margin: int = 24) -> Image:
    """The image with a margin [pixel] on all sides."""
    around = ((margin, margin), (margin, margin), (0, 0))
    return np.pad(image, around, constant_values=BACKGROUND[0])


def _padded(image: Image, height: int, width: int) -> Image:
    """The image in the upper left of a background of the given size [pixel]."""
    canvas = np.full((height, width, 3), BACKGROUND, np.uint8)
    canvas[: image.shape[0], : image.shape[1]] = image
    return canvas
