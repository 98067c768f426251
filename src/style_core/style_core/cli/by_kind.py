"""A command on a model file: the kind of the model decides which module does the work."""
import importlib

from style_core.cli.files import add_input
from style_core.cli.parser import Parser, divide
from style_core.cli.registry import COMMANDS, KIND_COMMANDS
from style_core.errors import ModelError
from style_core.model_file import read_header
from style_core.places import find_file

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Find the model in ``argv`` and let its kind add the arguments; without a model explain every kind."""
    command = parser.prog.split()[-1]
    kinds = KIND_COMMANDS[command]
    add_input(parser, 'model', metavar='MODEL', help='model file (.npz), as motion-style train writes it')
    model = _model_among(argv, kinds)
    if model is None or not kinds:
        parser.description = f'{COMMANDS[command][0].capitalize()}, with a model of one of the kinds below.'
        parser.epilog = '\n'.join(_explain(parser, kind, module) for kind, module in kinds.items())
        return
    if not model.endswith('.npz'):
        if {'-h', '--help'} & set(argv):
            return
        raise ModelError(f'{model} is not a model file: its name must end in .npz')
    kind = read_header(find_file(model, 'model'))['kind']
    if kind not in kinds:
        raise ModelError(f'{model} holds a {kind} model; motion-style {command} works with {", ".join(kinds)}')
    module = importlib.import_module(kinds[kind])
    parser.description = module.__doc__
    module.add_arguments(parser, argv)
    parser.set_defaults(by_kind=module.run)


def run(args):
    """Run the kind's module."""
    return args.by_kind(args)


def _model_among(argv, kinds):
    """The first word that is neither an option, of whatever kind of model, nor the value of one."""
    if argv and not argv[0].startswith('-'):
        return argv[0]
    actions = {}
    for path in dict.fromkeys(kinds.values()):
        one = Parser()
        importlib.import_module(path).add_arguments(one, [])
        actions.update(one._option_string_actions)
    words, _, _ = divide(actions, argv)
    return words[0] if words else None


def _explain(parser, kind, path):
    module = importlib.import_module(path)
    one = Parser(prog=f'{parser.prog} MODEL', description=module.__doc__, add_help=False,
                 formatter_class=parser.formatter_class)
    module.add_arguments(one, [])
    return f'With a {kind} model\n{"-" * (13 + len(kind))}\n{one.format_help()}'
