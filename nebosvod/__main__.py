"""`python -m nebosvod` is the command `nebosvod`."""

import sys

from nebosvod.cli import main

sys.exit(main())
