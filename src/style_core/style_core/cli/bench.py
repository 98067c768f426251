"""Run the project's benches on real recordings and write their result pages.

motion-style bench prediction              every table of the prediction bench (20 to 30 minutes on two cores)
motion-style bench prediction --table 4    one table; several may be named
motion-style bench prediction --resume     only the tables that code or recordings have changed under

Needs a checkout of the project (the tables are scripts under benchmarks/experiments) and the recordings (STYLE_MOCAP,
or ../shared/mocap beside the checkout). Pages go to docs/results/prediction as Markdown, JSON and pictures.
"""

import fcntl
import hashlib
import importlib
import json
import sys
import time
from pathlib import Path

from style_core import datasets
from style_core.cli.number import Count
from style_core.errors import UsageError

__all__ = ['AREAS', 'add_arguments', 'run']

#: area -> {table: (script under benchmarks/experiments, what it shows)}
AREAS = {
    'prediction': {
        '1': ('prediction_seed', "the phase-style paper's protocol, all methods"),
        '2': ('prediction_missing', 'missing sensors and the missing-limb benchmark'),
        '3': ('prediction_jumps', 'jumps, a discrete motion'),
        '4': ('prediction_unseen', 'people never seen'),
        '5': ('prediction_calibration', 'calibration of the bands'),
        '6': ('prediction_recovery', 'recovery after getting lost, error of the phase'),
        '7': ('prediction_cmu8', 'the CMU 8-action benchmark'),
        '8': ('prediction_timing', 'bad timing'),
        '9': ('prediction_faults', 'sensors that lie'),
        '10': ('prediction_groups', 'motion that no model knows'),
        '11': ('prediction_forgetting', 'the published method: lambda, and to the letter'),
        'ablation': ('prediction_ablation', 'what each ingredient is worth'),
        'bars': ('prediction_bars', 'summary of all tables against the goals set'),
    }
}


def add_arguments(parser, argv):
    """Area, tables, output."""
    parser.add_argument('area', choices=sorted(AREAS), help='which bench')
    parser.add_argument(
        '--table',
        action='append',
        metavar='N',
        help='only this table (may be given several times): '
        + '; '.join(f'{key} {what}' for tables in AREAS.values() for key, (_, what) in tables.items()),
    )
    parser.add_argument(
        '-o', '--output', type=Path, help='folder of the pages (default: docs/results/AREA of the checkout)'
    )
    parser.add_argument('--workers', action=Count, default=2, help='processes (default 2); results do not depend on it')
    parser.add_argument(
        '--resume', action='store_true', help='skip tables whose code and recordings are as when last run'
    )


def run(args):
    """Run the tables asked for, one after the other."""
    tables = AREAS[args.area]
    chosen = args.table or list(tables)
    unknown = [name for name in chosen if name not in tables]
    if unknown:
        raise UsageError(f'no table {", ".join(unknown)}; there are {", ".join(tables)}')
    root = _checkout()
    output = args.output or root / 'docs' / 'results' / args.area
    sys.path.insert(0, str(root / 'benchmarks' / 'experiments'))
    state = _digest(root, args.area)
    cache = root / '.cache'
    cache.mkdir(exist_ok=True)
    with open(cache / f'bench_{args.area}.lock', 'w') as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise UsageError(
                f'another {args.area} bench is running in this checkout; two would write the same pages'
            ) from None
        _run(args, tables, chosen, state, cache / f'bench_{args.area}.json', output)


def _run(args, tables, chosen, state, ledger_path, output):
    ledger = json.loads(ledger_path.read_text()) if ledger_path.is_file() else {}
    for name in chosen:
        script, what = tables[name]
        pages = [page for pattern in ('_*.json', '.json') for page in output.glob(f'{args.area}_{name}{pattern}')]
        done = ledger.get(name) == [state, str(output)] and pages
        if args.resume and done and name != 'bars':
            print(f'table {name}, {what}: up to date')
            continue
        print(f'table {name}, {what} ...', flush=True)
        begin = time.perf_counter()
        importlib.import_module(script).main(['-o', str(output), '--workers', str(args.workers)])
        print(f'table {name}: {time.perf_counter() - begin:.0f} s', flush=True)
        ledger[name] = [state, str(output)]
        ledger_path.write_text(json.dumps(ledger, indent=1) + '\n')


def _checkout():
    """Folder of the checkout that holds the experiments."""
    for start in (Path(__file__).resolve(), Path.cwd() / 'here'):
        for folder in start.parents:
            if (folder / 'benchmarks' / 'experiments').is_dir():
                return folder
    raise UsageError('the bench needs a checkout of the project: run it inside one')


def _digest(root, area):
    """Hash of everything a table depends on: package sources, experiment scripts, recordings (by name and size)."""
    digest = hashlib.sha256()
    package = Path(__file__).resolve().parents[1]
    for path in sorted(
        [*package.rglob('*.py'), *package.rglob('*.pyx'), *(root / 'benchmarks' / 'experiments').glob(f'{area}_*.py')]
    ):
        digest.update(path.name.encode() + path.read_bytes())
    folder = datasets.mocap_folder()
    for path in sorted(folder.rglob('*')):
        if path.is_file():
            digest.update(f'{path.relative_to(folder)} {path.stat().st_size}'.encode())
    return digest.hexdigest()
