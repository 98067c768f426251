"""``python -m style_core``: the ``motion-style`` command."""
import sys

from style_core.cli import main

if __name__ == '__main__':
    sys.exit(main())
