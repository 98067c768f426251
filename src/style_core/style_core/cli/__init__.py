"""The ``motion-style`` command: one entry point, one module a sub-command, loaded when it is called."""
import argparse
import importlib
import os
import sys
import warnings

from style_core import __version__
from style_core.cli.registry import COMMANDS, KIND_COMMANDS
from style_core.errors import ModelError, MotionError, UsageError

__all__ = ['main']


def main(argv=None):
    """Run ``motion-style``; returns the exit status (0 done, 1 failed with one clear line, 2 wrong use)."""
    argv = list(sys.argv[1:] if argv is None else argv)
    parser = argparse.ArgumentParser(
        prog='motion-style', description='Learn, predict, synthesise and evaluate stylistic motion.',
        epilog='motion-style COMMAND --help explains a command.')
    parser.add_argument('--version', action='version', version=f'motion-style {__version__}')
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    called = next((word for word in argv if not word.startswith('-')), None)
    try:
        module = None
        for name, (summary, path) in COMMANDS.items():
            if path == 'style_core.cli.by_kind' and not KIND_COMMANDS[name]:
                continue
            sub = commands.add_parser(name, help=summary, formatter_class=argparse.RawDescriptionHelpFormatter)
            if name == called:  # only the command that runs is imported
                module = importlib.import_module(path)
                sub.description = module.__doc__
                module.add_arguments(sub, argv[argv.index(called) + 1:])
        args = parser.parse_args(argv)
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_: print(f'motion-style {called}: {message}', file=sys.stderr)
            status = module.run(args) or 0
        sys.stdout.flush()
        return status
    except UsageError as error:
        print(f'motion-style {called}: {error}', file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output has gone (``| head``)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (MotionError, ModelError, OSError) as error:
        print(f'motion-style {called}: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'motion-style {called}: interrupted', file=sys.stderr)
        return 130
