"""`python -m nebosvod` is the command `nebosvod`."""

import sys
from pathlib import Path

# `-m` puts the working directory first, where a file numpy.py is somebody's own: it is for the program only where the
# program stands there itself, at the root of a checkout
if not sys.flags.safe_path and sys.path and Path(__file__).resolve().parent.parent != Path(sys.path[0]).resolve():
    del sys.path[0]

from nebosvod.cli import entry

entry()
