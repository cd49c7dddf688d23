"""`python -m voxjax` is the command `voxjax`."""

import sys

from .cli.main import main

if __name__ == "__main__":
    sys.exit(main())
