#!@PYTHON@
import sys

from @MODULE@ import main

sys.exit(main())
