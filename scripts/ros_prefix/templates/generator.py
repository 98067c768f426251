#!@PYTHON@
"""Command line of @MODULE@, as the CMake files call it."""
import argparse
import sys

from @MODULE@ import @FUNCTION@

parser = argparse.ArgumentParser()
parser.add_argument('--generator-arguments-file', required=True)
parser.add_argument('--typesupports', '--typesupport-impls', dest='typesupports', nargs='+', default=[])
arguments = parser.parse_args()
typesupports = [name for word in arguments.typesupports for name in word.split(';') if name]
@FUNCTION@(arguments.generator_arguments_file, *([typesupports] if typesupports else []))
sys.exit(0)
