"""A 5 x 7 pixel alphabet, so that labels need no font file. Lower case is drawn as upper case."""

import numpy as np
from jaxtyping import Bool, UInt8

# One word for each character, one base-32 digit for each of its seven rows: the five bits of a digit are the five
# pixels of the row, left to right.
_CHARACTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,:-+%/()_=?|#'<>*"
_ROWS = """
    ehhvhhh uhhuhhu ehggghe uhhhhhu vgguggv vgguggg ehgnhhe hhhvhhh e44444e 72222ic
    hikokih ggggggv hrllhhh hhpljhh ehhhhhe uhhuggg ehhhlid uhhukih ehge1he v444444
    hhhhhhe hhhhha4 hhhllla hha4ahh hha4444 v1248gv ehjlphe 4c4444e eh1248v v2421he
    26aiv22 vgu11he 68guhhe v124888 ehhehhe ehhf12c 0000000 00000cc 0000c48 0cc0cc0
    000e000 044v440 op248j3 01248g0 2488842 8422248 000000v 00v0v00 eh12404 4444444
    aavavaa 4400000 248g842 8421248 04lel40
"""
_GLYPHS = dict(zip(_CHARACTERS, _ROWS.split(), strict=True))
GLYPH_HEIGHT = 7
GLYPH_ADVANCE = 6


def text_mask(text: str, scale: int = 2) -> Bool[np.ndarray, "height width"]:
    """Return where the ink of one line of text lies; unknown characters are drawn as `?`."""
    mask = np.zeros((GLYPH_HEIGHT, GLYPH_ADVANCE * max(len(text), 1)), bool)
    for place, letter in enumerate(text.upper()):
        digits = [int(digit, 32) for digit in _GLYPHS.get(letter, _GLYPHS["?"])]
        rows = np.asarray(digits, np.int32)[:, None] >> np.arange(4, -1, -1, dtype=np.int32) & 1
        mask[:, GLYPH_ADVANCE * place : GLYPH_ADVANCE * place + 5] = rows.astype(bool)
    return mask.repeat(scale, axis=0).repeat(scale, axis=1)


def write_text(
    image: UInt8[np.ndarray, "height width 3"],
    text: str,
    *,
    left: int,
    top: int,
    color: tuple[int, int, int] = (40, 44, 52),
    scale: int = 2,
) -> None:
    """Draw one line of text into `image`; what does not fit is cut off."""
    mask = text_mask(text, scale)[: max(image.shape[0] - top, 0), : max(image.shape[1] - left, 0)]
    window = image[top : top + mask.shape[0], left : left + mask.shape[1]]
    window[mask] = color
