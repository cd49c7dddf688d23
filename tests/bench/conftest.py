"""The benchmarks are no part of the installed package: the project's folder goes on the path."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
