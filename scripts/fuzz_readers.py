"""Feed every reader of motion, skeletons and joint states with damaged input, guided by the code it reaches.

What comes out must be a motion, a skeleton or a MotionError, and soon. Needs atheris:

    pip install './src/style_core[test,fuzz]'
    python scripts/fuzz_readers.py .bvh --seconds 60

The tests do the same for some seconds without guidance (src/style_core/test/test_fuzz.py); this is for nights. What a
run has found worth keeping stays in --corpus, where the next run begins. Input that breaks a reader is written to the
current folder as crash-*, and the program ends.
"""
import argparse
import importlib
import sys
import tempfile
import warnings
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
READERS = ('.amc', '.bvh', '.csv', '.npz', '.mcap', '.mot', '.mvnx', '.asf', '.urdf', 'joint_state')


def seeds(suffix, folder):
    """Sound files to begin with."""
    import numpy as np

    from style_core.formats import read_motion, write_motion
    from style_core.motion import Motion
    sys.path.insert(0, str(ROOT / 'src' / 'style_core' / 'test'))
    import test_fuzz
    import test_wire_joint_state_reader as live
    target = folder / f'seed{suffix}'
    if suffix in test_fuzz.SEEDS:
        target.write_text(test_fuzz.SEEDS[suffix])
    elif suffix == 'joint_state':
        target.write_bytes(live.serialised(10**18, 'body', ['hip', 'knee'], [0.5, np.nan], [1.0, 2.0]))
    else:
        write_motion(Motion(('hip', 'knee'), np.arange(12.0).reshape(6, 2), np.arange(6) / 100), target)
        assert read_motion(target).n_frames == 6


def reader(suffix, folder):
    """A function of bytes that raises where a reader does what it must not."""
    from style_core.errors import MotionError
    from style_core.formats import read_motion
    from style_core.skeleton import read_skeleton
    from style_core.wire.joint_state_reader import JointStateReader
    path, states = folder / f'fuzzed{suffix}', JointStateReader()

    def once(data):
        try:
            if suffix == 'joint_state':
                _, names, positions = states.read(data)
                assert isinstance(names, tuple) and positions.ndim == 1
                return
            path.write_bytes(data)
            if suffix in ('.asf', '.urdf'):
                skeleton = read_skeleton(path)
                assert len(set(skeleton.body_names)) == len(skeleton.body_names)
            else:
                motion = read_motion(path)
                assert motion.positions.shape == (motion.n_frames, motion.n_joints)
        except MotionError:
            pass
    return once


def main():
    """Fuzz one reader; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('reader', choices=READERS, help='which one')
    parser.add_argument('--seconds', type=int, default=60, help='how long (default: 60)')
    parser.add_argument('--corpus', type=Path, help='folder of input found worth keeping (default: none is kept)')
    parser.add_argument('--seed', type=int, default=1, help='of what is random (default: 1)')
    args = parser.parse_args()
    try:
        import atheris
    except ImportError:
        print("atheris is missing: pip install './src/style_core[test,fuzz]'", file=sys.stderr)
        return 2
    warnings.simplefilter('ignore')
    with atheris.instrument_imports(include=['style_core']):
        for module in ('amc', 'asf', 'bag', 'bvh', 'csv', 'files', 'npz', 'urdf'):
            importlib.import_module(f'style_core.formats.{module}')
        importlib.import_module('style_core.wire.joint_state_reader')
        importlib.import_module('style_core.skeleton')
    folder = Path(tempfile.mkdtemp(prefix='fuzz_readers_'))
    corpus = args.corpus or folder / 'corpus'
    corpus.mkdir(parents=True, exist_ok=True)
    seeds(args.reader, corpus)
    atheris.Setup([sys.argv[0], f'-max_total_time={args.seconds}', f'-seed={args.seed}', '-timeout=20',
                   '-rss_limit_mb=4096', '-max_len=65536', str(corpus)], reader(args.reader, folder))
    atheris.Fuzz()
    return 0


if __name__ == '__main__':
    sys.exit(main())
