"""`python -m sprl_bench.cli`, where the script is not on the path."""

import sys

from sprl_bench.cli import main

sys.exit(main())
