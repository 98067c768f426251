"""What a command found out: sentences for people, or one JSON object (``--json``)."""
import json

import numpy as np

__all__ = ['add_json', 'answer', 'plain']


def add_json(parser):
    """The option."""
    parser.add_argument('--json', action='store_true', help='print one JSON object')


def answer(args, facts, *lines):
    """Print the facts as JSON where that is asked for, else the lines."""
    if args.json:
        print(json.dumps(plain(facts), indent=1, allow_nan=False))
    else:
        for line in lines:
            print(line)


def plain(value):
    """The same of types that JSON knows, with None for what is not a number."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(one) for one in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value
