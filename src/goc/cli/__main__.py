"""`python -m goc.cli`, where the script `goc` is not on the path."""

import sys

from goc.cli import main

sys.exit(main())
