"""The ``motion-style`` command: one entry point, one module a sub-command, loaded when it is called."""
import argparse
import contextlib
import importlib
import os
import signal
import sys
import warnings

from style_core import __version__
from style_core.cli.files import check_outputs, find_inputs, saying_written
from style_core.cli.parser import Parser
from style_core.cli.registry import COMMANDS, KIND_COMMANDS
from style_core.errors import ModelError, MotionError, UsageError

__all__ = ['main']

#: characters of a complaint that are shown
_LONGEST = 600


def main(argv=None):
    """Run ``motion-style``; returns the exit status (0 done, 1 failed with one clear line, 2 wrong use)."""
    if argv is None and '_ARGCOMPLETE' in os.environ:
        _complete()
    argv = list(sys.argv[1:] if argv is None else argv)
    called = next((word for word in argv if not word.startswith('-')), None)
    with _ended_in_order():
        try:
            try:
                return _run(argv, called)
            finally:
                if sys.stdout is not None:      # also after --help: a reader that has gone must show here, not at exit
                    sys.stdout.flush()
        except UsageError as error:
            return _complain(called, error, 2)
        except BrokenPipeError:     # the reader of our output has gone (``| head``)
            _drop(sys.stdout)
            return 141
        except (MotionError, ModelError) as error:
            return _complain(called, error, 1)
        except OSError as error:
            if error.filename is None:      # our output: a full disk, a closed terminal
                _drop(sys.stdout)
            return _complain(called, error, 1)
        except MemoryError as error:
            return _complain(called, f'there is not enough memory for this{f" ({error})" if str(error) else ""}', 1)
        except RecursionError:
            return _complain(called, 'an argument or a file is nested too deeply to be read', 1)
        except _Terminated:
            return _complain(called, 'terminated', 143)
        except KeyboardInterrupt:
            return _complain(called, 'interrupted', 130)


def _run(argv, called):
    parser, module = _parser(argv, called)
    args = parser.parse_args(argv)
    find_inputs(args)
    check_outputs(args)
    with warnings.catch_warnings(), saying_written(args):
        warnings.showwarning = lambda message, *_: _complain(called, message, 0)
        return module.run(args) or 0


def _parser(argv, called):
    """The parser of every command, of which only the one that is called has arguments, and that one's module."""
    module = None
    parser = Parser(
        prog='motion-style', description='Learn, predict, synthesise and evaluate stylistic motion.',
        epilog='motion-style COMMAND --help explains a command.')
    parser.add_argument('--version', action='version', version=f'motion-style {__version__}')
    commands = parser.add_subparsers(dest='command', metavar='COMMAND', required=True)
    for name, (summary, path) in COMMANDS.items():
        if path == 'style_core.cli.by_kind' and not KIND_COMMANDS[name]:
            continue
        sub = commands.add_parser(name, help=summary, formatter_class=argparse.RawDescriptionHelpFormatter)
        if name == called:
            module = importlib.import_module(path)
            sub.description = module.__doc__
            module.add_arguments(sub, argv[argv.index(called) + 1:])
    return parser, module


def _complete():
    """Answer a shell that asks how its line may go on; argcomplete ends the program then."""
    import argcomplete
    words = os.environ.get('COMP_LINE', '')[:int(os.environ.get('COMP_POINT', 0))].split(' ')[1:-1]
    argv = list(filter(None, words))
    called = next((word for word in argv if not word.startswith('-')), None)
    try:
        parser, _ = _parser(argv, called)
    except (UsageError, ModelError, MotionError, OSError):      # the model is not there yet
        parser, _ = _parser([], None)
    argcomplete.autocomplete(parser)


def _complain(called, what, status):
    """One line on stderr, if there is one; returns the status."""
    if sys.stderr is not None:
        line = ' '.join(str(what).split())
        if len(line) > _LONGEST:
            line = f'{line[:_LONGEST // 2]} ... {line[-_LONGEST // 4:]}'
        with contextlib.suppress(OSError):
            print(f'motion-style {called}: {line}', file=sys.stderr)
    return status


def _drop(stream):
    """Let what is left in a stream that takes no more go nowhere, so that nothing is said of it at exit."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _Terminated(BaseException):
    """SIGTERM: files that are half written go, as on Ctrl-C."""


@contextlib.contextmanager
def _ended_in_order():
    """Raise on SIGTERM, and write what a terminal cannot show as escapes, while a command runs."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, 'reconfigure'):
            stream.reconfigure(errors='backslashreplace')

    def end(*_):
        raise _Terminated

    try:
        before = signal.signal(signal.SIGTERM, end)
    except ValueError:      # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
