"""``python -m tbsa``: the command `tbsa`, for where scripts are not on the path."""

import sys

from tbsa.work.cli import main

if __name__ == "__main__":
    sys.exit(main())
