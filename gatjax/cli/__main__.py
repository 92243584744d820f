"""`python -m gatjax.cli`."""

import sys

from gatjax.cli import main

sys.exit(main())
