"""Text at the beginning of map files: lines of words, with lengths and numbers that are bounded."""

from collections.abc import Iterator


def header_lines(data: bytes, *, most: int = 65536) -> Iterator[tuple[list[str], int]]:
    """The lines after the first one, until they are no header any more.

    Args:
        data: A whole file.
        most: Lines that begin after this many bytes, or are longer, belong to no header.

    Yields:
        Words of a line, and where the next line starts.
    """
    # Without any end of a line this is 0, and there is no header.
    position = data.find(b"\n", 0, most) + 1
    while 0 < position < most:
        end = data.find(b"\n", position, position + most)
        if end < 0:
            return
        # Every byte is a letter of latin-1: comments in other encodings do no harm.
        words = data[position:end].decode("latin-1").split()
        position = end + 1
        yield words, position


def whole_number(text: str, *, most_digits: int = 18) -> int | None:
    """The number that a text of digits gives; None for other texts, and for numbers that no file can mean.

    Python refuses to read numbers of more than some 4300 digits, and takes long for those just below.
    """
    # `isdigit` knows digits of all scripts and raised ones, and `int` not all of them.
    is_number = text.isascii() and text.isdigit() and len(text) <= most_digits
    return int(text) if is_number else None
