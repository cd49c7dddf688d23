"""Pictures without display, browser or GPU, and a page to turn the map around in.

The command line and the notebooks draw with it. Start at `draw_maps` for maps beside each other and at `draw_merge` for
what a merge has found.
"""

from .ceiling import ceiling_cut as ceiling_cut
from .page import check_page_support as check_page_support
from .page import page_html as page_html
from .png import encode_png as encode_png
from .sheet import draw_grid as draw_grid
from .sheet import draw_maps as draw_maps
from .sheet import draw_merge as draw_merge
from .sheet import grid_png as grid_png
