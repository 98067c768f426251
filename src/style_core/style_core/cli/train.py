"""Learn a model from recordings.

motion-style train KIND FILES... -o MODEL.npz
motion-style train KIND --help          explains the options of a kind
"""
import importlib

from style_core.cli.registry import TRAINERS

__all__ = ['add_arguments', 'run']


def add_arguments(parser, argv):
    """Offer every kind; import only the one that is called."""
    kinds = parser.add_subparsers(dest='kind', metavar='KIND', required=True)
    called = next((word for word in argv if not word.startswith('-')), None)
    for name, (summary, path) in TRAINERS.items():
        sub = kinds.add_parser(name, help=summary, formatter_class=parser.formatter_class)
        if name == called:
            module = importlib.import_module(path)
            sub.description = module.__doc__
            module.add_arguments(sub, argv[argv.index(called) + 1:])
            sub.set_defaults(train=module.run)


def run(args):
    """Run the kind's trainer."""
    return args.train(args)
