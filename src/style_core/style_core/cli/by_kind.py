"""A command on a model file: the kind of the model decides which module does the work."""
import argparse
import importlib

from style_core.cli.registry import COMMANDS, KIND_COMMANDS
from style_core.errors import ModelError
from style_core.model_file import read_header

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Find the model in ``argv`` and let its kind add the arguments; without a model explain every kind."""
    command = parser.prog.split()[-1]
    kinds = KIND_COMMANDS[command]
    parser.add_argument('model', metavar='MODEL', help='model file (.npz), as motion-style train writes it')
    path = next((word for word in argv if word.endswith('.npz') and not word.startswith('-')), None)
    if path is None or not kinds:
        words = [word for word in argv if not word.startswith('-')]
        if words and not {'-h', '--help'} & set(argv):
            raise ModelError(f'{words[0]} is not a model file: its name must end in .npz')
        parser.description = f'{COMMANDS[command][0].capitalize()}, with a model of one of the kinds below.'
        parser.epilog = '\n'.join(_explain(parser, kind, module) for kind, module in kinds.items())
        return
    kind = read_header(path)['kind']
    if kind not in kinds:
        raise ModelError(f'{path} holds a {kind} model; motion-style {command} works with {", ".join(kinds)}')
    module = importlib.import_module(kinds[kind])
    parser.description = module.__doc__
    module.add_arguments(parser, argv)
    parser.set_defaults(by_kind=module.run)


def run(args):
    """Run the kind's module."""
    return args.by_kind(args)


def _explain(parser, kind, path):
    module = importlib.import_module(path)
    one = argparse.ArgumentParser(prog=f'{parser.prog} MODEL', description=module.__doc__, add_help=False,
                                  formatter_class=parser.formatter_class)
    module.add_arguments(one, [])
    return f'With a {kind} model\n{"-" * (13 + len(kind))}\n{one.format_help()}'
