"""`python -m octoplan`: the command line."""

import sys

from octoplan import main

sys.exit(main())
