"""The main job, live: a person walks, the predictor follows and looks ahead; half-way one leg's sensors go
dark, and later they come back.

Player and predictor run as ROS 2 nodes; everything they say is recorded as a bag, then scored and drawn. The walk is a
real one of a person the model has never seen where recordings are at hand (STYLE_MOCAP, else ../shared/mocap), else a
synthetic gait.
"""
import argparse
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from launching import launch, stay_alone, stop

ROOT = Path(__file__).resolve().parents[1]
DARK = ('lfemur.*', 'ltibia.*', 'lfoot.*', 'ltoes.*')


def main():
    """Run the demo; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--seconds', type=float, default=20.0, help='length of the walk (default: 20)')
    parser.add_argument('--synthetic', action='store_true', help='use the synthetic gait even where recordings exist')
    parser.add_argument('--trial', default='16_32', help='recording to play (default: 16_32)')
    parser.add_argument('--method', default='full', choices=('full', 'paper'), help='filter (default: full)')
    parser.add_argument('--output', type=Path, default=ROOT / 'out' / 'demo', help='folder (default: out/demo)')
    parser.add_argument('--robot', action='store_true',
                        help='then the second part, a robot that walks with the person (demo_synth.py)')
    args = parser.parse_args()
    if args.seconds < 6:
        parser.error('--seconds must be at least 6: the filter needs a moment, and so does the leg')
    stay_alone()

    from demo_material import material

    args.output.mkdir(parents=True, exist_ok=True)
    show = material(args.output, args.synthetic, args.trial)
    print(show.story)
    dark = round(args.seconds / 2, 3), round(0.8 * args.seconds, 3)
    with open(args.output / 'nodes.log', 'w') as log:
        nodes = launch(
            [str(ROOT / 'launch' / 'replay.launch.py'), f'model:={show.model}', f'file:={show.file}',
             'loop:=repeat', f'drop:={list(DARK)}', f'drop_from:={dark[0]}', f'drop_until:={dark[1]}',
             f'method:={args.method}', 'listeners:=2'], log)
    try:
        # imported while the nodes start, which play when the recorder listens
        from demo_report import report
        from recording import Recorder
        recorder = Recorder()
        print(f'Walking for {args.seconds:g} s; the left leg is dark from {dark[0]:g} to {dark[1]:g} s ...', flush=True)
        recorder.record(args.seconds, lambda: nodes.poll() is None)
    finally:
        stop(nodes)
    recorder.close()
    if not recorder.messages:
        print(f'Nothing came back from the nodes; see {args.output / "nodes.log"}', file=sys.stderr)
        return 1
    # the nodes of the second part start while the first is drawn
    robot = subprocess.Popen([sys.executable, '-u', str(ROOT / 'scripts' / 'demo_synth.py')], text=True,
                             stdout=subprocess.PIPE, stderr=subprocess.STDOUT) if args.robot else None
    if robot:
        os.nice(5)  # the robot walks in real time, the pictures have time
    try:
        bag = args.output / 'bag'
        shutil.rmtree(bag, ignore_errors=True)  # of an earlier demo
        recorder.write(bag)
        report(recorder, show, dark, args.method, args.output)
        print(f'\nPictures: {args.output}/*.png\nBag:      {bag}', flush=True)
        for line in robot.stdout if robot else ():
            print(line, end='', flush=True)
    except BaseException:
        if robot:
            robot.send_signal(signal.SIGINT)
        raise
    finally:
        status = robot.wait() if robot else 0
    return status


if __name__ == '__main__':
    sys.exit(main())
